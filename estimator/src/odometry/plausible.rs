//! Limits of a vehicle, and the reasons for which an estimate is given up.

use crate::input::ResetKind;
use crate::window::Window;
use plumbline_config::options::HealthConfig;
use std::cmp::Ordering;

/// Cure of cameras that were moved.
const MOUNTS: &str = "fasten cameras and IMU to each other, and calibrate how they are mounted again (`plumbline calibrate rig`)";

/// Why an estimate was given up and started anew.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ResetReason {
    /// Requested by the operator or the application.
    #[error("asked for, {}", if *.0 == ResetKind::Soft { "keeping the pose" } else { "from the origin" })]
    AskedFor(ResetKind),
    /// Front-end or window ended by a fault of its own, and both were made anew.
    #[error("the front-end or the window ended by a fault of its own")]
    Fault,
    /// Too few landmarks were in view, or the equations could not be solved, for so long, s.
    #[error("too few landmarks in view, or none that could be used, for {0:.1} s (health.max_blind_s)")]
    Blind(f64),
    /// No frame came for so long, s.
    #[error("no frame for {0:.1} s")]
    Hole(f64),
    /// The clock of the sensors was set.
    #[error("the clock of the sensors was set")]
    ClockSet,
    /// The frames after a start with one camera contradict it.
    #[error("the frames after the start contradict it")]
    StartRefused,
    /// Images and gyroscope have jumped against each other by so much, rad.
    #[error("cameras may have been moved: images and gyroscope differ at once by {0:.2} rad")]
    Jump(f64),
    /// A state that is no number.
    #[error("the state is no number")]
    NotFinite,
    /// A speed beyond what the configuration believes, m/s.
    #[error("a speed of {0:.1} m/s (health.max_speed_m_s)")]
    Speed(f64),
    /// A bias of the gyroscope beyond what it believes, rad/s.
    #[error("a gyroscope bias of {0:.2} rad/s (health.max_gyro_bias_rad_s)")]
    GyroBias(f64),
    /// A bias of the accelerometer beyond what it believes, m/s².
    #[error("an accelerometer bias of {0:.2} m/s^2 (health.max_accel_bias_m_s2)")]
    AccelBias(f64),
}

impl ResetReason {
    /// Extent of the reset.
    pub fn kind(&self) -> ResetKind {
        if let Self::AskedFor(kind) = self { *kind } else { ResetKind::Soft }
    }

    /// What to do about it.
    pub fn cure(&self) -> &'static str {
        match self {
            Self::Jump(_) => MOUNTS,
            Self::Blind(_) => "look at light, lenses, exposure and texture",
            Self::Hole(_) => "look at cables, bandwidth and load",
            Self::ClockSet => "stamp by one clock that is never set, such as CLOCK_MONOTONIC",
            _ => "look at the other warnings, and run `plumbline doctor` on the data",
        }
    }

    /// True if the reset was requested.
    pub fn is_asked_for(&self) -> bool {
        matches!(self, Self::AskedFor(_))
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
