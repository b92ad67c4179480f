//! A log as sensors: the streams of a recorded flight, to be flown again.

use super::LogError;
use super::channel::Channel;
use super::cursor::Cursor;
use plumbline_config::options::ImageRecording;
use plumbline_drivers::{DriverError, Faults, ImuReading, ImuSource, StereoFrame, StereoSource};
use std::ops::Range;
use std::path::Path;

/// The inertial samples of a log.
pub struct LogImu(Cursor);

/// The frames of a log.
pub struct LogStereo {
    cursor: Cursor,
    frames: Range<usize>,
    next: usize,
}

impl LogImu {
    /// Of the log at `path`.
    ///
    /// # Errors
    /// When it cannot be read or is no flight log.
    pub fn open(path: &Path) -> Result<Self, LogError> {
        Ok(Self(Cursor::open(path, &[Channel::Imu])?))
    }
}

impl LogStereo {
    /// Of the log at `path`, those within `frames`, counted from 0; with `mono` their left images alone.
    ///
    /// # Errors
    /// When it cannot be read, is no flight log, or holds no images.
    pub fn open(path: &Path, frames: Option<Range<usize>>, mono: bool) -> Result<Self, LogError> {
        let wanted: &[Channel] = if mono {
            &[Channel::Left, Channel::Frame]
        } else {
            &[Channel::Left, Channel::Right, Channel::Frame]
        };
        let cursor = Cursor::open(path, wanted)?;
        if cursor.reader().about().images == ImageRecording::None {
            let reason = "was recorded without images (recorder.images = \"none\"); replay the data set it was \
                          recorded from, or give that to verify with --images";
            return Err(LogError::unusable(path, reason));
        }
        Ok(Self { cursor, frames: frames.unwrap_or(0..usize::MAX), next: 0 })
    }
}

fn malformed(cursor: &Cursor, error: &LogError) -> DriverError {
    DriverError::Malformed { path: cursor.reader().path().to_owned(), message: error.to_string() }
}

impl ImuSource for LogImu {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        self.0.next(Channel::Imu).map_err(|e| malformed(&self.0, &e))
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }
}

impl StereoSource for LogStereo {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        while self.next < self.frames.end {
            let found = self.cursor.next_frame(frame).map_err(|e| malformed(&self.cursor, &e))?;
            if found.is_none() {
                return Ok(false);
            }
            self.next += 1;
            if self.next > self.frames.start {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn expected_frames(&self) -> Option<u64> {
        None
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }
}
