//! The image stream of a data set.

use super::defects::FileDefects;
use super::depth::Depth;
use super::frames::Frames;
use super::picture::{ImageReader, NoImage};
use crate::{DriverError, Faults, StereoFrame, StereoSource};
use std::path::PathBuf;

/// Hands out the frames of an [`EurocDataset`](super::EurocDataset), decoding as it goes; a
/// [`Prefetch`](crate::Prefetch) around it decodes ahead of need.
///
/// A camera whose buffer in the frame is 0x0 is not read. An image that is missing or corrupt is
/// counted, and its frame handed out without it, if need be without any: a gap is news too.
#[derive(Debug)]
pub struct EurocStereo {
    frames: Frames,
    folders: [PathBuf; 2],
    reader: ImageReader,
    defects: FileDefects,
}

impl EurocStereo {
    /// `frames` with images in `folders`; of 16-bit images `depth` is in use.
    pub(super) fn new(frames: Frames, folders: [PathBuf; 2], defects: FileDefects, depth: Depth) -> Self {
        Self { frames, folders, reader: ImageReader::new(depth), defects }
    }

    fn read_image(&mut self, file: &str, camera: usize, frame: &mut StereoFrame) {
        let image = &mut frame.images[camera];
        if image.pixels().is_empty() {
            return;
        }
        let path = self.folders[camera].join(file);
        let expected = (image.width(), image.height());
        let Err(why) = self.reader.read(&path, image) else {
            frame.valid[camera] = true;
            return;
        };
        match why {
            NoImage::Missing => self.frames.faults.missing += 1,
            NoImage::Corrupt | NoImage::OtherSize(_) => self.frames.faults.corrupt += 1,
        }
        self.defects.add(&path, why, expected);
    }
}

impl StereoSource for EurocStereo {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        let Some(entry) = self.frames.begin(frame) else { return Ok(false) };
        for (camera, file) in entry.files.iter().enumerate() {
            if let Some(file) = file {
                self.read_image(file, camera, frame);
            }
        }
        Ok(true)
    }

    fn expected_frames(&self) -> Option<u64> {
        Some(self.frames.expected)
    }

    fn faults(&self) -> Faults {
        self.frames.faults
    }
}
