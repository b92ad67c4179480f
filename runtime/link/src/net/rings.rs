//! What joins the records of a flight to the tasks that send them: rings that forget the oldest rather than make anybody wait.

use super::task_bell::TaskBell;
use plumbline_config::ValidConfig;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_estimator::{Estimate, MapSnapshot, Odometry};
use plumbline_flight::local::{SensorNews, Shot};
use plumbline_flight::schedule::lane::{LaneLosses, LaneReader, LaneWriter, lane};
use plumbline_flight::schedule::pool::Pool;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Odometry that waits for the network: a quarter of a second.
const ODOMETRY_RING: usize = 50;
/// Estimates that wait for the network: two seconds.
const ESTIMATE_RING: usize = 40;
/// Map snapshots of the window that are filled, wait or are read: they come with keyframes, a few a second.
const SNAPSHOTS: usize = 8;
/// Corrected paths that are filled, wait or are read: only the newest counts.
const PATHS: usize = 3;
/// Pictures that are filled, wait or are read.
const SHOTS: usize = 3;

/// Writing ends, filled with the records of the flight.
#[derive(Debug)]
pub struct Written {
    /// Odometry, with the time it was handed over, ns since 1970.
    pub odometry: LaneWriter<(Odometry, i64)>,
    /// Estimates, with the computation of the frame, ms.
    pub estimates: LaneWriter<(Estimate, f64)>,
    /// Pose of the odometry frame in the map.
    pub places: LaneWriter<MapEstimate>,
}

/// Reading ends of [`Written`].
#[derive(Debug)]
pub struct ToSend {
    /// Odometry, with the time it was handed over, ns since 1970; taken by the task that sends it.
    pub odometry: LaneReader<(Odometry, i64)>,
    /// Estimates, with what the frame took, ms.
    pub estimates: LaneReader<(Estimate, f64)>,
    /// Where the odometry lies in the map.
    pub places: LaneReader<MapEstimate>,
}

/// Everything else that feed and tasks share.
#[derive(Debug)]
pub struct Rings {
    /// What the window holds, after each keyframe.
    pub snapshots: Pool<MapSnapshot>,
    /// The corrected path, after each frame that was taken into the map.
    pub paths: Pool<MapPath>,
    /// Left pictures with what is tracked in them.
    pub shots: Pool<Shot>,
    /// Step of the degradation ladder.
    pub rung: AtomicU8,
    /// State of live sensors.
    pub sensors: Mutex<SensorNews>,
    /// Records that the flight dropped since this process was too slow.
    pub lost_before: AtomicU64,
    /// Wakes the task that sends odometry.
    pub odometry_bell: TaskBell,
    /// Wakes who sends estimates and snapshots.
    pub bell: TaskBell,
    /// Wakes the task that sends camera images.
    pub picture_bell: TaskBell,
    /// The flight is over.
    pub stop: AtomicBool,
    losses: [LaneLosses; 3],
}

impl Rings {
    /// Everything allocated for the configuration; corrected paths have at most `path_poses` poses.
    ///
    /// # Errors
    /// When the system has no more file descriptors.
    pub fn new(config: &ValidConfig, path_poses: usize) -> std::io::Result<(Self, Written, ToSend)> {
        let (odometry_in, odometry, odometry_losses) = lane(ODOMETRY_RING);
        let (estimates_in, estimates, estimate_losses) = lane(ESTIMATE_RING);
        let (places_in, places, place_losses) = lane(ESTIMATE_RING);
        let rings = Self {
            snapshots: Pool::new(SNAPSHOTS, || MapSnapshot::new(config.setup())),
            paths: Pool::new(PATHS, || MapPath::new(path_poses)),
            shots: Pool::new(SHOTS, || Shot::new(config)),
            rung: AtomicU8::new(0),
            sensors: Mutex::default(),
            lost_before: AtomicU64::new(0),
            odometry_bell: TaskBell::new()?,
            bell: TaskBell::new()?,
            picture_bell: TaskBell::new()?,
            stop: AtomicBool::new(false),
            losses: [odometry_losses, estimate_losses, place_losses],
        };
        let written = Written { odometry: odometry_in, estimates: estimates_in, places: places_in };
        Ok((rings, written, ToSend { odometry, estimates, places }))
    }

    /// Ends the flight: the tasks send what is left, and end.
    pub fn end(&self) {
        self.stop.store(true, Ordering::Relaxed);
        self.odometry_bell.ring();
        self.bell.ring();
    }

    /// State of live sensors.
    #[must_use]
    pub fn sensors(&self) -> SensorNews {
        self.sensors.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Entries dropped because the network was slower than the vehicle.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        let here = self.losses.iter().map(LaneLosses::count).sum::<u64>() + self.snapshots.dropped();
        here + self.lost_before.load(Ordering::Relaxed)
    }
}
