//! Plausibility of the estimate: what it is good for, and when it is given up.

use super::Odometer;
use crate::estimate::HealthBits;
use crate::input::ResetKind;
use crate::origin::body_velocity_covariance;
use crate::window::feature::Feature;
use crate::window::landmark::{Landmark, LandmarkStore};
use plumbline_config::{Portable, Timestamp};
use std::cmp::Ordering;
use std::fmt;

/// Fewest landmarks in view that hold an estimate against drift.
pub(super) const MIN_LANDMARKS_IN_VIEW: usize = 5;
/// Share of `health.max_velocity_sigma_m_s` below which the velocity is known: 0.2 m/s by default. A clean start has 0.01 to
/// 0.08; where a start found no motion between frames at all, it has the 20 m/s that it began with.
const KNOWN_VELOCITY: f64 = 0.1;
/// Landmarks in view that give full quality.
const PLENTY_LANDMARKS: f64 = 60.0;

/// Knowledge of the velocity since the last start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Velocity {
    /// Nothing that could be used; there is no estimate to publish.
    NotYet,
    /// Images and inertial samples determine it.
    Known,
    /// It was known, and is carried on by the inertial sensor since landmarks were lost.
    NoMore,
}

/// Why an estimate was given up and started anew.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ResetReason {
    /// Requested by the operator or the application.
    AskedFor(ResetKind),
    /// Front-end or window ended by a fault of its own, and both were made anew.
    Fault,
    /// Too few landmarks were in view, or the equations could not be solved, for so long, s.
    Blind(f64),
    /// No frame came for so long, s.
    Hole(f64),
    /// The clock of the sensors was set.
    ClockSet,
    /// A state that is no number.
    NotFinite,
    /// A speed beyond what the configuration believes, m/s.
    Speed(f64),
    /// A bias of the gyroscope beyond what it believes, rad/s.
    GyroBias(f64),
    /// A bias of the accelerometer beyond what it believes, m/s².
    AccelBias(f64),
}

impl ResetReason {
    /// Extent of the reset.
    #[must_use]
    pub fn kind(&self) -> ResetKind {
        if let Self::AskedFor(kind) = self { *kind } else { ResetKind::Soft }
    }

    /// True if the reset was requested.
    #[must_use]
    pub fn is_asked_for(&self) -> bool {
        matches!(self, Self::AskedFor(_))
    }
}

impl fmt::Display for ResetReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AskedFor(ResetKind::Soft) => f.write_str("asked for, keeping the pose"),
            Self::AskedFor(ResetKind::Hard) => f.write_str("asked for, from the origin"),
            Self::Fault => f.write_str("the front-end or the window ended by a fault of its own"),
            Self::Blind(s) => write!(
                f,
                "too few landmarks in view, or none that could be used, for {s:.1} s (health.max_blind_s)"
            ),
            Self::Hole(s) => write!(f, "no frame for {s:.1} s"),
            Self::ClockSet => f.write_str("the clock of the sensors was set"),
            Self::NotFinite => f.write_str("the state is no number"),
            Self::Speed(x) => write!(f, "a speed of {x:.1} m/s (health.max_speed_m_s)"),
            Self::GyroBias(x) => write!(f, "a gyroscope bias of {x:.2} rad/s (health.max_gyro_bias_rad_s)"),
            Self::AccelBias(x) => {
                write!(f, "an accelerometer bias of {x:.2} m/s^2 (health.max_accel_bias_m_s2)")
            }
        }
    }
}

impl Odometer {
    /// Landmarks seen in the newest frame.
    pub(super) fn landmarks_in_view(&self) -> usize {
        let Some(newest) = self.window.frames.len().checked_sub(1) else { return 0 };
        in_view(&self.window.points, newest) + in_view(&self.window.lines, newest)
    }

