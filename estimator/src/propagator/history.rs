//! State at any instant of the last seconds: of a camera's trigger, a payload, a sensor of others.
//!
//! The estimates that took effect on the odometry are kept, with the inertial samples between them. The state at an instant is
//! that of the last estimate before it, carried there by the samples. Once there is an estimate after it too, what that one
//! corrects is shared out over the time between both, so that answers to successive instants form a path without steps: at
//! the share `a` of the way the state takes `a e` of the correction `e`, and the covariance is that of a mixture,
//! `(1 - a) P + a P' + a (1 - a) e e'`. Across a reset nothing is shared out.
//!
//! These are estimates, not what was published: the odometry takes up corrections at a bounded rate ([`super::blend`]).

use super::STALE_S;
use super::carry::{Base, Carrier, between};
use crate::estimate::{NavCovariance, TrackingState};
use crate::inertial::BelievedSample;
use crate::window::state::{FRAME_DIM, NavState};
use nalgebra::{Isometry3, SVector, Vector3};
use plumbline_config::{Timestamp, ValidSetup};
use std::collections::VecDeque;

/// Instants of the last seconds are answered, s.
pub const HISTORY_S: f64 = 3.0;
/// While no estimates come, the state is kept again after so long, s: the work on an answer is bounded.
const MARK_S: f64 = 0.25;
/// Estimates may come at more than the camera's rate: after a fault, in a burst.
const SPARE_BASES: usize = 8;

/// State at an instant. Frames: `O` odometry, `B` body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Instant {
    /// The instant, on the IMU's clock.
    pub stamp: Timestamp,
    /// Pose of the body in the odometry frame.
    pub pose_o_b: Isometry3<f64>,
    /// Velocity of the body in the odometry frame, m/s.
    pub v_o_b: Vector3<f64>,
    /// Angular rate of the body, bias removed, in `B`, rad/s.
    pub angular_rate_b: Vector3<f64>,
    /// Covariance of pose and velocity.
    pub covariance: NavCovariance,
    /// Tracking state of the estimate before the instant; blind if that is old.
    pub state: TrackingState,
    /// Quality of the estimate before the instant; at most 0 if that is old.
    pub quality: i8,
    /// Reset counter of the estimate before the instant.
    pub reset_counter: u32,
    /// Time of the estimate before the instant.
    pub estimated: Timestamp,
    /// True if there is an estimate after the instant too: the state is final.
    pub is_settled: bool,
}

/// Why there is no state at an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoInstant {
    /// There was no pose then.
    NoPose,
    /// Instant before the oldest state in the history.
    TooOld,
    /// The inertial samples do not reach it yet.
    Ahead,
}

/// Estimates of the last seconds, in order of time, and since when there has been none.
#[derive(Clone, Debug)]
pub struct History {
    bases: VecDeque<Base>,
    capacity: usize,
    /// Ends of the poses: no instant between one and the next estimate has a state.
    ends: VecDeque<Timestamp>,
    /// True if an estimate was discarded: instants before the oldest in the history are too old, or from before the first pose.
    has_forgotten: bool,
    newest: Option<Timestamp>,
}

impl History {
    /// Empty history, with room for all estimates of [`HISTORY_S`].
    #[must_use]
    pub fn new(setup: &ValidSetup) -> Self {
        let rate_hz = setup.camera.first().map_or(0.0, |camera| camera.rate_hz);
        let capacity = (HISTORY_S * rate_hz).ceil() as usize + SPARE_BASES;
        Self {
            bases: VecDeque::with_capacity(capacity),
            capacity,
            ends: VecDeque::with_capacity(capacity),
            has_forgotten: false,
            newest: None,
        }
    }

    /// True if the state at `stamp` is to be kept although it is no estimate.
    pub fn wants_mark(&self, stamp: Timestamp) -> bool {
        self.bases.back().is_some_and(|last| stamp.seconds_since(last.stamp) > MARK_S)
    }

    /// An estimate takes effect, or a state is kept that was carried on from one. It takes the place of those that are not older.
    pub fn begin(&mut self, base: Base) {
        self.newest = Some(base.estimated);
        while self.bases.pop_back_if(|last| last.stamp >= base.stamp).is_some() {}
        if self.bases.len() == self.capacity {
            self.bases.pop_front();
            self.has_forgotten = true;
        }
        self.bases.push_back(base);
        let oldest = self.bases.front().map(|first| first.stamp);
        while self.ends.pop_front_if(|end| oldest.is_some_and(|oldest| *end < oldest)).is_some() {}
    }

    /// There is no state any more, by the news at `newest`.
    pub fn end(&mut self, newest: Option<Timestamp>) {
        let (Some(newest), Some(base)) = (newest, self.bases.back()) else { return };
        // One end after each estimate is enough.
        if self.ends.back().is_none_or(|end| *end <= base.stamp) && self.ends.len() < self.capacity {
            self.ends.push_back(newest.max(base.stamp.plus_nanos(1)));
        }
    }

    /// The clock was set.
    pub fn clear(&mut self) {
        self.bases.clear();
        self.ends.clear();
        (self.has_forgotten, self.newest) = (false, None);
    }

    /// True if there is an estimate at or after `stamp`.
    pub fn reaches(&self, stamp: Timestamp) -> bool {
        self.newest.is_some_and(|newest| newest >= stamp)
    }

