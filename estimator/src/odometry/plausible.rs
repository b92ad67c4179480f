//! Limits of a vehicle, and the reasons for which an estimate is given up.

use crate::input::ResetKind;
use crate::window::Window;
use plumbline_config::options::HealthConfig;
use std::cmp::Ordering;
use std::fmt;

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
    /// The frames after a start with one camera contradict it: by so many times the variance of what was measured.
    StartRefused(f64),
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
            Self::StartRefused(ratio) => {
                write!(f, "the frames after the start contradict it by {:.1} sigmas", ratio.sqrt())
            }
            Self::NotFinite => f.write_str("the state is no number"),
            Self::Speed(x) => write!(f, "a speed of {x:.1} m/s (health.max_speed_m_s)"),
            Self::GyroBias(x) => write!(f, "a gyroscope bias of {x:.2} rad/s (health.max_gyro_bias_rad_s)"),
            Self::AccelBias(x) => {
                write!(f, "an accelerometer bias of {x:.2} m/s^2 (health.max_accel_bias_m_s2)")
            }
        }
    }
}

/// Value of speed or biases that no vehicle can have, if any.
pub(super) fn implausible(window: &Window, health: &HealthConfig) -> Option<ResetReason> {
    let Some(frame) = window.frames.last() else { return Some(ResetReason::NotFinite) };
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
