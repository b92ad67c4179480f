//! Sensors that fail without a word: what they say is not believed, and the estimate goes on with what is left.
//!
//! A sensor that repeats its readings is found by [`crate::inertial::stuck`], samples or images with late stamps by
//! [`super::rotation_watch`], forces that did not act by [`crate::window::trial`] and [`super::force_watch`]. The samples lose belief from the moment on at which it began: the motions between the
//! frames of the window since then are integrated anew, and the newest frame begins where its images place it.

use super::Odometer;
use super::force_watch::{ForceSigmas, SeenMotion};
use super::judgement::Velocity;
use super::rotation_watch::SeenTurn;
use crate::estimate::{BiasVariances, HealthBits, NavCovariance};
use crate::geometry::log_so3;
use crate::inertial::Unmeasured;
use crate::inertial::buffer::Coverage;
use crate::window::frame::Frame;
use crate::window::sighting::Sighting;
use crate::window::state::NavState;
use crate::window::trial::Trial;
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
        trial: Option<&Trial>,
        is_dropped: bool,
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
        let sighting = match trial {
            Some(trial) if !is_dropped => Some(trial.sighting),
            _ if self.rotation.is_distrusting() => self.window.sight_newest(&start),
            _ => self.window.sight_by_known(&start).or_else(|| self.window.sight_newest(&start)),
        };
        if sighting.is_none() {
            self.rotation.end_probation();
        }
        if let Some(sighting) = sighting.filter(|s| !stuck.gyro && self.is_witness(s, coverage, health))
            && let [.., before, newest] = &self.window.frames[..]
        {
            let since = self.rotation.update(&SeenTurn {
                span: [before.taken, newest.taken],
                stamps: [before.stamp, newest.stamp],
                rate_b: self.rate_b,
                time_sigma_s: self.stamp_errors.newest_variance().map(f64::sqrt),
                seen: log_so3(&(before.nav.rot_o_b.inverse() * sighting.rot_o_b)),
                covariance: sighting.rotation_covariance,
                bias_gyro: before.nav.bias_gyro,
                bias_sigma_rad_s: largest_sigma(&self.bias_variances, 0),
                skips_frames: health.contains(HealthBits::FRAME_GAP),
                skips_samples: coverage.has_gap,
                is_force_contradicted: self.forces.is_contradicted(),
            });
            if let Some(since) = since {
                self.imu.distrust(since);
            } else if !self.rotation.is_distrusting() {
                self.learn_stamp_errors(newest.stamp);
            }
        }
        let mut found = HealthBits::default();
        self.rotation.report(&mut found);
        health.insert(found);
        if found != HealthBits::default() {
            self.imu.convict();
        }
        match sighting {
            _ if self.rotation.is_distrusting() => {}
            // What was on probation has proved right.
            Some(_) => self.imu.acquit(),
            None => self.imu.trust(),
        }
        if let Some(since) = self.imu.take_revision() {
            self.integrate_anew(since);
        }
        if coverage.unmeasured.is_any() || self.rotation.is_distrusting() {
            match sighting {
                Some(sighting) => self.window.place_newest(&sighting),
                None => self.window.place_newest_at(start),
            }
        }
        self.judge_forces(sighting, trial, coverage, health);
    }

    /// Compares the forces that lead to the newest frame with where the images place it; those that they contradict hardly count.
    fn judge_forces(
        &mut self,
        sighting: Option<Sighting>,
        trial: Option<&Trial>,
        coverage: Coverage,
        health: &mut HealthBits,
    ) {
        let Some(newest) = self.window.frames.last() else { return };
        let is_judged = self.window.options.cameras > 1
            && self.velocity == Velocity::Known
            && !coverage.has_gap
            && !coverage.unmeasured.is_any()
            && !self.rotation.is_distrusting();
        // A contradiction that known landmarks began goes on with those that are there.
        let is_open = self.forces.is_contradicted();
        let is_by_forces = trial.is_none_or(Trial::is_by_forces);
        let may_witness =
            |s: &Sighting| is_open || (s.is_witness && is_by_forces && s.is_turn_of(&newest.nav));
        let witness = sighting.filter(|sighting| is_judged && may_witness(sighting));
        let found = match (witness, &self.window.frames[..]) {
            (Some(witness), [.., before, Frame { inertial: Some(inertial), .. }]) => {
                let seen = SeenMotion {
                    stamp: newest.taken,
                    moved: witness.p_o_b - before.nav.p_o_b,
                    covariance: witness.position_covariance,
                    rot_o_before: before.nav.rot_o_b,
                    motion: &inertial.motion,
                    v_o_b: before.nav.v_o_b,
                    stamp_sigma_s: self.time_sigma_s(),
                    blow_m_s2: trial.filter(|trial| trial.is_contradicted()).map(Trial::force_m_s2),
                };
                let sigmas = ForceSigmas {
                    noise: self.noise,
                    bias_m_s2: largest_sigma(&self.bias_variances, 3),
                    tilt_rad: self.tilt_sigma_rad(),
                };
                self.forces.update(&seen, &sigmas)
            }
            _ => self.forces.pass_over(newest.stamp),
        };
        if let (Some(gain), [.., before, newest]) = (self.forces.gain(), &self.window.frames[..]) {
            self.scale.add(&gain.felt, &gain.seen, newest.taken.seconds_since(before.taken));
        }
        if let Some(wrong) = found {
            self.window.doubt_forces(wrong.since, wrong.sigma_m_s2);
            if let Some(sighting) = sighting {
                self.window.place_newest(&sighting);
            }
        }
        if let (None, Some(trial), [.., before, _]) =
            (found, trial.filter(|trial| trial.is_doubtful()), &self.window.frames[..])
        {
            self.window.doubt_forces(before.stamp, trial.force_m_s2());
        }
        if self.forces.is_named() {
            health.insert(HealthBits::ACCEL_CONTRADICTED);
        }
        if self.scale.contradicted().is_some() {
            health.insert(HealthBits::SCALE_CONTRADICTED);
        }
    }

    /// True if a sighting is evidence against the gyroscope. It is none if too few landmarks are known, which may belong to a
    /// crowd, unless the gyroscope has been contradicted already, or a hole in a stream has just ended tracks.
    fn is_witness(&self, sighting: &Sighting, coverage: Coverage, health: &HealthBits) -> bool {
        sighting.is_witness || self.rotation.is_distrusting() || self.may_be_late(coverage, health)
    }

    /// True if samples or frames are missing before the newest frame, or shortly before: a stream may be late since.
    pub(super) fn may_be_late(&self, coverage: Coverage, health: &HealthBits) -> bool {
        let is_suspicious =
            self.window.frames.last().is_some_and(|newest| self.rotation.is_suspicious_at(newest.stamp));
        coverage.has_gap || health.contains(HealthBits::FRAME_GAP) || is_suspicious
    }

    /// Integrates the motions of the window that end after `since` anew, as far as their samples are kept.
    pub(super) fn integrate_anew(&mut self, since: Timestamp) {
        for k in 1..self.window.frames.len() {
            let (before, frame) = (&self.window.frames[k - 1], &self.window.frames[k]);
            if frame.stamp <= since || frame.inertial.is_none() || !self.imu.reaches_back_to(before.taken) {
                continue;
            }
            let (gyro, accel) = (&before.nav.bias_gyro, &before.nav.bias_accel);
            let (motion, _) = self.imu.preintegrate(before.taken, frame.taken, gyro, accel, &self.noise);
            self.window.replace_motion(k, motion);
        }
    }

    /// Mean angular rate between the two newest frames, rad/s in `B`.
    pub(super) fn turn_rate_b(&self) -> Vector3<f64> {
        let [.., before, newest] = &self.window.frames[..] else { return Vector3::zeros() };
        let dt_s = newest.taken.seconds_since(before.taken);
        log_so3(&(before.nav.rot_o_b.inverse() * newest.nav.rot_o_b)) / dt_s
    }

    /// The covariance of the newest frame, with what sensors that contradict each other may hide, and what vibration makes of
    /// its velocity.
    pub(super) fn stated_covariance(&self) -> NavCovariance {
        let Some(newest) = self.window.frames.last() else { return self.covariance };
        let added = self.rotation.added_covariance(&newest.nav, &self.turn_rate_b());
        let mut stated = added.map_or(self.covariance, |added| self.covariance + added);
        self.add_vibration(&mut stated, &newest.nav);
        if let Some((by_time, variance)) = self.uncertain_time() {
            stated += by_time * by_time.transpose() * variance;
        }
        let by_forces = [
            self.sudden_force.of_velocity(newest.stamp),
            self.stilled_force.of_velocity(newest.stamp),
            self.forces.of_velocity(newest.stamp),
        ];
        for of_velocity in by_forces.into_iter().flatten() {
            let mut view = stated.fixed_view_mut::<3, 3>(NavState::V, NavState::V);
            view += of_velocity;
        }
        stated
    }
}
