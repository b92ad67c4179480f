//! Listeners that keep what a run produces in memory: whole states, and odometry.
//!
//! The storage stands before the run and moves to the thread that fills it; when the run is over it comes back.

use super::Flight;
use crate::pipeline::listener::{Listener, Producer, Subscriber};
use parking_lot::Mutex;
use plumbline_drivers::StampedPose;
use plumbline_estimator::{Estimate, Odometry};
use plumbline_record::Said;
use std::sync::Arc;

/// Room for poses is made beforehand for up to so many frames: two hours at 20 Hz.
pub(super) const MAX_RESERVED_FRAMES: usize = 144_000;

/// Odometry for which memory is allocated beforehand: half an hour at 200 Hz, 0.3 GB.
const LIVE_READINGS: usize = 360_000;

/// Keeps what `take` finds in what one thread says, a row each.
#[derive(Debug)]
pub struct Kept<T> {
    rows: EntryStorage<T>,
    producer: Producer,
    take: fn(&Said) -> Option<T>,
}

impl<T: Clone + Default> Kept<T> {
    pub(super) fn new(room: usize, producer: Producer, take: fn(&Said) -> Option<T>) -> Self {
        Self { rows: EntryStorage::with_room_for(room), producer, take }
    }

    /// The rows in order, after the run.
    #[must_use]
    pub fn into_rows(self) -> Vec<T> {
        self.rows.into_entries()
    }
}

/// Everything that the estimates hold, a row a frame.
pub type KeptStates = Kept<Estimate>;
/// Everything that the odometry holds, a row an inertial sample.
pub type KeptOdometry = Kept<Odometry>;
/// The pose of every odometry, at the rate of the IMU.
pub type OdometryTrajectory = Kept<StampedPose>;

impl KeptStates {
    /// With room for the frames of `flight`.
    pub fn for_flight(flight: &Flight) -> Self {
        let expected = flight.stereo.expected_frames().and_then(|frames| usize::try_from(frames).ok());
        let room = expected.unwrap_or(0).min(MAX_RESERVED_FRAMES);
        Self::new(room, Producer::Window, |said| match said {
            Said::Estimate(full) => Some(full.estimate.clone()),
            _ => None,
        })
    }
}

impl KeptOdometry {
    /// With room for the odometry of `flight`.
    pub fn for_flight(flight: &Flight) -> Self {
        let room = flight.expected_readings().min(LIVE_READINGS);
        Self::new(room, Producer::Tick, |said| match said {
            Said::Odometry(odometry) => Some(odometry.clone()),
            _ => None,
        })
    }
}

impl OdometryTrajectory {
    /// With room for so many poses.
    pub fn with_room_for(readings: usize) -> Self {
        Self::new(readings, Producer::Tick, |said| match said {
            Said::Odometry(odometry) => Some(StampedPose { stamp: odometry.stamp, pose: odometry.pose_o_b }),
            _ => None,
        })
    }
}

impl<T: Clone + Default + Send + 'static> Subscriber for Kept<T> {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match producer == self.producer {
            true => Box::new(Keeper { rows: self.rows.lend(), take: self.take }),
            false => Box::new(()),
        }
    }
}

struct Keeper<T> {
    rows: Lent<T>,
    take: fn(&Said) -> Option<T>,
}

impl<T: Send> Listener for Keeper<T> {
    fn said(&mut self, said: &Said) {
        self.rows.entries.extend((self.take)(said));
    }
}

/// Storage of entries before and after the run.
#[derive(Debug)]
pub(super) struct EntryStorage<T>(Arc<Mutex<Vec<T>>>);

impl<T: Clone + Default> EntryStorage<T> {
    pub(super) fn with_room_for(count: usize) -> Self {
        // Written once, so that every page is there.
        let mut entries = vec![T::default(); count];
        entries.clear();
        Self(Arc::new(Mutex::new(entries)))
    }

    pub(super) fn lend(&self) -> Lent<T> {
        let entries = std::mem::take(&mut *self.0.lock());
        Lent { entries, home: Arc::clone(&self.0) }
    }

    pub(super) fn into_entries(self) -> Vec<T> {
        std::mem::take(&mut *self.0.lock())
    }
}

/// Entries on the thread that fills them. They come home when the thread is done.
pub(super) struct Lent<T> {
    pub(super) entries: Vec<T>,
    home: Arc<Mutex<Vec<T>>>,
}

impl<T> Drop for Lent<T> {
    fn drop(&mut self) {
        let entries = std::mem::take(&mut self.entries);
        *self.home.lock() = entries;
    }
}
