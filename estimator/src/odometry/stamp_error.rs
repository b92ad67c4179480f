//! The error of a frame's stamp, by how far its images are along the motion that the inertial samples predict.
//!
//! An image that was taken `e` after its stamp shows the vehicle where it is `e` later: with `d` the pose by the images less the predicted
//! one (turn in `B`, way in `O`), `J = [w; v]` the rates of both and `S` the covariance of the difference,
//!
//! ```text
//! d = J e + noise        I = J' S^-1 J        e = (J' S^-1 d + m / s²) / (I + 1 / s²)
//! ```
//!
//! Before the frame is seen, `e` is a slow part `m`, as of an exposure that follows the light, and jitter. Jitter is learnt by
//! [`super::stamp_noise`], the slow part by [`super::stamp_drift`]; while neither shows, stamps are taken as they are. A correction moves
//! the time of the frame's state, so that the motion between two states is that between their images, and nothing has to excuse it.
//!
//! A wrong gyroscope turns about other axes than the vehicle, or by more than a stamp can be off: then nothing is corrected.

use super::Odometer;
use super::innovation::Prediction;
use crate::geometry::{exp_so3, log_so3};
use crate::inertial::buffer::Coverage;
use crate::window::sighting::{LEAST_SIGHTING_M, Sighting, Votes, variance_along};
use crate::window::state::NavState;
use nalgebra::{Matrix3, SVector, UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};

/// A stamp is not further off than this, s.
const MOST_S: f64 = 0.012;
/// A correction is at most so many standard deviations of what was expected, or this, s.
const MOST_SIGMAS: f64 = 6.0;
const PLAUSIBLE_S: f64 = 4e-3;
/// What is left of a turn may be this, rad, and so many standard deviations.
const EXPLAINED_RAD: f64 = 1.5e-3;
const EXPLAINED_SIGMAS: f64 = 5.0;
/// Random walk of the slow part, s/√s: 3 ms within a second or two.
const WALK_S: f64 = 2e-3;
/// The slow part is pulled to zero in this time, s, as the time offset of the rig takes over what is constant.
const FORGETS_S: f64 = 20.0;
/// An error shows from this size on, s, where it is seen to the second number and so many standard deviations; jitter is then taken for the
/// last, s.
const SHOWS_S: f64 = 8e-4;
const TELLS_TO_BEGIN_S: f64 = 7e-4;
const SHOWS_SIGMAS: f64 = 5.0;
const FIRST_JITTER_S: f64 = 2.5e-3;
/// An error that is seen to this, s, tells the jitter; the gain by which it follows.
const TELLS_S: f64 = 5e-4;
const JITTER_GAIN: f64 = 0.15;
/// Corrections end where jitter and slow part are below this, s; until then jitter is not below the second.
const ENDS_S: f64 = 3e-4;
const LEAST_JITTER_S: f64 = 3e-4;
/// Share of the turn by which the scale of a gyroscope may be off.
const SCALE_SHARE: f64 = 3e-3;
/// Bias and velocity of a start are rough for so long, s.
const ROUGH_S: f64 = 0.5;
/// Shares of the landmarks: explained by the predicted pose alone at most, and by the sighted one at least.
const OTHERS_SHARE: f64 = 0.1;
const ALL_SHARE: f64 = 0.7;
/// Landmarks that have just come into view tell stamps from this rate on, rad/s.
const TURNS_RAD_S: f64 = 1.0;
/// Least time between two states, s.
const LEAST_STEP_S: f64 = 5e-3;

/// Time of an image after its stamp, s, with its variance, s².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct TimeError {
    pub(super) value: f64,
    pub(super) variance: f64,
}

impl TimeError {
    /// This error and an independent sight of the same one.
    fn combined(&self, other: &Self) -> Self {
        let information = 1.0 / self.variance + 1.0 / other.variance;
        let value = (self.value / self.variance + other.value / other.variance) / information;
        Self { value, variance: 1.0 / information }
    }
}

/// Errors of stamps: the slow part, the jitter, and that of the newest frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StampErrors {
    /// Slow part, s, and when it was that.
    slow: TimeError,
    at: Option<Timestamp>,
    /// Variance of the jitter, s²; 0 while stamps are taken as they are.
    jitter_variance: f64,
    /// Variance of the time of the newest state, s².
    newest_variance: f64,
}

