//! Listens to a run for the network: what only the threads of the run can see. Nothing blocks or allocates.

use super::pace::Pace;
use super::picture::Shot;
use super::rings::Rings;
use crate::pipeline::orders::{FrameOrder, Verdict};
use crate::pipeline::tap::Tap;
use plumbline_drivers::StereoFrame;
use plumbline_estimator::window::Window;
use plumbline_estimator::{Estimate, Tracked};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// The network's ear in a run.
pub struct NetworkTap {
    rings: Arc<Rings>,
    pace: Pace,
    /// Notes on a frame whose image is still to come.
    pending: Option<Box<Shot>>,
}

impl NetworkTap {
    /// Takes pictures at `camera_hz` at most, while somebody looks.
    #[must_use]
    pub fn new(rings: Arc<Rings>, camera_hz: f64) -> Self {
        Self { rings, pace: Pace::new(camera_hz), pending: None }
    }
}

impl Tap for NetworkTap {
    fn another(&self) -> Box<dyn Tap> {
        Box::new(Self { rings: Arc::clone(&self.rings), pace: self.pace.clone(), pending: None })
    }

    fn tracked(&mut self, tracked: &Tracked) {
        if !self.rings.is_watched.load(Ordering::Relaxed) || !self.pace.admits(tracked.time.stamp) {
            return;
        }
        self.pending = self.pending.take().or_else(|| self.rings.shots.spare());
        if let Some(shot) = &mut self.pending {
            shot.note(tracked);
        }
    }

    fn frame(&mut self, frame: &mut StereoFrame) {
        if self.pending.as_mut().is_some_and(|shot| shot.expose(frame))
            && let Some(shot) = self.pending.take()
        {
            self.rings.shots.offer(shot);
            self.rings.picture_wake.notify_one();
        }
    }

    fn order(&mut self, order: &FrameOrder) {
        if let Verdict::Taken { level } = order.verdict {
            self.rings.rung.store(level, Ordering::Relaxed);
        }
    }

    fn solved(&mut self, window: &Window, estimate: &Estimate) {
        if estimate.figures.is_keyframe && estimate.has_pose() {
            self.rings.snapshots.fill(|snapshot| window.snapshot(estimate, snapshot));
        }
    }
}
