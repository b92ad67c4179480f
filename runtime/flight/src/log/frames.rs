//! The frames of a log, with its own images or those of the data set that it was recorded from.

use super::cursor::Cursor;
use super::{LogError, image};
use plumbline_config::Config;
use plumbline_config::options::image_sizes;
use plumbline_drivers::{StereoFrame, StereoSource};
use plumbline_record::parts::FrameAbout;

/// One frame after the other.
pub struct FramePlayback {
    images: Option<Box<dyn StereoSource>>,
    frame: StereoFrame,
}

impl FramePlayback {
    /// Frames of a flight with this configuration.
    pub fn new(config: &Config, images: Option<Box<dyn StereoSource>>) -> Self {
        Self { images, frame: StereoFrame::new(image_sizes(&config.camera)) }
    }

    /// The frame that was found last.
    pub fn found(&mut self) -> &mut StereoFrame {
        &mut self.frame
    }

    /// Reads frames up to number `sequence`; `false` when the log ends before it.
    ///
    /// # Errors
    /// When the log cannot be read, or lacks the frame.
    pub fn find(&mut self, sequence: u64, log: &mut Cursor) -> Result<bool, LogError> {
        loop {
            let Some(description) = log.next_frame(&mut self.frame)? else { return Ok(false) };
            if description.sequence > sequence {
                let reason = format!("frame {sequence} was estimated, but is not in the log");
                return Err(LogError::unusable(log.reader().path(), reason));
            }
            if description.sequence == sequence {
                self.find_images(&description, log)?;
                return Ok(true);
            }
        }
    }

    /// Takes the images of the frame from the data set, if they are not the log's.
    fn find_images(&mut self, description: &FrameAbout, log: &Cursor) -> Result<(), LogError> {
        let (sequence, stamp) = (description.sequence, self.frame.stamp);
        let unusable = |reason: String| LogError::unusable(log.reader().path(), reason);
        let Some(images) = &mut self.images else { return Ok(()) };
        loop {
            if !images.next_frame(&mut self.frame)? || self.frame.sequence > sequence {
                return Err(unusable(format!("frame {sequence} is not in the data set of --images")));
            }
            if self.frame.sequence == sequence {
                break;
            }
        }
        self.frame.stamp = stamp;
        for (camera, image) in [&description.left, &description.right].into_iter().enumerate() {
            let Some(image) = image else {
                self.frame.valid[camera] = false;
                continue;
            };
            let sound = match self.frame.valid[camera] {
                true => image::check(&self.frame.images[camera], image),
                false => Err("its image is missing"),
            };
            sound.map_err(|e| {
                unusable(format!("frame {sequence} of the data set of --images is another: {e}"))
            })?;
        }
        Ok(())
    }
}