impl StampErrors {
    /// True while stamps are corrected.
    fn is_active(&self) -> bool {
        self.jitter_variance > 0.0
    }

    /// Variance of the time of the newest state, s²; `None` while stamps are not corrected.
    pub(super) fn newest_variance(&self) -> Option<f64> {
        self.is_active().then_some(self.newest_variance)
    }

    /// Begins to correct stamps, which are off by `slow` and by jitter of `jitter_s`.
    fn begin(&mut self, stamp: Timestamp, slow: TimeError, jitter_s: f64) {
        *self = Self { slow, at: Some(stamp), jitter_variance: jitter_s.squared(), newest_variance: 0.0 };
    }

    /// The error of the frame of `stamp` before it is seen; that of any frame while stamps are taken as they are.
    fn expect(&mut self, stamp: Timestamp) -> TimeError {
        if !self.is_active() {
            return TimeError { value: 0.0, variance: FIRST_JITTER_S.squared() };
        }
        let dt_s = self.at.map_or(0.0, |at| stamp.seconds_since(at)).clamp(0.0, FORGETS_S);
        let kept = 1.0 - dt_s / FORGETS_S;
        self.slow.value *= kept;
        self.slow.variance = self.slow.variance * kept.squared() + WALK_S.squared() * dt_s;
        self.at = Some(stamp);
        TimeError { value: self.slow.value, variance: self.slow.variance + self.jitter_variance }
    }

    /// Takes the error that was seen, with the variance of the sight alone; ends the corrections where errors are small.
    fn add(&mut self, seen: TimeError) {
        let off = seen.value - self.slow.value;
        if seen.variance < TELLS_S.squared() {
            let jitter = (off.squared() - seen.variance - self.slow.variance).at_least(0.0);
            self.jitter_variance += JITTER_GAIN * (jitter - self.jitter_variance);
        }
        let noise = seen.variance + self.jitter_variance;
        let gain = self.slow.variance / (self.slow.variance + noise);
        self.slow.value += gain * off;
        self.slow.variance *= 1.0 - gain;
        if self.jitter_variance < ENDS_S.squared() && self.slow.value.abs() < ENDS_S {
            self.jitter_variance = 0.0;
        } else {
            self.jitter_variance = self.jitter_variance.at_least(LEAST_JITTER_S.squared());
        }
    }
}

/// Rates of a state along which an error of its stamp moves it: angular rate in `B`, velocity and acceleration in `O`.
#[derive(Clone, Copy, Debug)]
struct Rates {
    rate_b: Vector3<f64>,
    v_o: Vector3<f64>,
    accel_o: Vector3<f64>,
}

impl Rates {
    /// The state `dt_s` later.
    fn carried(&self, nav: &NavState, dt_s: f64) -> NavState {
        let rot_o_b = nav.rot_o_b * exp_so3(&(self.rate_b * dt_s));
        NavState {
            p_o_b: nav.p_o_b + self.v_o * dt_s,
            rot_o_b: UnitQuaternion::new_normalize(rot_o_b.into_inner()),
            v_o_b: nav.v_o_b + self.accel_o * dt_s,
            ..nav.clone()
        }
    }

    /// Derivative of position, attitude and velocity by time.
    fn derivative(&self) -> SVector<f64, 9> {
        let mut by_time = SVector::<f64, 9>::zeros();
        by_time.fixed_rows_mut::<3>(NavState::P).copy_from(&self.v_o);
        by_time.fixed_rows_mut::<3>(NavState::ROT).copy_from(&self.rate_b);
        by_time.fixed_rows_mut::<3>(NavState::V).copy_from(&self.accel_o);
        by_time
    }
}

