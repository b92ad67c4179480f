//! Sensors that fail without a word: what they say is not believed, and the estimate goes on with what is left.
//!
//! A sensor that repeats its readings is found by [`crate::inertial::stuck`], samples or images with late stamps by
//! [`super::rotation_watch`]. Either way the samples lose belief from the moment on at which it began: the motions between the
//! frames of the window since then are integrated anew, and the newest frame begins where its images place it.

use super::Odometer;
use super::force_watch::{ForceSigmas, SeenMotion};
use super::innovation::Prediction;
use super::judgement::Velocity;
use super::rotation_watch::SeenTurn;
use crate::estimate::{BiasVariances, HealthBits, NavCovariance};
use crate::geometry::log_so3;
use crate::inertial::Unmeasured;
use crate::inertial::buffer::Coverage;
use crate::window::frame::Frame;
use crate::window::sighting::Sighting;
use nalgebra::Vector3;
use plumbline_config::{Portable, Timestamp};

/// Reports stuck sensors in `health`; returns whether there are any.
pub(super) fn report_stuck(stuck: Unmeasured, health: &mut HealthBits) -> bool {
    for (is_stuck, bit) in [(stuck.gyro, HealthBits::GYRO_STUCK), (stuck.accel, HealthBits::ACCEL_STUCK)] {
        if is_stuck {
            health.insert(bit);
        }
    }
    stuck.is_any()
}

/// Largest standard deviation of the three biases from `first` on.
fn largest_sigma(variances: &BiasVariances, first: usize) -> f64 {
    (first..first + 3).map(|k| variances[k]).fold(0.0, |most, x: f64| x.at_least(most)).sqrt()
}

impl Odometer {
    /// Judges the inertial samples that lead to the newest frame, `coverage` being what was met on the way, by what the frame
    /// sees.
    pub(super) fn judge_turn(
        &mut self,
        prediction: &Prediction,
        coverage: Coverage,
        health: &mut HealthBits,
    ) {
        let stuck = self.imu.stuck();
        report_stuck(stuck, health);
        if stuck.gyro {
            // Its name is known.
            self.rotation.forget_turns();
        }
        let start = match (coverage.unmeasured.is_any(), self.window.frames.last()) {
            (_, None) => return,
            (true, Some(newest)) => self.window.steady_newest().unwrap_or_else(|| newest.nav.clone()),
            (false, Some(newest)) => newest.nav.clone(),
        };
        let sighting = self.window.sight_newest(&start);
        if sighting.is_none() {
            self.rotation.end_probation();
        }
        if let Some(sighting) =
            sighting.filter(|_| !stuck.gyro && self.are_images_witnesses(coverage, health))
            && let [.., before, newest] = &self.window.frames[..]
        {
            let since = self.rotation.update(&SeenTurn {
                span: [before.stamp, newest.stamp],
                seen: log_so3(&(before.nav.rot_o_b.inverse() * sighting.rot_o_b)),
                sigma_rad: sighting.rotation_sigma_rad,
                bias_gyro: before.nav.bias_gyro,
                bias_sigma_rad_s: largest_sigma(&self.bias_variances, 0),
                skips_frames: health.contains(HealthBits::FRAME_GAP),
                skips_samples: coverage.has_gap,
            });
            if let Some(since) = since {
                self.imu.distrust(since);
            }
        }
        if !self.rotation.is_distrusting() {
            self.imu.trust();
        }
        self.rotation.report(health);
        if let Some(since) = self.imu.take_revision() {
            self.integrate_anew(since);
        }
        if coverage.unmeasured.is_any() || self.rotation.is_distrusting() {
            match sighting {
                Some(sighting) => self.window.place_newest(&sighting),
                None => self.window.place_newest_at(start),
            }
        }
        self.judge_forces(sighting, prediction, coverage, health);
    }

