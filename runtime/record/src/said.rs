//! Messages of a flight besides records of the estimator, and counts of entries that were not recorded.

use crate::event::Event;
use plumbline_estimator::Estimate;
use plumbline_fields::{Parts, Record};
use std::fmt;

/// Record of a flight, if it is one: an event is drawn instead.
pub trait Told {
    /// The record.
    fn record(&self) -> Option<&dyn Parts>;
}

impl<T: Record> Told for T {
    fn record(&self) -> Option<&dyn Parts> {
        Some(self)
    }
}

impl Told for Event {
    fn record(&self) -> Option<&dyn Parts> {
        None
    }
}

/// Estimate of a frame, with what the local socket says besides.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("FullEstimate")]
pub struct FullEstimate {
    /// The estimate.
    #[field(1)]
    pub estimate: Estimate,
    /// Wall time of the frame's computation, ms. No log holds it: it is not the same twice.
    #[field(2, one)]
    pub frame_ms: f64,
}

/// Kinds of entries of a log, as they are counted when they are dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EntryKind {
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
    /// States at instants.
    Instant,
}

impl EntryKind {
    /// All kinds with their names.
    pub const NAMES: [(Self, &'static str); 8] = [
        (Self::Imu, "inertial samples"),
        (Self::Frame, "frames"),
        (Self::Order, "orders"),
        (Self::Estimate, "estimates"),
        (Self::Odometry, "odometry"),
        (Self::Event, "events"),
        (Self::MapEstimate, "poses in the map"),
        (Self::Instant, "states at instants"),
    ];
}

/// Entries that were not recorded, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropped(pub [u64; EntryKind::NAMES.len()]);

impl Dropped {
    /// Dropped entries of one kind.
    pub fn of(&self, kind: EntryKind) -> u64 {
        self.0[kind as usize]
    }

    /// Dropped entries of all kinds.
    pub fn total(&self) -> u64 {
        self.0.iter().sum()
    }

    /// Dropped entries of the kinds that a re-execution needs.
    pub fn inputs(&self) -> u64 {
        [EntryKind::Imu, EntryKind::Frame, EntryKind::Order].iter().map(|kind| self.of(*kind)).sum()
    }
}

impl fmt::Display for Dropped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for (kind, name) in EntryKind::NAMES {
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
        dropped.0[EntryKind::Frame as usize] = 3;
        dropped.0[EntryKind::Odometry as usize] = 1;
        assert_eq!(dropped.to_string(), "3 frames, 1 odometry");
        assert_eq!((dropped.inputs(), dropped.total()), (3, 4));
    }
}
