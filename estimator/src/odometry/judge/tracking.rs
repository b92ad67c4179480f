//! Worth of the estimate, and its end: by its landmarks, its velocity, and what a vehicle can be.

use super::super::estimation::{Estimation, MAX_SCALE_SIGMA};
use super::super::plausible::{ResetReason, implausible};
use super::{PROBATION_S, SET_RIGHT_S, SHORTLY_S};
use crate::estimate::HealthBits;
use plumbline_config::options::HealthConfig;
use plumbline_config::{Portable, Timestamp};

/// Fewest landmarks in view that hold an estimate against drift.
const MIN_LANDMARKS_IN_VIEW: usize = 5;
/// Share of `health.max_velocity_sigma_m_s` below which the velocity is known: 0.2 m/s by default. A clean start has 0.01 to
/// 0.08; where a start found no motion between frames at all, it has the 20 m/s that it began with.
const KNOWN_VELOCITY: f64 = 0.1;
/// Landmarks in view that give full quality.
const PLENTY_LANDMARKS: f64 = 60.0;

/// Knowledge of the velocity since the last start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::odometry) enum Velocity {
    /// Nothing that could be used; there is no estimate to publish.
    NotYet,
    /// Images and inertial samples determine it.
    Known,
    /// It was known, and is carried on by the inertial sensor since landmarks were lost.
    NoMore,
}

/// Fate of an estimate after a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::odometry) enum Belief {
    /// A start anew may go on from its state.
    Believed,
    /// It goes on, and nothing is to go on from its state.
    Unproven,
    /// It is given up.
    GivenUp(ResetReason),
}

/// Follows what holds the estimate.
#[derive(Clone, Debug)]
pub(super) struct Tracking {
    options: HealthConfig,
    velocity: Velocity,
    /// When enough landmarks were last in view.
    last_seen: Option<Timestamp>,
    /// When an estimate was last given up.
    last_reset: Option<Timestamp>,
    /// When the estimate began.
    begun: Option<Timestamp>,
    /// When the images last contradicted a motion as a whole.
    doubted: Option<Timestamp>,
    /// When inertial samples were last not believed, and for how long the quality is bounded afterwards, s.
    distrusted: Option<Timestamp>,
    distrusted_s: f64,
}

impl Tracking {
    pub(super) fn new(options: HealthConfig) -> Self {
        let velocity = Velocity::NotYet;
        Self {
            options,
            velocity,
            last_seen: None,
            last_reset: None,
            begun: None,
            doubted: None,
            distrusted: None,
            distrusted_s: SET_RIGHT_S,
        }
    }

    /// An estimate begins.
    pub(super) fn begin(&mut self, stamp: Timestamp) {
        self.velocity = Velocity::NotYet;
        (self.last_seen, self.begun) = (Some(stamp), Some(stamp));
    }

    /// Forgets stamps that those to come have nothing to do with.
    pub(super) fn forget_time(&mut self) {
        (self.last_seen, self.last_reset) = (None, None);
        (self.doubted, self.distrusted) = (None, None);
    }

    /// The images contradict the motion to the frame of `stamp` as a whole.
    pub(super) fn note_doubt(&mut self, stamp: Timestamp) {
        self.doubted = Some(stamp);
    }

    /// The images place the frame of `stamp` without inertial samples, which are not believed, and `were_believed` for the frame before; a
    /// crowd may carry them.
    pub(super) fn note_distrust(&mut self, stamp: Timestamp, were_believed: bool, is_carried: bool) {
        let recurs = self.distrusted.is_some_and(|last| stamp.seconds_since(last) < SHORTLY_S);
        if is_carried || (were_believed && recurs) {
            self.distrusted_s = PROBATION_S;
        } else if were_believed {
            self.distrusted_s = SET_RIGHT_S;
        }
        self.distrusted = Some(stamp);
    }

    /// True if the velocity is that of a few images at `stamp`.
    pub(super) fn is_doubted_at(&self, stamp: Timestamp) -> bool {
        let is_within =
            |last: Option<Timestamp>, s: f64| last.is_some_and(|last| stamp.seconds_since(last) < s);
        is_within(self.doubted, SET_RIGHT_S) || is_within(self.distrusted, self.distrusted_s)
    }

