//! Interface of every driver: a source of inertial samples and a source of stereo frames.
//!
//! Live hardware and replay implement these two traits. A source blocks until its next sample (replay returns at once),
//! and hands it out with its measurement time and a sequence number. The number counts what the sensor produced, so a
//! jump is a gap. The source reports the end of the stream. What it could repair or skip it counts in [`Faults`]; what
//! it cannot recover from is a [`DriverError`].

use crate::DriverError;
use plumbline_config::Timestamp;

pub use plumbline_config::StereoFrame;
pub use plumbline_fields::ImuReading;

/// Counts of faults that a source survived.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Faults {
    /// Samples or frames missing by the sequence numbers, the files or the stamps.
    pub missing: u64,
    /// Samples or images that could not be decoded or held impossible values.
    pub corrupt: u64,
    /// Samples out of order, put right or refused.
    pub disordered: u64,
    /// Images without a partner of the same time.
    pub unpaired: u64,
    /// Rows or messages with the stamp of an earlier one, dropped; counted as disordered too.
    pub repeated: u64,
    /// Times that the clock of the stamps stepped back in a recording: what came later was stamped into the time of what
    /// came before.
    pub steps_back: u64,
    /// Largest of these steps, ns.
    pub longest_step_back_ns: u64,
}

/// A stream of inertial samples in order of measurement time.
pub trait ImuSource: Send {
    /// The next sample, or `None` at the end of the stream.
    ///
    /// # Errors
    /// When the stream cannot go on.
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError>;

    /// Faults survived so far.
    fn faults(&self) -> Faults {
        Faults::default()
    }
}

/// A stream of stereo (or monocular) frames in order of measurement time.
pub trait StereoSource: Send {
    /// Writes the next frame into `frame`; `false` at the end of the stream.
    ///
    /// # Errors
    /// When the stream cannot go on.
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError>;

    /// Passes over frames older than `stamp`, which would come too late to be of use, and says how many. A source
    /// that takes frames as they come has none; one that makes them when asked saves itself the work.
    fn skip_to(&mut self, _stamp: Timestamp) -> u64 {
        0
    }

    /// Frames the stream will hold in all, where that is known (for progress bars).
    fn expected_frames(&self) -> Option<u64> {
        None
    }

    /// Faults survived so far.
    fn faults(&self) -> Faults {
        Faults::default()
    }
}

impl<S: ImuSource + ?Sized> ImuSource for Box<S> {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        (**self).next_reading()
    }

    fn faults(&self) -> Faults {
        (**self).faults()
    }
}

impl<S: StereoSource + ?Sized> StereoSource for Box<S> {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        (**self).next_frame(frame)
    }

    fn skip_to(&mut self, stamp: Timestamp) -> u64 {
        (**self).skip_to(stamp)
    }

    fn expected_frames(&self) -> Option<u64> {
        (**self).expected_frames()
    }

    fn faults(&self) -> Faults {
        (**self).faults()
    }
}
