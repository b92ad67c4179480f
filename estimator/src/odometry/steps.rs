//! Uncertainty of the newest pose relative to one about a second before: judging steps needs it beside the covariances
//! published with both.

use super::Odometer;
use nalgebra::Matrix4;
use plumbline_config::Timestamp;

/// Length of a step, s, and how far it may be from that: frames leave the window when they are no longer of use.
const STEP_S: f64 = 1.0;
const TOLERANCE_S: f64 = 0.3;

/// Covariances of a step by the window of its later pose. All are of errors of position (0..3, m) and of yaw (3, rad) in `O`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepCovariance {
    /// Time of the earlier pose.
    pub from: Timestamp,
    /// Time of the later pose.
    pub to: Timestamp,
    /// Covariance of way and turn between the two, in the axes of `O` as the earlier pose has them.
    pub covariance: Matrix4<f64>,
    /// Covariance of the earlier pose as it is known now.
    pub of_from: Matrix4<f64>,
    /// Covariance of the later pose.
    pub of_to: Matrix4<f64>,
}

impl Odometer {
    /// Keeps covariances of steps, for [`Self::step_covariance`]. Default: no. Estimates stay the same bits.
    pub fn keep_steps(&mut self, keeps: bool) {
        self.keeps_steps = keeps;
    }

    /// Covariance of the step to the newest pose from one about a second before; `None` unless [`Self::keep_steps`] was asked
    /// for it, where the window holds no frame of that time, and without a covariance.
    pub fn step_covariance(&self) -> Option<&StepCovariance> {
        self.step.as_ref()
    }

    /// Looks for the step that ends at the newest frame, before any frame makes room.
    pub(super) fn newest_step(&mut self) -> Option<StepCovariance> {
        self.keeps_steps.then_some(())?;
        let newest = self.estimation.window.frames.len().checked_sub(1)?;
        let to = self.estimation.window.frames[newest].stamp;
        let off_s = |k: &usize| (to.seconds_since(self.estimation.window.frames[*k].stamp) - STEP_S).abs();
        let nearest = (0..newest).min_by(|a, b| off_s(a).total_cmp(&off_s(b)));
        let from = nearest.filter(|k| off_s(k) <= TOLERANCE_S)?;
        let covariance = self.estimation.window.relative_covariance(from, newest)?;
        let [of_from, of_to] =
            [self.estimation.window.covariance_in_o(from)?, self.estimation.window.covariance_in_o(newest)?];
        let [from, newest] = [from, newest].map(|k| &self.estimation.window.frames[k]);
        let [by_from, by_to] = [from, newest].map(|frame| self.start.inherited.of_pose(&frame.nav));
        let (of_from, of_to) = (of_from + by_from, of_to + by_to);
        Some(StepCovariance { from: from.stamp, to, covariance, of_from, of_to })
    }
}
