//! A log as sensors: the streams of a recorded flight, to be flown again.

use super::LogError;
use super::channel::Channel;
use super::cursor::Cursor;
use super::reader::Ending;
use parking_lot::Mutex;
use plumbline_config::Timestamp;
use plumbline_config::options::ImageRecording;
use plumbline_drivers::{DriverError, ImuReading, ImuSource, StereoFrame, StereoSource};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// End of a log that is flown, once it was read that far: nothing if it ends with the flight.
#[derive(Clone, Debug, Default)]
pub struct LogEnd(Arc<Mutex<Option<String>>>);

impl LogEnd {
    /// Place and reason of the break, in words.
    pub fn words(&self) -> Option<String> {
        self.0.lock().clone()
    }

    fn set(&self, words: String) {
        self.0.lock().get_or_insert(words);
    }

    /// Result of a read, where damage counts as the end of the log.
    fn or_end<T>(
        &self,
        cursor: &Cursor,
        read: Result<Option<T>, LogError>,
    ) -> Result<Option<T>, DriverError> {
        match read {
            Ok(None) if cursor.damage().is_some() => {
                self.set(cursor.damage().unwrap_or_default().to_owned());
                Ok(None)
            }
            Ok(None) if cursor.reader().ending() == Ending::Truncated => {
                let path = cursor.reader().path().display();
                self.set(format!("{path}: breaks off: the recorder was killed or could not write"));
                Ok(None)
            }
            read => read.map_err(|error| malformed(cursor, &error)),
        }
    }
}

/// The inertial samples of a log.
pub struct LogImu {
    cursor: Cursor,
    end: LogEnd,
}

/// The frames of a log.
pub struct LogStereo {
    cursor: Cursor,
    frames: Range<usize>,
    seconds: Range<f64>,
    first: Option<Timestamp>,
    next: usize,
    end: LogEnd,
}

impl LogImu {
    /// Opens the log at `path`.
    ///
    /// # Errors
    /// When it cannot be read or is no flight log.
    pub fn open(path: &Path) -> Result<Self, LogError> {
        Ok(Self { cursor: Cursor::open(path, &[Channel::Imu])?, end: LogEnd::default() })
    }

    /// Returns the source; it reports to `end` how the log ends.
    #[must_use]
    pub fn ending_at(self, end: &LogEnd) -> Self {
        Self { end: end.clone(), ..self }
    }
}

impl LogStereo {
    /// Opens the log at `path`, limited to `frames`, counted from 0; with `mono` the left images alone.
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
        let (frames, seconds) = (frames.unwrap_or(0..usize::MAX), 0.0..f64::INFINITY);
        Ok(Self { cursor, frames, seconds, first: None, next: 0, end: LogEnd::default() })
    }

    /// Returns the source limited to the frames of these seconds, counted from the first frame.
    #[must_use]
    pub fn within_s(self, seconds: Range<f64>) -> Self {
        Self { seconds, ..self }
    }

    /// Returns the source; it reports to `end` how the log ends.
    #[must_use]
    pub fn ending_at(self, end: &LogEnd) -> Self {
        Self { end: end.clone(), ..self }
    }
}

fn malformed(cursor: &Cursor, error: &LogError) -> DriverError {
    DriverError::Refused { path: cursor.reader().path().to_owned(), message: error.to_string() }
}

impl ImuSource for LogImu {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        let read = self.cursor.next(Channel::Imu);
        self.end.or_end(&self.cursor, read)
    }
}

impl StereoSource for LogStereo {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        while self.next < self.frames.end {
            let read = self.cursor.next_frame(frame);
            if self.end.or_end(&self.cursor, read)?.is_none() {
                return Ok(false);
            }
            self.next += 1;
            let since_s = frame.stamp.seconds_since(*self.first.get_or_insert(frame.stamp));
            if since_s >= self.seconds.end {
                return Ok(false);
            }
            if self.next > self.frames.start && since_s >= self.seconds.start {
                return Ok(true);
            }
        }
        Ok(false)
    }
}
