//! The time at which the images of the newest frame were taken, found and given to its state.

use super::super::SHOWS_S;
use super::super::noise::{NoiseScale, Prediction};
use super::super::sudden_force::SuddenForce;
use super::noise::MOST_S;
use super::{FIRST_JITTER_S, StampErrors, TELLS_TO_BEGIN_S, TimeError};
use crate::geometry::log_so3;
use crate::inertial::buffer::Coverage;
use crate::odometry::estimation::Estimation;
use crate::window::sighting::{LEAST_SIGHTING_M, Sighting, variance_along};
use crate::window::trial::{CONTRADICTS_SIGMAS, SAME_TURN_RAD};
use nalgebra::{Matrix3, Vector3};
use plumbline_config::{Portable, Timestamp};

/// A correction is at most so many standard deviations of what was expected, or this, s.
const MOST_SIGMAS: f64 = 6.0;
const PLAUSIBLE_S: f64 = 4e-3;
/// Share of the turn by which the scale of a gyroscope may be off.
const SCALE_SHARE: f64 = 3e-3;
/// Bias and velocity of a start are rough for so long, s.
const ROUGH_S: f64 = 0.5;
/// Landmarks that have just come into view tell stamps from this rate on, rad/s.
const TURNS_RAD_S: f64 = 1.0;
/// Least time between two states, s.
const LEAST_STEP_S: f64 = 5e-3;

/// A frame whose stamp is judged, and what is known besides.
pub(in crate::odometry::judge) struct Correction<'a> {
    /// Errors of stamps so far.
    pub(in crate::odometry::judge) errors: &'a mut StampErrors,
    /// The estimation whose newest frame is judged.
    pub(in crate::odometry::judge) estimation: &'a mut Estimation,
    /// By which predictions are as uncertain as they are.
    pub(in crate::odometry::judge) noise: &'a NoiseScale,
    /// Forces that no image has confirmed.
    pub(in crate::odometry::judge) sudden_force: &'a SuddenForce,
    /// When the estimate began.
    pub(in crate::odometry::judge) begun: Option<Timestamp>,
    /// True if inertial samples are not believed.
    pub(in crate::odometry::judge) is_distrusting: bool,
    /// True if the forces are contradicted.
    pub(in crate::odometry::judge) is_force_contradicted: bool,
}

