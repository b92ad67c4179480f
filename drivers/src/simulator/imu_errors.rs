//! Errors of inertial sensors by name and dose.
//!
//! To add one, add a [`Kind`] to the table and do what it says in [`ImuEffects`](super::ImuEffects) or in the [`Scenario`](super::Scenario).

use super::named::{Dose, Family, Kind, Named};
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
    const KINDS: &'static [Kind] = KINDS;
}

const KINDS: &[Kind] = &[
    Kind {
        name: "force",
        about: "Coloured error of the accelerometer (Gauss-Markov, each axis by itself)",
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
    Kind {
        name: "scale",
        about: "Scale error of every axis of both sensors, of drawn signs",
        doses: &[Dose::new("%", 0.5, 20.0)],
        cases: &[&[]],
        apply: |scenario, [percent, ..]| scenario.imu.scale_error = 0.01 * percent,
    },
    Kind {
        name: "misalignment",
        about: "Every axis of both sensors tilted in a drawn direction",
        doses: &[Dose::new("mrad", 3.0, 200.0)],
        cases: &[&[]],
        apply: |scenario, [mrad, ..]| scenario.imu.misalignment_rad = 1e-3 * mrad,
    },
    Kind {
        name: "g-sensitivity",
        about: "Gyroscope that feels forces; 0.3e-3 is typical of industrial sensors, 1e-3 to 2e-3 of a flight controller's",
        doses: &[Dose::new("rad/s per g", 1e-3, 0.1)],
        cases: &[&[]],
        apply: |scenario, [rad_s_per_g, ..]| scenario.imu.g_sensitivity_rad_s_per_g = *rad_s_per_g,
    },
    Kind {
        name: "vibration",
        about: "Vibration of the rotors with its first harmonic at half the amplitude, aliased by the sampling; the frequency \
                wanders by 2 %",
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
    Kind {
        name: "clipping",
        about: "An accelerometer of 2 g that vibrates so hard that this share of its samples is clipped",
        doses: &[Dose::new("% of the samples", 5.0, 50.0)],
        cases: &[&[]],
        apply: |scenario, [percent, ..]| {
            scenario.imu.clipped_share = 0.01 * percent;
            scenario.imu.vibration_wander = ROTOR_WANDER;
        },
    },
    Kind {
        name: "knock",
        about: "A knock that moves the vehicle, path and images, in a drawn direction; samples at 200 Hz miss the shorter ones",
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
    Kind {
        name: "residual",
        about: "What the samples recorded along the path (euroc/imu) hold above 10 Hz and the path does not",
        doses: &[Dose::new("multiple of what was recorded", 1.0, 100.0)],
        cases: &[&[]],
        apply: |scenario, [multiple, ..]| {
            scenario.imu.residual_scale = *multiple;
            if let FlightPath::Tum(path) = &scenario.path {
                scenario.inertial = Inertial::Residual(recorded_along(path));
            }
        },
    },
];
