//! The image stream of a data set.

use super::defects::FileDefects;
use super::depth::Depth;
use super::pairing::FrameEntry;
use super::picture::{ImageReader, NoImage};
use crate::{DriverError, Faults, StereoFrame, StereoSource};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

/// Hands out the frames of an [`EurocDataset`](super::EurocDataset), decoding as it goes; a
/// [`Prefetch`](crate::Prefetch) around it decodes ahead of need.
///
/// A camera whose buffer in the frame is 0x0 is not read. An image that is missing or corrupt is
/// counted, and its frame handed out without it, if need be without any: a gap is news too.
#[derive(Debug)]
pub struct EurocStereo {
    frames: Arc<[FrameEntry]>,
    rest: Range<usize>,
    expected: u64,
    folders: [PathBuf; 2],
    stereo: bool,
    reader: ImageReader,
    last_sequence: Option<u64>,
    faults: Faults,
    defects: FileDefects,
}

impl EurocStereo {
    /// Frames `range` of `frames`, with images in `folders`; `stereo` when there are two cameras; of 16-bit images `depth` is in
    /// use.
    pub(super) fn new(
        frames: Arc<[FrameEntry]>,
        range: Range<usize>,
        folders: [PathBuf; 2],
        stereo: bool,
        faults: Faults,
        defects: FileDefects,
        depth: Depth,
    ) -> Self {
        let (reader, expected) = (ImageReader::new(depth), range.len() as u64);
        Self { frames, rest: range, expected, folders, stereo, reader, last_sequence: None, faults, defects }
    }

    fn read_image(&mut self, entry: &FrameEntry, camera: usize, frame: &mut StereoFrame) {
        frame.valid[camera] = false;
        let image = &mut frame.images[camera];
        let Some(file) = &entry.files[camera] else { return };
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
            NoImage::Missing => self.faults.missing += 1,
            NoImage::Corrupt | NoImage::OtherSize(_) => self.faults.corrupt += 1,
        }
        self.defects.add(&path, why, expected);
    }
}

impl StereoSource for EurocStereo {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        let frames = Arc::clone(&self.frames);
        let Some(entry) = self.rest.next().and_then(|i| frames.get(i)) else { return Ok(false) };
        if let Some(last) = self.last_sequence.replace(entry.sequence) {
            self.faults.missing += entry.sequence - last - 1;
        }
        frame.sequence = entry.sequence;
        frame.stamp = entry.stamp;
        self.read_image(entry, 0, frame);
        self.read_image(entry, 1, frame);
        if self.stereo && entry.files.iter().any(Option::is_none) {
            self.faults.unpaired += 1;
        }
        Ok(true)
    }

    fn expected_frames(&self) -> Option<u64> {
        Some(self.expected)
    }

    fn faults(&self) -> Faults {
        self.faults
    }
}