impl Odometer {
    /// Puts the newest frame at the time at which its images were taken, as far as they show it; returns the prediction of that time, and
    /// the frame's pose by known landmarks if it was looked for.
    pub(super) fn correct_stamp(
        &mut self,
        prediction: Prediction,
        coverage: Coverage,
    ) -> (Prediction, Option<Sighting>) {
        let Some(stamp) = self.window.frames.last().map(|newest| newest.stamp) else {
            return (prediction, None);
        };
        let expected = self.stamp_errors.expect(stamp);
        let is_active = self.stamp_errors.is_active();
        let before_variance = if is_active {
            std::mem::replace(&mut self.stamp_errors.newest_variance, expected.variance)
        } else {
            0.0
        };
        let is_measured = self.window.options.cameras > 1
            && self.window.options.correct_stamps
            && !coverage.has_gap
            && !coverage.unmeasured.is_any()
            && !self.rotation.is_distrusting();
        // What moves pulls a sighting along as an error of the stamp would.
        let may_begin = !is_active && !self.window.is_motion_in_sight() && !self.forces.is_contradicted();
        if !is_measured {
            return (prediction, None);
        }
        let prediction = match is_active {
            true => self.put_newest_at(expected.value, prediction, before_variance + expected.variance),
            false => prediction,
        };
        let known = self.window.sight_by_known(&prediction.nav);
        let turns = self.rate_b.norm() > TURNS_RAD_S;
        let sighting = match known {
            None if is_active || turns => self.window.sight_newest(&prediction.nav),
            known => known,
        };
        if may_begin && sighting.is_some_and(|s| self.is_start_rough(stamp, &prediction, &s)) {
            self.begin_correction(stamp);
            return (self.put_newest_at(0.0, prediction, 2.0 * FIRST_JITTER_S.squared()), known);
        }
        let error = sighting.and_then(|sighting| {
            self.found_error(expected, &prediction, &sighting, before_variance).map(|seen| (sighting, seen))
        });
        let Some((sighting, seen)) = error else { return (prediction, known) };
        if is_active && seen.value.abs() > SHOWS_S && !self.is_of_all(&prediction.nav, &sighting) {
            return (prediction, known);
        }
        if !is_active {
            let shows = seen.variance < TELLS_TO_BEGIN_S.squared()
                && seen.value.abs() > SHOWS_S
                && seen.value.squared() > SHOWS_SIGMAS.squared() * seen.variance;
            if !shows || !may_begin || !self.is_of_all(&prediction.nav, &sighting) {
                return (prediction, known);
            }
            self.begin_correction(stamp);
        }
        let combined = expected.combined(&seen);
        let prediction = self.put_newest_at(combined.value, prediction, before_variance + combined.variance);
        // The rates change on the way.
        let seen = self.found_error(combined, &prediction, &sighting, before_variance).unwrap_or(seen);
        let combined = expected.combined(&seen);
        let prediction = self.put_newest_at(combined.value, prediction, before_variance + combined.variance);
        self.stamp_errors.newest_variance = combined.variance;
        self.stamp_errors.add(seen);
        (prediction, known)
    }

    /// True if `sighting` is that of nearly all landmarks it rests on: an error of the stamp moves all of them alike, and a crowd leaves the
    /// others at the predicted state `nav`.
    fn is_of_all(&self, nav: &NavState, sighting: &Sighting) -> bool {
        let Votes { predicted, sighted, both, all } = self.window.votes(nav, sighting, 1.0);
        let of = |count: usize| count as f64 / all.max(1) as f64;
        of(predicted) <= OTHERS_SHARE && of(sighted + both) >= ALL_SHARE
    }

    /// [`Self::seen_error`] where it is no larger than errors of stamps are, the state having been predicted for an error of `assumed`.
    fn found_error(
        &self,
        assumed: TimeError,
        prediction: &Prediction,
        sighting: &Sighting,
        before_variance: f64,
    ) -> Option<TimeError> {
        let seen = self.seen_error(assumed.value, prediction, sighting, before_variance)?;
        let off = (seen.value - assumed.value).abs();
        let most = (MOST_SIGMAS * (seen.variance + assumed.variance).sqrt()).at_least(PLAUSIBLE_S);
        (off <= most && seen.value.abs() <= MOST_S).then_some(seen)
    }