    /// An estimate was given up at `stamp`: none is for being blind shortly after.
    pub(super) fn note_reset(&mut self, stamp: Timestamp) {
        self.last_reset = Some(stamp);
    }

    pub(super) fn velocity(&self) -> Velocity {
        self.velocity
    }

    /// True while images and inertial samples determine the velocity.
    pub(super) fn is_velocity_known(&self) -> bool {
        self.velocity == Velocity::Known
    }

    pub(super) fn begun(&self) -> Option<Timestamp> {
        self.begun
    }

    /// Gives the estimate up where it cannot be right, or has been blind for too long.
    pub(super) fn judge(
        &mut self,
        estimation: &Estimation,
        stamp: Timestamp,
        health: &mut HealthBits,
    ) -> Belief {
        // Equations that could not be solved tell as little as a black image.
        let is_solved = !health.contains(HealthBits::NOT_POSITIVE_DEFINITE);
        let is_in_view = estimation.landmarks_in_view() >= MIN_LANDMARKS_IN_VIEW;
        if is_solved && is_in_view {
            self.last_seen = Some(stamp);
        }
        self.judge_velocity(estimation);
        if estimation.velocity_sigma_m_s() > self.options.max_velocity_sigma_m_s {
            health.insert(HealthBits::VELOCITY_UNCERTAIN);
        }
        let is_held =
            self.last_reset.is_some_and(|last| stamp.seconds_since(last) < self.options.reset_holdoff_s);
        let blind_s = self.last_seen.map(|seen| stamp.seconds_since(seen));
        let blind = blind_s.filter(|s| *s > self.options.max_blind_s && !is_held).map(ResetReason::Blind);
        if let Some(reason) = implausible(&estimation.window, &self.options).or(blind) {
            self.note_reset(stamp);
            Belief::GivenUp(reason)
        } else if is_solved && is_in_view && self.velocity != Velocity::NotYet {
            Belief::Believed
        } else {
            Belief::Unproven
        }
    }

    /// Decides whether the velocity is known: after a start and after blindness not before images have determined it.
    pub(super) fn judge_velocity(&mut self, estimation: &Estimation) {
        let is_certain =
            estimation.velocity_sigma_m_s() < KNOWN_VELOCITY * self.options.max_velocity_sigma_m_s;
        self.velocity = match (estimation.landmarks_in_view() >= MIN_LANDMARKS_IN_VIEW, self.velocity) {
            (true, _) if is_certain => Velocity::Known,
            (false, Velocity::Known) => Velocity::NoMore,
            (_, before) => before,
        };
    }

    /// 0..=100 from landmarks in view and the certainty of the velocity in the body, and of the scale.
    pub(super) fn quality(&self, estimation: &Estimation, in_view: usize) -> i8 {
        let by_landmarks = (in_view as f64 / PLENTY_LANDMARKS).at_most(1.0);
        let by_velocity =
            (1.0 - estimation.velocity_sigma_m_s() / self.options.max_velocity_sigma_m_s).clamp(0.0, 1.0);
        let by_scale = (1.0 - estimation.scale_sigma / MAX_SCALE_SIGMA).at_least(0.0);
        (100.0 * by_landmarks.at_most(by_velocity).at_most(by_scale)).round() as i8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_that_are_soon_distrusted_again_are_on_probation_for_longer() {
        let mut tracking = Tracking::new(HealthConfig::default());
        let at = |s: f64| Timestamp::default().plus_seconds(s);
        tracking.note_distrust(at(1.0), true, false);
        tracking.note_distrust(at(1.05), false, false);
        assert_eq!([1.3, 1.4].map(|s| tracking.is_doubted_at(at(s))), [true, false]);
        tracking.note_distrust(at(1.5), true, false);
        assert_eq!([2.4, 2.6].map(|s| tracking.is_doubted_at(at(s))), [true, false]);
        tracking.note_distrust(at(9.0), true, false);
        assert_eq!([9.2, 9.4].map(|s| tracking.is_doubted_at(at(s))), [true, false]);
        tracking.note_distrust(at(19.0), true, false);
        tracking.note_distrust(at(19.05), false, true);
        assert_eq!([20.0, 20.1].map(|s| tracking.is_doubted_at(at(s))), [true, false]);
    }
}
