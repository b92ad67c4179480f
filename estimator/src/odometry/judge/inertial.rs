//! Sensors that fail without a word: what they say is not believed, and the estimate goes on with what is left.
//!
//! A sensor that repeats its readings is found by [`crate::inertial::stuck`], samples or images with late stamps by
//! [`super::gyroscope`], forces that did not act by [`crate::window::trial`] and [`super::force_watch`]. The samples lose belief from the
//! moment on at which it began: the motions between the frames of the window since then are integrated anew, and the newest frame begins
//! where its images place it.

use super::force_watch::{ForceSigmas, SeenMotion};
use super::gyroscope::SeenTurn;
use super::trial::Tried;
use super::turn_by_images::TurnByImages;
use super::{Case, Judge};
use crate::estimate::HealthBits;
use crate::geometry::exp_so3;
use crate::inertial::Unmeasured;
use crate::inertial::buffer::Coverage;
use crate::odometry::estimation::Estimation;
use crate::window::Window;
use crate::window::frame::Frame;
use crate::window::sighting::Sighting;
use crate::window::state::NavState;
use crate::window::trial::Trial;

/// Reports stuck sensors in `health`; returns whether there are any.
pub(in crate::odometry) fn report_stuck(stuck: Unmeasured, health: &mut HealthBits) -> bool {
    for (is_stuck, bit) in [(stuck.gyro, HealthBits::GYRO_STUCK), (stuck.accel, HealthBits::ACCEL_STUCK)] {
        if is_stuck {
            health.insert(bit);
        }
    }
    stuck.is_any()
}

/// The state from which the pose of the newest frame is looked for; that of a steady motion where a sensor did not measure.
fn expected(window: &Window, coverage: Coverage) -> Option<NavState> {
    let newest = window.frames.last()?;
    let steady = if coverage.unmeasured.is_any() { window.steady_newest() } else { None };
    Some(steady.unwrap_or_else(|| newest.nav.clone()))
}

/// Puts the newest frame at `start`, turned from the frame before as the images say.
fn place_turned(window: &mut Window, start: NavState, turn: &TurnByImages) {
    if let [.., before, _] = &window.frames[..] {
        let rot_o_b = before.nav.rot_o_b * exp_so3(&turn.seen);
        window.place_newest_at(NavState { rot_o_b, ..start });
    }
}

impl Judge {
    /// Judges the inertial samples that lead to the newest frame by what that sees.
    pub(super) fn judge_samples(&mut self, estimation: &mut Estimation, tried: &Tried, case: &mut Case<'_>) {
        let (stuck, coverage) = (estimation.imu.stuck(), case.coverage);
        let were_believed = !self.gyroscope.is_distrusting();
        report_stuck(stuck, case.health);
        if stuck.gyro {
            // Its name is known.
            self.gyroscope.forget_turns();
        }
        let Some(start) = expected(&estimation.window, coverage) else { return };
        let sighting = self.sight(&estimation.window, tried, &start);
        if sighting.is_none() {
            self.gyroscope.end_probation();
        }
        let turn = self.turn_by_images(estimation, sighting.as_ref(), tried, case);
        if let Some(turn) = turn.filter(|_| !stuck.gyro) {
            self.judge_turn(estimation, &turn, case);
        }
        if self.gyroscope.is_distrusting() {
            self.tracking.note_distrust(case.stamp, were_believed, self.gyroscope.is_carried());
        }
        self.settle_belief(estimation, sighting.is_some(), case.health);
        if coverage.unmeasured.is_any() || self.gyroscope.is_distrusting() {
            match (&sighting, turn.filter(|turn| turn.is_by_corners)) {
                (_, Some(turn)) => place_turned(&mut estimation.window, start, &turn),
                (Some(sighting), None) => estimation.window.place_newest(sighting),
                (None, None) => estimation.window.place_newest_at(start),
            }
        }
        self.judge_forces(estimation, sighting, tried.trial.as_ref(), coverage);
        if self.forces.is_named() || self.unfelt_force.is_contradicted() {
            case.health.insert(HealthBits::ACCEL_CONTRADICTED);
        }
        if estimation.window.is_rig_refuted() {
            case.health.insert(HealthBits::SCALE_CONTRADICTED);
        }
    }

    /// The pose of the newest frame by its images: that of the trial, unless what moves has been dropped since.
    fn sight(&self, window: &Window, tried: &Tried, start: &NavState) -> Option<Sighting> {
        match &tried.trial {
            Some(trial) if !tried.has_dropped => Some(trial.sighting),
            _ if self.gyroscope.is_distrusting() => window.sight_newest(start),
            _ => window.sight_by_known(start).or_else(|| window.sight_newest(start)),
        }
    }

    /// The turn of the newest frame that is evidence against the gyroscope: that of known landmarks, unless corners contradict it.
    fn turn_by_images(
        &self,
        estimation: &Estimation,
        sighting: Option<&Sighting>,
        tried: &Tried,
        case: &Case<'_>,
    ) -> Option<TurnByImages> {
        let window = &estimation.window;
        let by_landmarks = sighting
            .filter(|sighting| self.is_witness(window, sighting, case))
            .and_then(|sighting| TurnByImages::of_landmarks(window, sighting, tried.trial.as_ref()));
        // What moves in view may have corners of its own.
        let by_corners =
            estimation.turn.filter(|_| !window.is_motion_in_sight()).as_ref().map(TurnByImages::of_corners);
        match (by_corners, by_landmarks) {
            (Some(corners), Some(landmarks)) if !landmarks.is_turn_of(&corners) => Some(corners),
            (corners, landmarks) => landmarks.or(corners),
        }
    }