    /// The error of the newest stamp as `sighting` shows it, with the variance of that sight, where the state was predicted for an error
    /// of `assumed_s`; `None` where no error of a stamp explains the turn.
    fn seen_error(
        &self,
        assumed_s: f64,
        prediction: &Prediction,
        sighting: &Sighting,
        before_variance: f64,
    ) -> Option<TimeError> {
        let nav = &prediction.nav;
        let rates = self.rates_of(nav);
        let turn = log_so3(&(nav.rot_o_b.inverse() * sighting.rot_o_b));
        let way = sighting.p_o_b - nav.p_o_b;
        let dt_s = prediction.dt_s;
        let gyro = (self.noise.gyro_density.squared() * dt_s)
            + self.bias_variances.fixed_rows::<3>(0).max() * dt_s.squared();
        let velocity = prediction.velocity_sigma_m_s()? * dt_s;
        // An error of the time before moves the prediction along the way of that time.
        let before = self.window.frames.len().checked_sub(2).and_then(|k| self.window.frames.get(k))?;
        let along = |rate: &Vector3<f64>| rate * rate.transpose() * before_variance;
        let turned = rates.rate_b * (SCALE_SHARE * dt_s);
        let of_turn = sighting.rotation_covariance
            + Matrix3::identity() * gyro
            + along(&before.rate_b())
            + turned * turned.transpose();
        let least = LEAST_SIGHTING_M.squared() + velocity.squared();
        let of_way = sighting.position_covariance + Matrix3::identity() * least + along(&before.nav.v_o_b);
        let by_turn = of_turn.try_inverse()?;
        // A force that did not act moves the prediction too.
        let tells_way = !self.forces.is_contradicted()
            && self.sudden_force.moved_m(self.window.frames.last()?.stamp, dt_s).is_none();
        let by_way = if tells_way { of_way.try_inverse()? } else { Matrix3::zeros() };
        let information = rates.rate_b.dot(&(by_turn * rates.rate_b)) + rates.v_o.dot(&(by_way * rates.v_o));
        let score = rates.rate_b.dot(&(by_turn * turn)) + rates.v_o.dot(&(by_way * way));
        let error_s = score / information.at_least(1.0);
        let left = turn - rates.rate_b * error_s;
        let variance = variance_along(&of_turn, &left);
        let is_explained =
            left.norm_squared() <= EXPLAINED_RAD.squared() + EXPLAINED_SIGMAS.squared() * variance;
        is_explained
            .then(|| TimeError { value: assumed_s + error_s, variance: 1.0 / information.at_least(1.0) })
    }

    /// Puts the newest frame `error_s` after its stamp, where the samples predict it.
    fn put_newest_at(&mut self, error_s: f64, prediction: Prediction, variance: f64) -> Prediction {
        let [.., before, newest] = &self.window.frames[..] else { return prediction };
        let earliest = before.taken.plus_seconds(LEAST_STEP_S);
        let taken = newest.stamp.plus_seconds(error_s).max(earliest);
        let (from, last) = (before.taken, before.nav.clone());
        let (gyro, accel) = (&last.bias_gyro, &last.bias_accel);
        let (motion, coverage) = self.imu.preintegrate(from, taken, gyro, accel, &self.noise);
        if coverage.has_gap {
            return prediction;
        }
        let motion = self.with_uncertain_ends(motion, &last, &self.rate_b, variance);
        let prediction = self.predict(&last, &motion);
        self.window.put_newest_at(taken, prediction.nav.clone(), motion);
        prediction
    }

    /// Begins to correct stamps if turns of frames on end have shown jitter, or a slow part.
    pub(super) fn learn_stamp_errors(&mut self, stamp: Timestamp) {
        let (jitter_s, drift) = (self.rotation.stamp_sigma_s(), self.rotation.stamp_drift());
        if self.stamp_errors.is_active()
            || !self.window.options.correct_stamps
            || (jitter_s == 0.0 && drift.is_none())
        {
            return;
        }
        let slow = drift.unwrap_or(TimeError { value: 0.0, variance: WALK_S.squared() });
        self.stamp_errors.begin(stamp, slow, jitter_s.at_least(SHOWS_S));
        if slow.value != 0.0 {
            self.shift_times(slow.value);
        }
    }

    /// Moves the states of the window to `by_s` after the stamps of their frames, and integrates the motions between them anew.
    fn shift_times(&mut self, by_s: f64) {
        let since = self.window.frames.first().map(|first| first.taken.min(first.stamp).plus_nanos(-1));
        for frame in &mut self.window.frames {
            frame.taken = frame.stamp.plus_seconds(by_s);
        }
        self.rotation.forget_differences();
        if let Some(since) = since {
            self.integrate_anew(since);
        }
    }

