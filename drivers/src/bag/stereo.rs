//! The image stream of a bag.

use super::messages::{self, Format};
use super::pixels::ImageDecoder;
use super::stream::Messages;
use crate::euroc::depth::Depth;
use crate::euroc::frames::Frames;
use crate::{DriverError, Faults, StereoFrame, StereoSource};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Images that wait for their turn, bytes: a bag whose cameras are further apart was not recorded in one go.
const MAX_WAITING_BYTES: usize = 512 << 20;

/// Hands out the frames of a [`BagDataset`](super::BagDataset), reading and decoding as it goes; a
/// [`Prefetch`](crate::Prefetch) around it does so ahead of need.
///
/// A camera whose buffer in the frame is 0x0 is not read. An image that is corrupt is counted, and its frame handed out
/// without it.
pub struct BagStereo {
    path: PathBuf,
    messages: Messages,
    frames: Frames<u64>,
    /// Topics of the cameras.
    topics: Vec<String>,
    cameras: Vec<Camera>,
    waiting_bytes: usize,
    decoder: ImageDecoder,
}

/// The messages of one camera.
struct Camera {
    /// Messages read so far.
    count: u64,
    /// Numbers of the messages that are still to be handed out.
    wanted: BTreeSet<u64>,
    /// Messages of the topic that were read and not yet handed out.
    waiting: BTreeMap<u64, (Format, Vec<u8>)>,
}

impl BagStereo {
    pub(super) fn new(
        path: &Path,
        messages: Messages,
        topics: Vec<String>,
        frames: Frames<u64>,
        depth: Depth,
    ) -> Self {
        let camera = |camera: usize| {
            let wanted = frames.rest().iter().filter_map(|frame| frame.files[camera]).collect();
            Camera { count: 0, wanted, waiting: BTreeMap::new() }
        };
        let cameras = (0..topics.len()).map(camera).collect();
        Self {
            path: path.to_owned(),
            messages,
            cameras,
            topics,
            frames,
            waiting_bytes: 0,
            decoder: ImageDecoder::new(depth),
        }
    }

    /// The message of that number of a camera; `None` if the bag ends before it.
    fn take(&mut self, camera: usize, number: u64) -> Result<Option<(Format, Vec<u8>)>, DriverError> {
        while self.cameras[camera].count <= number {
            if !self.read_on()? {
                break;
            }
        }
        let taken = self.cameras[camera].waiting.remove(&number);
        self.waiting_bytes -= taken.as_ref().map_or(0, |(_, bytes)| bytes.len());
        Ok(taken)
    }

    /// Reads one message; `false` at the end.
    fn read_on(&mut self) -> Result<bool, DriverError> {
        let Some(message) = self.messages.next_of(&self.topics)? else { return Ok(false) };
        let camera = &mut self.cameras[message.topic];
        if camera.wanted.remove(&camera.count) {
            self.waiting_bytes += message.bytes.len();
            camera.waiting.insert(camera.count, (message.format, message.bytes.to_vec()));
        }
        camera.count += 1;
        if self.waiting_bytes > MAX_WAITING_BYTES {
            let message = "its cameras are too far apart in the file to be flown; was it put together of two recordings?";
            return Err(DriverError::refused(&self.path, message));
        }
        Ok(true)
    }

    fn read_image(&mut self, number: u64, camera: usize, frame: &mut StereoFrame) -> Result<(), DriverError> {
        let taken = self.take(camera, number)?;
        let image = &mut frame.images[camera];
        if image.pixels().is_empty() {
            return Ok(());
        }
        let decoded = taken.as_ref().and_then(|(format, bytes)| {
            let message = messages::image(*format, bytes)?;
            self.decoder.decode(&message, image)
        });
        match decoded {
            Some(()) => frame.valid[camera] = true,
            None => self.frames.faults.corrupt += 1,
        }
        Ok(())
    }
}

impl StereoSource for BagStereo {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        let Some(entry) = self.frames.begin(frame) else { return Ok(false) };
        for camera in 0..self.cameras.len() {
            if let Some(number) = entry.files[camera] {
                self.read_image(number, camera, frame)?;
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