    /// Compares the turn of the newest frame by its images with the gyroscope; samples that they contradict lose belief, and where they agree,
    /// errors of stamps are learnt.
    fn judge_turn(&mut self, estimation: &mut Estimation, turn: &TurnByImages, case: &Case<'_>) {
        let [.., before, newest] = &estimation.window.frames[..] else { return };
        let [bias_sigma_rad_s, _] = estimation.bias_sigmas();
        let since = self.gyroscope.update(&SeenTurn {
            span: [before.taken, newest.taken],
            stamps: [before.stamp, newest.stamp],
            time_sigma_s: self.stamps.newest_variance().map(f64::sqrt),
            rot_o_b: (!turn.is_by_corners).then(|| before.nav.rot_o_b * exp_so3(&turn.seen)),
            seen: turn.seen,
            covariance: turn.covariance,
            agreeing_share: turn.agreeing_share,
            speed_m_s: before.nav.v_o_b.norm(),
            bias_gyro: before.nav.bias_gyro,
            bias_sigma_rad_s,
            skips_samples: case.coverage.has_gap,
            is_force_contradicted: self.forces.is_contradicted(),
            is_voted: turn.is_voted,
        });
        if let Some(since) = since {
            estimation.imu.distrust(since);
        }
    }

    /// Reports what was found, and believes samples accordingly: motions whose samples have lost or regained belief are integrated anew.
    fn settle_belief(&self, estimation: &mut Estimation, is_sighted: bool, health: &mut HealthBits) {
        let mut found = HealthBits::default();
        self.gyroscope.report(&mut found);
        health.insert(found);
        if found != HealthBits::default() {
            estimation.imu.convict();
        }
        match is_sighted {
            _ if self.gyroscope.is_distrusting() => {}
            // What was on probation has proved right.
            true => estimation.imu.acquit(),
            false => estimation.imu.trust(),
        }
        if let Some(since) = estimation.imu.take_revision() {
            estimation.integrate_anew(since, 0.0);
        }
    }

    /// Compares the forces that lead to the newest frame with where the images place it; those that they contradict hardly count.
    fn judge_forces(
        &mut self,
        estimation: &mut Estimation,
        sighting: Option<Sighting>,
        trial: Option<&Trial>,
        coverage: Coverage,
    ) {
        let Some(newest) = estimation.window.frames.last() else { return };
        let is_judged =
            self.tracking.is_velocity_known() && coverage.is_measured() && !self.gyroscope.is_distrusting();
        // A contradiction that known landmarks began goes on with those that are there.
        let is_open = self.forces.is_contradicted();
        let may_witness = |s: &Sighting| is_open || (s.is_witness && s.is_turn_of(&newest.nav));
        let witness = sighting.filter(|sighting| is_judged && may_witness(sighting));
        let found = match (witness, &estimation.window.frames[..]) {
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
                    noise: estimation.window.imu_noise,
                    bias_m_s2: estimation.bias_sigmas()[1],
                    tilt_rad: estimation.tilt_sigma_rad(),
                };
                self.forces.update(&seen, &sigmas)
            }
            _ => self.forces.pass_over(newest.stamp),
        };
        let gain = self.forces.gain();
        if gain.is_none() {
            self.unfelt_force.pass_over();
        }
        if let (Some(gain), [.., before, newest]) = (gain, &estimation.window.frames[..]) {
            let dt_s = newest.taken.seconds_since(before.taken);
            self.unfelt_force.add(&gain, dt_s);
        }
        if let Some(wrong) = found {
            estimation.window.doubt_forces(wrong.since, wrong.sigma_m_s2);
            if let Some(sighting) = sighting {
                estimation.window.place_newest(&sighting);
            }
        } else if let (Some(trial), [.., before, _]) =
            (trial.filter(|trial| trial.is_doubtful()), &estimation.window.frames[..])
        {
            let since = before.stamp;
            estimation.window.doubt_forces(since, trial.force_m_s2());
        }
    }

    /// True if a sighting is evidence against the gyroscope. It is none if too few landmarks are known, which may belong to a
    /// crowd, unless the gyroscope has been contradicted already, or a hole in a stream has just ended tracks.
    fn is_witness(&self, window: &Window, sighting: &Sighting, case: &Case<'_>) -> bool {
        sighting.is_witness || self.gyroscope.is_distrusting() || self.may_be_late(window, case)
    }

    /// True if samples or frames are missing before the newest frame, or shortly before: a stream may be late since.
    pub(super) fn may_be_late(&self, window: &Window, case: &Case<'_>) -> bool {
        let is_suspicious =
            window.frames.last().is_some_and(|newest| self.gyroscope.is_suspicious_at(newest.stamp));
        case.coverage.has_gap || case.health.contains(HealthBits::FRAME_GAP) || is_suspicious
    }
}
