//! How the errors of a published pose and of one about a second before hang together: what a judge of steps must know
//! beside the covariances of both.

use super::Odometer;
use nalgebra::Matrix4;
use plumbline_config::Timestamp;

/// Length of a step, s, and how far it may be from that: frames leave the window when they are no longer of use.
const STEP_S: f64 = 1.0;
const TOLERANCE_S: f64 = 0.3;

/// Correlation of the errors of two poses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepCorrelation {
    /// Time of the earlier pose.
    pub from: Timestamp,
    /// Time of the later pose.
    pub to: Timestamp,
    /// `E[x_from x_to']` with `x` the error of position (0..3, m) and of yaw (3, rad), in `O`.
    pub covariance: Matrix4<f64>,
}

impl Odometer {
    /// Correlates each new pose with the one about a second before, for [`Self::step_correlation`]. Default: no. Estimates stay the same
    /// bits.
    pub fn keep_steps(&mut self, keeps: bool) {
        self.keeps_steps = keeps;
    }

    /// Correlation of the newest pose with one about a second before; `None` unless [`Self::keep_steps`] was asked for it,
    /// where the window holds no frame of that time, and without a covariance.
    #[must_use]
    pub fn step_correlation(&self) -> Option<&StepCorrelation> {
        self.step.as_ref()
    }

    /// Looks for the step that ends at the newest frame, before any frame makes room.
    pub(super) fn note_step(&mut self) {
        self.step = self.keeps_steps.then(|| self.newest_step()).flatten();
    }

    fn newest_step(&mut self) -> Option<StepCorrelation> {
        let newest = self.window.frames.len().checked_sub(1)?;
        let to = self.window.frames[newest].stamp;
        let off_s = |k: &usize| (to.seconds_since(self.window.frames[*k].stamp) - STEP_S).abs();
        let from = (0..newest).min_by(|a, b| off_s(a).total_cmp(&off_s(b)))?;
        if off_s(&from) > TOLERANCE_S {
            return None;
        }
        let of_window = self.window.correlation(from, newest)?;
        let [from, newest] = [from, newest].map(|k| &self.window.frames[k]);
        let covariance = of_window + self.inherited.correlation(&from.nav, &newest.nav);
        Some(StepCorrelation { from: from.stamp, to, covariance })
    }
}