impl Correction<'_> {
    /// Puts the newest frame at the time at which its images were taken, as far as they show it; returns the prediction of that time, and
    /// the frame's pose by known landmarks if it was looked for.
    pub(in crate::odometry::judge) fn correct(
        &mut self,
        prediction: Prediction,
        coverage: Coverage,
    ) -> (Prediction, Option<Sighting>) {
        let Some(stamp) = self.estimation.window.frames.last().map(|newest| newest.stamp) else {
            return (prediction, None);
        };
        let expected = self.errors.expect(stamp);
        let is_active = self.errors.is_active();
        let before_variance = if is_active {
            std::mem::replace(&mut self.errors.newest_variance, expected.variance)
        } else {
            0.0
        };
        let is_measured = self.estimation.window.options.cameras > 1
            && self.estimation.window.options.correct_stamps
            && coverage.is_measured()
            && !self.is_distrusting;
        // What moves pulls a sighting along as an error of the stamp would.
        let may_begin =
            !is_active && !self.estimation.window.is_motion_in_sight() && !self.is_force_contradicted;
        if !is_measured {
            return (prediction, None);
        }
        let prediction = match is_active {
            true => self.put_newest_at(expected.value, prediction, before_variance + expected.variance),
            false => prediction,
        };
        let known = self.estimation.window.sight_by_known(&prediction.nav);
        let turns = self.estimation.rate_b.norm() > TURNS_RAD_S;
        let sighting = match known {
            None if is_active || turns => self.estimation.window.sight_newest(&prediction.nav),
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
        if !is_active {
            let shows = seen.variance < TELLS_TO_BEGIN_S.squared()
                && seen.value.abs() > SHOWS_S
                && seen.value.squared() > CONTRADICTS_SIGMAS.squared() * seen.variance;
            if !shows || !may_begin {
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
        self.errors.newest_variance = combined.variance;
        self.errors.add(seen);
        (prediction, known)
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
        let rates = self.estimation.rates_of(nav);
        let turn = log_so3(&(nav.rot_o_b.inverse() * sighting.rot_o_b));
        let way = sighting.p_o_b - nav.p_o_b;
        let dt_s = prediction.dt_s;
        let gyro = (self.estimation.window.imu_noise.gyro_density.squared() * dt_s)
            + self.estimation.bias_variances.fixed_rows::<3>(0).max() * dt_s.squared();
        let velocity = prediction.velocity_sigma_m_s()? * dt_s;
        // An error of the time before moves the prediction along the way of that time.
        let [.., before, newest] = &self.estimation.window.frames[..] else { return None };
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
        let tells_way =
            !self.is_force_contradicted && self.sudden_force.moved_m(newest.stamp, dt_s).is_none();
        let by_way = if tells_way { of_way.try_inverse()? } else { Matrix3::zeros() };
        let information = rates.rate_b.dot(&(by_turn * rates.rate_b)) + rates.v_o.dot(&(by_way * rates.v_o));
        let score = rates.rate_b.dot(&(by_turn * turn)) + rates.v_o.dot(&(by_way * way));
        let error_s = score / information.at_least(1.0);
        let left = turn - rates.rate_b * error_s;
        let variance = variance_along(&of_turn, &left);
        let is_explained =
            left.norm_squared() <= SAME_TURN_RAD.squared() + CONTRADICTS_SIGMAS.squared() * variance;
        is_explained
            .then(|| TimeError { value: assumed_s + error_s, variance: 1.0 / information.at_least(1.0) })
    }

    /// Puts the newest frame `error_s` after its stamp, where the samples predict it.
    fn put_newest_at(&mut self, error_s: f64, prediction: Prediction, variance: f64) -> Prediction {
        let [.., before, newest] = &self.estimation.window.frames[..] else { return prediction };
        let earliest = before.taken.plus_seconds(LEAST_STEP_S);
        let taken = newest.stamp.plus_seconds(error_s).max(earliest);
        let last = before.nav.clone();
        let (motion, coverage) = self.estimation.preintegrate([before.taken, taken], &last.biases());
        if coverage.has_gap {
            return prediction;
        }
        let motion = self.estimation.with_uncertain_ends(motion, &last, &self.estimation.rate_b, variance);
        let prediction = self.noise.predict(&self.estimation.window, &last, &motion);
        self.estimation.window.put_newest_at(taken, prediction.nav.clone(), motion);
        prediction
    }

    /// Begins to correct stamps.
    fn begin_correction(&mut self, stamp: Timestamp) {
        self.errors.begin(stamp, FIRST_JITTER_S);
        self.errors.newest_variance = FIRST_JITTER_S.squared();
        // The motions of the window took them for exact.
        let since = self.estimation.window.frames.first().map_or(stamp, |first| first.stamp);
        self.estimation.integrate_anew(since, 2.0 * FIRST_JITTER_S.squared());
    }

    /// True if the images turn otherwise than predicted shortly after a start, which knows bias and velocity by a few frames: errors of
    /// their stamps are in both.
    fn is_start_rough(&self, stamp: Timestamp, prediction: &Prediction, sighting: &Sighting) -> bool {
        let turn = log_so3(&(prediction.nav.rot_o_b.inverse() * sighting.rot_o_b));
        let bias = self.estimation.bias_variances.fixed_rows::<3>(0).max() * prediction.dt_s.squared();
        let variance = variance_along(&sighting.rotation_covariance, &turn) + bias;
        self.begun.is_some_and(|begun| stamp.seconds_since(begun) < ROUGH_S)
            && turn.norm_squared() > SAME_TURN_RAD.squared() + CONTRADICTS_SIGMAS.squared() * variance
    }
}
