//! What the network hears of a run, on the threads that produce it. Nothing blocks or allocates.

use super::now_ns;
use super::pace::Pace;
use super::picture::Shot;
use super::rings::{LaneWriter, Rings};
use plumbline_drivers::StereoFrame;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, Odometry, Tracked};
use plumbline_flight::pipeline::listener::{Listener, Mapped, Solved};
use plumbline_flight::pipeline::orders::{FrameOrder, Verdict};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Hears odometry.
pub struct TickListener {
    pub(super) rings: Arc<Rings>,
    pub(super) odometry: LaneWriter<(Odometry, i64)>,
}

impl Listener for TickListener {
    fn odometry(&mut self, odometry: &Odometry) {
        self.odometry.push((odometry.clone(), now_ns()));
        if self.rings.sends_odometry.load(Ordering::Relaxed) {
            self.rings.odometry_pulse.give();
        }
        self.rings.odometry_bell.ring();
    }
}

/// Hears of estimates, of what the window holds, and of where the odometry lies in the map.
pub struct WindowListener {
    pub(super) rings: Arc<Rings>,
    pub(super) estimates: LaneWriter<(Estimate, f64)>,
    pub(super) places: LaneWriter<MapEstimate>,
}

impl Listener for WindowListener {
    fn solved(&mut self, solved: &Solved<'_>) {
        if solved.estimate.figures.is_keyframe && solved.estimate.has_pose() {
            self.rings.snapshots.fill(|snapshot| solved.copy_to(snapshot));
        }
    }

    fn estimate(&mut self, estimate: &Estimate, frame_ms: f64) {
        self.estimates.push((estimate.clone(), frame_ms));
        self.rings.bell.ring();
    }

    fn map_estimate(&mut self, estimate: &MapEstimate) {
        self.places.push(estimate.clone());
    }
}

/// Hears of the map.
pub struct PlacesListener(pub(super) Arc<Rings>);

impl Listener for PlacesListener {
    fn mapped(&mut self, mapped: &Mapped<'_>) {
        self.0.paths.fill(|path| mapped.mapper.copy_path(path));
        self.0.bell.ring();
    }
}

/// Takes pictures, and hears of the ladder.
pub struct FrontEndListener {
    rings: Arc<Rings>,
    pace: Pace,
    /// Changes places with one of the ring when it is whole.
    shot: Shot,
    /// It has notes on a frame whose image is still to come.
    is_pending: bool,
}

impl FrontEndListener {
    /// Takes pictures at `camera_hz` at most, while somebody looks; `shot` has room for any.
    #[must_use]
    pub fn new(rings: Arc<Rings>, camera_hz: f64, shot: Shot) -> Self {
        Self { rings, pace: Pace::new(camera_hz), shot, is_pending: false }
    }
}

impl Listener for FrontEndListener {
    fn tracked(&mut self, tracked: &Tracked) {
        if self.rings.is_watched.load(Ordering::Relaxed) && self.pace.admits(tracked.time.stamp) {
            self.shot.note(tracked);
            self.is_pending = true;
        }
    }

    fn frame(&mut self, frame: &mut StereoFrame) {
        if self.is_pending && self.shot.expose(frame) {
            self.is_pending = false;
            self.rings.shots.fill(|waiting| std::mem::swap(waiting, &mut self.shot));
            self.rings.picture_bell.ring();
        }
    }

    fn order(&mut self, order: &FrameOrder) {
        if let Verdict::Taken { level } = order.verdict {
            self.rings.rung.store(level, Ordering::Relaxed);
        }
    }
}
