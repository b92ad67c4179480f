//! One thing that a flight says, and what is counted of those that were not recorded.

use crate::event::Event;
use crate::orders::{CorrectionOrder, FrameOrder, MapOrder, ResetOrder};
use plumbline_drivers::ImuReading;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, Odometry};
use std::fmt;

/// Input, order, output or event of a flight: a value of fixed size, copied without allocation. Images are handed over
/// apart.
// The estimate is the largest by far, and boxing it would allocate.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug)]
pub enum Said {
    /// Inertial sample, as the odometry is given it.
    Imu(ImuReading),
    /// What became of a frame.
    Order(FrameOrder),
    /// When an estimate took effect on the odometry.
    Correction(CorrectionOrder),
    /// Reset on request, or after a fault.
    Reset(ResetOrder),
    /// What became of a frame that was to be given to the map: by the front-end one that was passed over, by the window one
    /// that takes effect.
    MapOrder(MapOrder),
    /// Estimate, once for each frame.
    Estimate(FullEstimate),
    /// Where the odometry lies in the map, once for each estimate, just before it.
    MapEstimate(MapEstimate),
    /// Odometry, once for each inertial sample after the first pose.
    Odometry(Odometry),
    /// Something that people want to know.
    Event(Event),
}

impl Said {
    /// Its kind.
    #[must_use]
    pub fn kind(&self) -> Kind {
        match self {
            Self::Imu(_) => Kind::Imu,
            Self::Order(_) | Self::Correction(_) | Self::Reset(_) | Self::MapOrder(_) => Kind::Order,
            Self::Estimate(_) => Kind::Estimate,
            Self::Odometry(_) => Kind::Odometry,
            Self::Event(_) => Kind::Event,
            Self::MapEstimate(_) => Kind::MapEstimate,
        }
    }
}

/// Estimate with what the local socket says besides.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FullEstimate {
    /// The estimate.
    pub estimate: Estimate,
    /// Wall time of the frame's computation, ms. No log holds it: it is not the same twice.
    pub frame_ms: f64,
}

/// Kinds of entries of a log, as they are counted when they are dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Inertial samples.
    Imu,
    /// Frames.
    Frame,
    /// Orders of every kind.
    Order,
    /// Estimates.
    Estimate,
    /// Odometry.
    Odometry,
    /// Events.
    Event,
    /// Poses of the odometry in the map.
    MapEstimate,
}

impl Kind {
    /// All kinds with their names.
    pub const NAMES: [(Self, &'static str); 7] = [
        (Self::Imu, "inertial samples"),
        (Self::Frame, "frames"),
        (Self::Order, "orders"),
        (Self::Estimate, "estimates"),
        (Self::Odometry, "odometry"),
        (Self::Event, "events"),
        (Self::MapEstimate, "poses in the map"),
    ];
}

/// Entries that were not recorded, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropped(pub [u64; Kind::NAMES.len()]);

impl Dropped {
    /// Dropped entries of one kind.
    #[must_use]
    pub fn of(&self, kind: Kind) -> u64 {
        self.0[kind as usize]
    }

    /// Dropped entries of all kinds.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.0.iter().sum()
    }

    /// Dropped entries of the kinds that a re-execution needs.
    #[must_use]
    pub fn inputs(&self) -> u64 {
        [Kind::Imu, Kind::Frame, Kind::Order].iter().map(|kind| self.of(*kind)).sum()
    }
}

impl fmt::Display for Dropped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for (kind, name) in Kind::NAMES {
            if self.of(kind) > 0 {
                write!(f, "{separator}{} {name}", self.of(kind))?;
                separator = ", ";
            }
        }
        if self.total() == 0 { f.write_str("nothing") } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_dropped_is_told_in_words() {
        let mut dropped = Dropped::default();
        assert_eq!(dropped.to_string(), "nothing");
        dropped.0[Kind::Frame as usize] = 3;
        dropped.0[Kind::Odometry as usize] = 1;
        assert_eq!(dropped.to_string(), "3 frames, 1 odometry");
        assert_eq!((dropped.inputs(), dropped.total()), (3, 4));
    }
}
