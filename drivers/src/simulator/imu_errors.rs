//! Errors of inertial sensors by name and dose.
//!
//! To add one, add a [`NamedKind`] to the table and do what it says in [`ImuEffects`](super::ImuEffects) or in the [`Scenario`](super::Scenario).

use super::named::{Dose, Family, Named, NamedKind};
use super::samples::{Inertial, recorded_along};
use super::{FlightPath, Knock};

/// Relative standard deviation of the frequency of a vibration: rotors never turn quite alike.
const ROTOR_WANDER: f64 = 0.02;
/// A knock comes so long after the first frame, s.
const KNOCK_AT_S: f64 = 6.0;

/// An error of an inertial sensor with its doses.
pub type ImuError = Named<ImuErrors>;

/// Family of the errors of inertial sensors.
#[derive(Clone, Copy, Debug)]
pub struct ImuErrors;

impl Family for ImuErrors {
    const NOUN: &'static str = "error of an inertial sensor";
    const KINDS: &'static [NamedKind] = KINDS;
}

const KINDS: &[NamedKind] = &[
    NamedKind {
        name: "force",
        about: "Coloured error of the accelerometer (Gauss-Markov, independent for each axis)",
        doses: &[
            Dose::new("standard deviation, m/s²", 0.03, 10.0),
            Dose::new("correlation time, s", 2.0, 1000.0),
        ],
        cases: &[&[0.03], &[0.07]],
        apply: |scenario, [sigma, time_s, _]| {
            scenario.imu.force_sigma_m_s2 = *sigma;
            scenario.imu.force_time_s = *time_s;
        },
    },
    NamedKind {
        name: "scale",
        about: "Scale error of every axis of both sensors, with random signs",
        doses: &[Dose::new("%", 0.5, 20.0)],
        cases: &[&[]],
        apply: |scenario, [percent, ..]| scenario.imu.scale_error = 0.01 * percent,
    },
    NamedKind {
        name: "misalignment",
        about: "Every axis of both sensors tilted in a random direction",
        doses: &[Dose::new("mrad", 3.0, 200.0)],
        cases: &[&[]],
        apply: |scenario, [mrad, ..]| scenario.imu.misalignment_rad = 1e-3 * mrad,
    },
    NamedKind {
        name: "g-sensitivity",
        about: "Gyroscope that responds to forces; typical values are 0.3e-3 (industrial sensors) and 1e-3 to 2e-3 (flight controllers)",
        doses: &[Dose::new("rad/s per g", 1e-3, 0.1)],
        cases: &[&[]],
        apply: |scenario, [rad_s_per_g, ..]| scenario.imu.g_sensitivity_rad_s_per_g = *rad_s_per_g,
    },
    NamedKind {
        name: "vibration",
        about: "Vibration of the rotors with its first harmonic at half the amplitude, aliased by the sampling; the frequency \
                varies by 2 %",
        doses: &[
            Dose::new("amplitude, m/s²", 5.0, 1000.0),
            Dose::new("frequency, Hz", 120.0, 2000.0),
            Dose::new("amplitude of the gyroscope, rad/s", 0.0, 10.0),
        ],
        cases: &[&[5.0, 120.0], &[5.0, 97.0], &[30.0, 120.0], &[30.0, 173.0]],
        apply: |scenario, [accel, hz, gyro]| {
            scenario.imu.vibration_accel_m_s2 = *accel;
            scenario.imu.vibration_gyro_rad_s = *gyro;
            scenario.imu.vibration_hz = *hz;
            scenario.imu.vibration_wander = ROTOR_WANDER;
        },
    },
    NamedKind {
        name: "clipping",
        about: "Accelerometer with a range of 2 g and a vibration that clips this share of its samples",
        doses: &[Dose::new("% of the samples", 5.0, 50.0)],
        cases: &[&[]],
        apply: |scenario, [percent, ..]| {
            scenario.imu.clipped_share = 0.01 * percent;
            scenario.imu.vibration_wander = ROTOR_WANDER;
        },
    },
    NamedKind {
        name: "knock",
        about: "Knock that moves the vehicle (path and images) in a random direction; samples at 200 Hz miss short knocks",
        doses: &[
            Dose::new("mm", 20.0, 1000.0),
            Dose::new("length, ms", 15.0, 1000.0),
            Dose::new("time after the first frame, s", KNOCK_AT_S, 1e6),
        ],
        cases: &[&[5.0], &[20.0]],
        apply: |scenario, [mm, ms, at_s]| {
            scenario.knock = Some(Knock { at_s: *at_s, length_s: 1e-3 * ms, distance_m: 1e-3 * mm });
        },
    },
    NamedKind {
        name: "residual",
        about: "Part of the recorded samples (euroc/imu) above 10 Hz that is not in the path",
        doses: &[Dose::new("multiple of the recorded error", 1.0, 100.0)],
        cases: &[&[]],
        apply: |scenario, [multiple, ..]| {
            scenario.imu.residual_scale = *multiple;
            if let FlightPath::Tum(path) = &scenario.path {
                scenario.inertial = Inertial::Residual(recorded_along(path));
            }
        },
    },
];