    /// Compares the forces that lead to the newest frame with where the images place it; those that they contradict hardly count.
    fn judge_forces(
        &mut self,
        sighting: Option<Sighting>,
        prediction: &Prediction,
        coverage: Coverage,
        health: &mut HealthBits,
    ) {
        let Some(newest) = self.window.frames.last() else { return };
        let is_judged = self.window.options.cameras > 1
            && self.velocity == Velocity::Known
            && !coverage.has_gap
            && !coverage.unmeasured.is_any()
            && !self.rotation.is_distrusting();
        let found = match (sighting.filter(|_| is_judged), &self.window.frames[..]) {
            (Some(sighting), [.., before, Frame { inertial: Some(inertial), .. }]) => {
                let seen = SeenMotion {
                    stamp: newest.stamp,
                    p_o_b: sighting.p_o_b,
                    sigma_m: sighting.position_sigma_m,
                    rot_o_before: before.nav.rot_o_b,
                    motion: &inertial.motion,
                    speed_m_s: before.nav.v_o_b.norm(),
                    stamp_sigma_s: self.rotation.stamp_sigma_s(),
                };
                let sigmas = ForceSigmas {
                    noise: self.noise,
                    bias_m_s2: largest_sigma(&self.bias_variances, 3),
                    tilt_rad: self.tilt_sigma_rad(),
                };
                // What could not be told from things that move is no evidence.
                let is_witness = !self.window.is_motion_in_sight()
                    && self.window.knows_its_view()
                    && (self.forces.is_contradicted()
                        || prediction
                            .velocity_sigma_m_s()
                            .is_some_and(|sigma| self.window.tells_moving(sigma)));
                self.forces.update(&seen, &sigmas, is_witness).map(|wrong| (wrong, sighting))
            }
            _ => {
                self.forces.pass_over(newest.stamp);
                None
            }
        };
        if let Some((wrong, sighting)) = found {
            self.window.doubt_forces(wrong.since, wrong.sigma_m_s2);
            self.window.place_newest(&sighting);
        }
        if self.forces.is_named() {
            health.insert(HealthBits::ACCEL_CONTRADICTED);
        }
    }

    /// Judges whether both images of the newest frame are of the same moment.
    pub(super) fn judge_moment_of_pair(&mut self, health: &mut HealthBits) {
        let period_s = self.options.frame_period_s;
        self.pair_time.add(self.window.epipolar_moments(), period_s);
        if self.pair_time.is_out_of_step() {
            health.insert(HealthBits::CAMERAS_OUT_OF_STEP);
        }
    }

    /// Whether the turn that the images tell is evidence against the gyroscope: not while people are in view, whom it found, or most of the view has just come; but
    /// after a hole in a stream all that is seen may be late, and looks like people.
    fn are_images_witnesses(&self, coverage: Coverage, health: &HealthBits) -> bool {
        let is_settled = self.rotation.is_distrusting() || self.window.knows_its_view();
        (!self.window.is_motion_in_sight() && is_settled) || self.may_be_late(coverage, health)
    }

    /// Whether samples or frames are missing before the newest frame, or shortly before: a stream may be late since.
    pub(super) fn may_be_late(&self, coverage: Coverage, health: &HealthBits) -> bool {
        let is_suspicious =
            self.window.frames.last().is_some_and(|newest| self.rotation.is_suspicious_at(newest.stamp));
        coverage.has_gap || health.contains(HealthBits::FRAME_GAP) || is_suspicious
    }

    /// Integrates the motions of the window that end after `since` anew, as far as their samples are kept.
    fn integrate_anew(&mut self, since: Timestamp) {
        for k in 1..self.window.frames.len() {
            let (before, frame) = (&self.window.frames[k - 1], &self.window.frames[k]);
            if frame.stamp <= since || frame.inertial.is_none() || !self.imu.reaches_back_to(before.stamp) {
                continue;
            }
            let (gyro, accel) = (&before.nav.bias_gyro, &before.nav.bias_accel);
            let (motion, _) = self.imu.preintegrate(before.stamp, frame.stamp, gyro, accel, &self.noise);
            self.window.replace_motion(k, motion);
        }
    }

    /// Mean angular rate between the two newest frames, rad/s in `B`.
    pub(super) fn turn_rate_b(&self) -> Vector3<f64> {
        let [.., before, newest] = &self.window.frames[..] else { return Vector3::zeros() };
        let dt_s = newest.stamp.seconds_since(before.stamp);
        log_so3(&(before.nav.rot_o_b.inverse() * newest.nav.rot_o_b)) / dt_s
    }

    /// The covariance of the newest frame, with what sensors that contradict each other may hide, and what vibration makes of
    /// its velocity.
    pub(super) fn stated_covariance(&self) -> NavCovariance {
        let Some(newest) = self.window.frames.last() else { return self.covariance };
        let added = self.rotation.added_covariance(&newest.nav, &self.turn_rate_b());
        let mut stated = added.map_or(self.covariance, |added| self.covariance + added);
        self.add_vibration(&mut stated, &newest.nav);
        stated
    }
}