    /// Begins to correct stamps; the motions of the window took them for exact.
    fn begin_correction(&mut self, stamp: Timestamp) {
        let slow = TimeError { value: 0.0, variance: WALK_S.squared() };
        self.stamp_errors.begin(stamp, slow, FIRST_JITTER_S);
        self.stamp_errors.newest_variance = FIRST_JITTER_S.squared();
        self.take_times_for_uncertain(2.0 * FIRST_JITTER_S.squared());
    }

    /// True if the images turn otherwise than predicted shortly after a start, which knows bias and velocity by a few frames: errors of
    /// their stamps are in both.
    fn is_start_rough(&self, stamp: Timestamp, prediction: &Prediction, sighting: &Sighting) -> bool {
        let turn = log_so3(&(prediction.nav.rot_o_b.inverse() * sighting.rot_o_b));
        let bias = self.bias_variances.fixed_rows::<3>(0).max() * prediction.dt_s.squared();
        let variance = variance_along(&sighting.rotation_covariance, &turn) + bias;
        self.begun.is_some_and(|begun| stamp.seconds_since(begun) < ROUGH_S)
            && turn.norm_squared() > EXPLAINED_RAD.squared() + EXPLAINED_SIGMAS.squared() * variance
    }

    /// Integrates the motions of the window anew, as between times that are uncertain by `variance`, s²: so far they were taken for exact.
    fn take_times_for_uncertain(&mut self, variance: f64) {
        for k in 1..self.window.frames.len() {
            let (before, frame) = (&self.window.frames[k - 1], &self.window.frames[k]);
            if frame.inertial.is_none() || !self.imu.reaches_back_to(before.taken) {
                continue;
            }
            let (from, gyro, accel) = (before.nav.clone(), &before.nav.bias_gyro, &before.nav.bias_accel);
            let (motion, _) = self.imu.preintegrate(before.taken, frame.taken, gyro, accel, &self.noise);
            let rate_b = log_so3(&motion.delta_rot) / motion.dt_s;
            let motion = self.with_uncertain_ends(motion, &from, &rate_b, variance);
            self.window.replace_motion(k, motion);
        }
    }

    /// Rates of the newest frame in the state `nav`.
    fn rates_of(&self, nav: &NavState) -> Rates {
        let Some(newest) = self.window.frames.last() else {
            let zero = Vector3::zeros();
            return Rates { rate_b: zero, v_o: zero, accel_o: zero };
        };
        let taken = newest.taken;
        let mean =
            self.imu.mean(taken.plus_seconds(-super::RATE_SPAN_S), taken.plus_seconds(super::RATE_SPAN_S));
        let (gyro, accel) = mean.unwrap_or((self.rate_b + nav.bias_gyro, Vector3::zeros()));
        let accel_o = match mean {
            Some(_) => nav.rot_o_b * (accel - nav.bias_accel) + self.window.options.gravity_o,
            None => Vector3::zeros(),
        };
        Rates { rate_b: gyro - nav.bias_gyro, v_o: nav.v_o_b, accel_o }
    }

    /// The newest state at the stamp of its frame.
    pub(super) fn nav_at_stamp(&self) -> NavState {
        let Some(newest) = self.window.frames.last() else { return NavState::default() };
        if newest.taken == newest.stamp {
            return newest.nav.clone();
        }
        self.rates_of(&newest.nav).carried(&newest.nav, newest.stamp.seconds_since(newest.taken))
    }

    /// Derivative by time of the newest state, and the variance of its time, s²; `None` while stamps are not corrected.
    pub(super) fn uncertain_time(&self) -> Option<(SVector<f64, 9>, f64)> {
        let variance = self.stamp_errors.newest_variance()?;
        let newest = self.window.frames.last()?;
        Some((self.rates_of(&newest.nav).derivative(), variance))
    }

    /// Standard deviation of the time of a state, s, as far as errors of stamps show.
    pub(super) fn time_sigma_s(&self) -> f64 {
        self.stamp_errors.newest_variance().map_or_else(|| self.rotation.stamp_sigma_s(), f64::sqrt)
    }
}

#[cfg(test)]
#[path = "stamp_error_tests.rs"]
mod tests;
