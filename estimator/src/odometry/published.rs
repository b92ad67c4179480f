//! Publication of a frame: the estimate at its stamp, as well known as the judge says.

use super::estimation::Estimation;
use super::{Odometer, Phase, Solved, Velocity};
use crate::estimate::{Estimate, FrameFigures, HealthBits, TrackingState};
use crate::exchange::Tracked;
use crate::window::growth::GrowingCovariance;
use crate::window::state::{FrameMatrix, NavState};
use plumbline_config::Portable;

impl Odometer {
    /// Takes the covariance of the newest frame from the window; returns false if that has none.
    pub(super) fn refresh_covariance(&mut self, health: &mut HealthBits) -> bool {
        let estimation = &mut self.estimation;
        match estimation.window.newest_covariance() {
            Some((covariance, variance)) if (0..9).all(|k| covariance[(k, k)] > 0.0) => {
                let nav = estimation.window.frames.last().map(|f| &f.nav);
                let inherited = &self.start.inherited;
                estimation.covariance = nav.map_or(covariance, |nav| inherited.added_to(covariance, nav));
                estimation.time_offset_sigma_s = variance.at_least(0.0).sqrt();
                let of_biases = estimation.window.newest_bias_variances();
                estimation.bias_variances = of_biases.unwrap_or(estimation.bias_variances);
                if !estimation.window.options.first_estimates
                    && let Some((sigma, _)) = estimation.window.scale_sigma()
                {
                    estimation.scale_sigma = sigma;
                }
                true
            }
            _ => {
                health.insert(HealthBits::NOT_POSITIVE_DEFINITE);
                false
            }
        }
    }

    /// Takes the covariance `predicted` of newest state and biases, against the start anew, where the frame tells nothing of how well it is
    /// known. Right after a start nothing is predicted: the covariance grows without the correlation of state and biases.
    pub(super) fn carry_covariance(&mut self, predicted: Option<&FrameMatrix>) {
        let [.., before, newest] = &self.estimation.window.frames[..] else { return };
        let Some(predicted) = predicted else {
            let Some(inertial) = &newest.inertial else { return };
            let Estimation { covariance, bias_variances, window, .. } = &self.estimation;
            let mut grown = GrowingCovariance::new(*covariance, bias_variances);
            grown.grow(&before.nav, &inertial.motion, &window.imu_noise);
            return self.estimation.covariance = grown.nav;
        };
        let of_nav = predicted.fixed_view::<9, 9>(0, 0).into_owned();
        self.estimation.covariance = self.start.inherited.added_to(of_nav, &newest.nav);
        self.estimation.bias_variances =
            predicted.diagonal().fixed_rows::<6>(NavState::BIAS_GYRO).into_owned();
    }

    fn tracking_state(&self) -> TrackingState {
        let is_running = self.phase == Phase::Running;
        match self.judge.velocity() {
            Velocity::Known if is_running => TrackingState::Tracking,
            Velocity::NoMore if is_running => TrackingState::Blind,
            _ if self.start.reset_counter > self.start.first_counter => TrackingState::Failed,
            _ => TrackingState::Initialising,
        }
    }

    pub(super) fn estimate(&self, tracked: &Tracked, health: HealthBits, solved: Solved) -> Estimate {
        let estimation = &self.estimation;
        let window = &estimation.window;
        let nav = estimation.nav_at_stamp();
        let in_view = estimation.landmarks_in_view();
        let (points, lines) = window.triangulated();
        let state = self.tracking_state();
        let has_pose = matches!(state, TrackingState::Tracking | TrackingState::Blind);
        Estimate {
            frame_sequence: tracked.sequence,
            stamp: tracked.time.stamp,
            state,
            pose_o_b: nav.pose_o_b(),
            v_o_b: nav.v_o_b,
            bias_gyro: nav.bias_gyro,
            bias_accel: nav.bias_accel,
            covariance: self.judge.stated_covariance(estimation),
            origin: self.start.inherited.origin.clone(),
            bias_variances: estimation.bias_variances,
            time_offset_s: window.rig.time_offset_s,
            time_offset_sigma_s: estimation.time_offset_sigma_s,
            pose_b_c0: window.rig.pose_b_c0,
            quality: if has_pose { self.judge.quality(estimation, in_view) } else { -1 },
            health,
            reset_counter: self.start.reset_counter,
            figures: FrameFigures {
                points_in_window: points as u32,
                lines_in_window: lines as u32,
                keyframes: window.frames.iter().filter(|f| f.is_keyframe).count() as u32,
                iterations: solved.iterations,
                is_keyframe: solved.is_keyframe,
                ..tracked.figures
            },
        }
    }
}
