//! Values of a scenario that the table of disturbances sets.

use super::scenes::Surroundings;
use super::{FlightPath, Scenario};
use plumbline_config::Portable;
use serde::Deserialize;

/// Sub-exposures per millisecond of exposure, and their bounds. At 2 rad/s a point moves by 1.1 px between two of them.
const SUB_EXPOSURES_PER_MS: f64 = 0.8;
const SUB_EXPOSURES: (f64, f64) = (3.0, 8.0);

/// Assignment of a value to a part of a scenario.
type Set = fn(&mut Scenario, f64);

/// Settings by name.
const SETTINGS: &[(&str, Set)] = &[
    ("force-sigma-m-s2", |s, value| s.imu.force_sigma_m_s2 = value),
    ("force-time-s", |s, value| s.imu.force_time_s = value),
    ("scale-error", |s, value| s.imu.scale_error = value),
    ("misalignment-rad", |s, value| s.imu.misalignment_rad = value),
    ("g-sensitivity", |s, value| s.imu.g_sensitivity_rad_s_per_g = value),
    ("vibration-m-s2", |s, value| s.imu.vibration_accel_m_s2 = value),
    ("vibration-rad-s", |s, value| s.imu.vibration_gyro_rad_s = value),
    ("vibration-hz", |s, value| s.imu.vibration_hz = value),
    ("vibration-wander", |s, value| s.imu.vibration_wander = value),
    ("exposure-ms", expose),
    ("read-noise", |s, value| s.effects.read_noise = value),
    ("shot-noise", |s, value| s.effects.shot_noise = value),
    ("gain", |s, value| s.effects.gain = value),
    ("readout-s", |s, value| s.effects.readout_s = value),
    ("people-share", |s, value| s.people.share = value),
    ("people-speed-m-s", |s, value| s.people.speed_m_s = value),
    ("people-from-s", |s, value| s.people.from_s = value),
    ("repeated-px", |s, value| s.surroundings = Surroundings::Repeated { period_px: value.at_least(1.0) }),
    ("bare-spots", |s, value| s.surroundings = Surroundings::Bare { spots: value }),
    ("hover-s", |s, value| (s.path, s.start_s, s.duration_s) = (FlightPath::Hover, 0.0, value)),
    ("focal-error", |s, value| s.intrinsics_error.focal = value),
    ("centre-error-px", |s, value| s.intrinsics_error.centre_px = value),
    ("vergence-error-rad", |s, value| s.intrinsics_error.vergence_rad = value),
];

fn expose(scenario: &mut Scenario, exposure_ms: f64) {
    let count = (SUB_EXPOSURES_PER_MS * exposure_ms).ceil().clamp(SUB_EXPOSURES.0, SUB_EXPOSURES.1);
    scenario.effects.exposure_s = 1e-3 * exposure_ms;
    scenario.effects.sub_exposures = count as usize;
}

/// A setting.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "String")]
pub(super) struct Setting(Set);

impl Setting {
    /// Sets the value in `scenario`.
    pub(super) fn apply(self, scenario: &mut Scenario, value: f64) {
        (self.0)(scenario, value);
    }
}

impl TryFrom<String> for Setting {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        let found = SETTINGS.iter().find(|(known, _)| *known == name);
        found.map(|(_, set)| Self(*set)).ok_or_else(|| format!("a scenario has no setting '{name}'"))
    }
}