    /// Resets when the estimate cannot be right, or has been blind for too long.
    pub(super) fn judge(&mut self, stamp: Timestamp, health: &mut HealthBits) {
        // Equations that could not be solved tell as little as a black image.
        let is_solved = !health.contains(HealthBits::NOT_POSITIVE_DEFINITE);
        if is_solved && self.landmarks_in_view() >= MIN_LANDMARKS_IN_VIEW {
            self.last_seen = Some(stamp);
        }
        self.judge_velocity();
        if self.velocity_sigma_m_s() > self.options.health.max_velocity_sigma_m_s {
            health.insert(HealthBits::VELOCITY_UNCERTAIN);
        }
        let is_held = self
            .last_reset
            .is_some_and(|last| stamp.seconds_since(last) < self.options.health.reset_holdoff_s);
        let blind_s = self.last_seen.map(|seen| stamp.seconds_since(seen));
        let blind =
            blind_s.filter(|s| *s > self.options.health.max_blind_s && !is_held).map(ResetReason::Blind);
        if let Some(reason) = self.implausible().or(blind) {
            self.start_anew(reason);
            self.last_reset = Some(stamp);
        } else if is_solved && self.velocity != Velocity::NotYet {
            self.remember(stamp);
        }
    }

    /// Decides whether the velocity is known: after a start and after blindness not before images have determined it.
    pub(super) fn judge_velocity(&mut self) {
        let is_certain =
            self.velocity_sigma_m_s() < KNOWN_VELOCITY * self.options.health.max_velocity_sigma_m_s;
        self.velocity = match (self.landmarks_in_view() >= MIN_LANDMARKS_IN_VIEW, self.velocity) {
            (true, _) if is_certain => Velocity::Known,
            (false, Velocity::Known) => Velocity::NoMore,
            (_, before) => before,
        };
    }

    /// Largest standard deviation of the velocity along the axes of the body, m/s.
    fn velocity_sigma_m_s(&self) -> f64 {
        let Some(nav) = self.window.frames.last().map(|frame| &frame.nav) else { return 0.0 };
        let covariance = body_velocity_covariance(&self.covariance, &nav.rot_o_b, &nav.v_o_b);
        (0..3).map(|k| covariance[(k, k)]).fold(0.0, |most, x: f64| x.at_least(most)).sqrt()
    }

    /// True if a vehicle can have this speed and these biases.
    pub(super) fn is_plausible(&self) -> bool {
        self.implausible().is_none()
    }

    /// Value of speed or biases that no vehicle can have, if any.
    fn implausible(&self) -> Option<ResetReason> {
        let health = &self.options.health;
        let Some(frame) = self.window.frames.last() else { return Some(ResetReason::NotFinite) };
        let nav = &frame.nav;
        let (speed, gyro, accel) = (nav.v_o_b.norm(), nav.bias_gyro.norm(), nav.bias_accel.norm());
        // Also what is no number is not within its bounds.
        let beyond = |value: f64, bound: f64| !matches!(value.partial_cmp(&bound), Some(Ordering::Less));
        if !nav.is_finite() {
            Some(ResetReason::NotFinite)
        } else if beyond(speed, health.max_speed_m_s) {
            Some(ResetReason::Speed(speed))
        } else if beyond(gyro, health.max_gyro_bias_rad_s) {
            Some(ResetReason::GyroBias(gyro))
        } else if beyond(accel, health.max_accel_bias_m_s2) {
            Some(ResetReason::AccelBias(accel))
        } else {
            None
        }
    }

    /// 0..=100 from landmarks in view and the certainty of the velocity in the body.
    pub(super) fn quality(&self, in_view: usize) -> i8 {
        let by_landmarks = (in_view as f64 / PLENTY_LANDMARKS).at_most(1.0);
        let by_velocity =
            (1.0 - self.velocity_sigma_m_s() / self.options.health.max_velocity_sigma_m_s).clamp(0.0, 1.0);
        (100.0 * by_landmarks.at_most(by_velocity)).round() as i8
    }
}

/// Landmarks with a depth that a frame sees.
fn in_view<F: Feature>(store: &LandmarkStore<F>, frame: usize) -> usize {
    let is_seen =
        |l: &&Landmark<F>| l.is_triangulated && l.observations.iter().any(|o| usize::from(o.frame) == frame);
    store.all().iter().filter(is_seen).count()
}