    /// State at `stamp` by the samples, which are in order of time.
    ///
    /// # Errors
    /// When no state at `stamp` is available.
    pub fn at(
        &self,
        stamp: Timestamp,
        samples: &VecDeque<BelievedSample>,
        carrier: &Carrier,
    ) -> Result<Instant, NoInstant> {
        if samples.back().is_none_or(|newest| newest.sample.stamp < stamp) {
            return Err(NoInstant::Ahead);
        }
        let next = self.bases.partition_point(|base| base.stamp <= stamp);
        let Some(base) = next.checked_sub(1).map(|k| &self.bases[k]) else {
            return Err(if self.has_forgotten { NoInstant::TooOld } else { NoInstant::NoPose });
        };
        if self.ends.iter().any(|end| (base.stamp..=stamp).contains(end)) {
            return Err(NoInstant::NoPose);
        }
        // The sample before the estimate: without it, what lies between cannot be made again.
        if samples.front().is_none_or(|first| first.sample.stamp.seconds_since(base.stamp) > STALE_S) {
            return Err(NoInstant::TooOld);
        }
        let mut carried = base.clone();
        carried.carry_until(stamp, samples, carrier);
        let mut told = carried.told(samples);
        told.is_settled = self.reaches(stamp);
        let after = self.bases.get(next).filter(|after| {
            after.estimated == after.stamp
                && after.reset_counter == base.reset_counter
                && !self.ends.iter().any(|end| (stamp..after.stamp).contains(end))
        });
        if base.stamp < stamp
            && let Some(after) = after
        {
            let share = stamp.seconds_since(base.stamp) / after.stamp.seconds_since(base.stamp);
            let nav = carried.nav.clone();
            carried.carry_until(after.stamp, samples, carrier);
            told.correct_towards(after, &nav, &carried.nav, share);
        }
        // Readings beyond all bounds.
        let is_finite = told.covariance.iter().chain(told.v_o_b.iter()).all(|x| x.is_finite());
        if is_finite { Ok(told) } else { Err(NoInstant::NoPose) }
    }
}

impl Base {
    /// Carries it to `until`, or as far as the samples go.
    fn carry_until(&mut self, until: Timestamp, samples: &VecDeque<BelievedSample>, carrier: &Carrier) {
        let mut k = samples.partition_point(|s| s.sample.stamp <= self.stamp);
        while self.stamp < until
            && let Some(next) = samples.get(k)
        {
            let last = k.checked_sub(1).and_then(|k| samples.get(k)).unwrap_or(next);
            let to = next.sample.stamp.min(until);
            carrier.carry(self, to, (last, next));
            k += 1;
        }
    }

    /// Tracking state and quality to be published; it is blind if the estimate is old.
    pub(super) fn trust(&self) -> (TrackingState, i8) {
        let is_stale = self.stamp.seconds_since(self.estimated) > STALE_S;
        if is_stale { (TrackingState::Blind, self.quality.min(0)) } else { (self.state, self.quality) }
    }

    /// State at the time that was reached.
    fn told(&self, samples: &VecDeque<BelievedSample>) -> Instant {
        let (state, quality) = self.trust();
        Instant {
            stamp: self.stamp,
            pose_o_b: self.nav.pose_o_b(),
            v_o_b: self.nav.v_o_b,
            angular_rate_b: self.rate(samples),
            covariance: self.covariance.nav,
            state,
            quality,
            reset_counter: self.reset_counter,
            estimated: self.estimated,
            is_settled: false,
        }
    }

    fn rate(&self, samples: &VecDeque<BelievedSample>) -> Vector3<f64> {
        let k = samples.partition_point(|s| s.sample.stamp < self.stamp);
        let Some(next) = samples.get(k) else { return self.rate_b };
        let last = k.checked_sub(1).and_then(|k| samples.get(k)).unwrap_or(next);
        if last.unmeasured.or(next.unmeasured).gyro {
            return self.rate_b;
        }
        between(&last.sample, &next.sample, self.stamp).gyro - self.nav.bias_gyro
    }
}

impl Instant {
    /// Takes its share of what the estimate `after` corrects. `nav` is the state here, `predicted` at the time of that estimate.
    fn correct_towards(&mut self, after: &Base, nav: &NavState, predicted: &NavState, share: f64) {
        const DIM: usize = NavState::BIAS_GYRO;
        let correction = after.nav.minus(predicted).fixed_rows::<DIM>(0).into_owned();
        let mut step = SVector::<f64, FRAME_DIM>::zeros();
        step.fixed_rows_mut::<DIM>(0).copy_from(&(correction * share));
        let told = nav.plus(&step);
        // Attitude errors are about the axes of the body, which has turned on by then.
        let turn = (nav.rot_o_b.inverse() * predicted.rot_o_b).to_rotation_matrix().into_inner();
        let mut to_here = NavCovariance::identity();
        to_here.fixed_view_mut::<3, 3>(NavState::ROT, NavState::ROT).copy_from(&turn);
        let (ours, theirs) = (self.covariance, to_here * after.covariance.nav * to_here.transpose());
        let between = to_here * correction;
        let mixed = ours * (1.0 - share) + theirs * share;
        self.covariance = mixed + between * between.transpose() * (share * (1.0 - share));
        self.angular_rate_b += nav.bias_gyro - after.nav.bias_gyro.lerp(&nav.bias_gyro, 1.0 - share);
        (self.pose_o_b, self.v_o_b) = (told.pose_o_b(), told.v_o_b);
    }
}

#[cfg(test)]
#[path = "history_tests.rs"]
mod tests;
