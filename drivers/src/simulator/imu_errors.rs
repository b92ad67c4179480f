//! Errors of inertial sensors by name and dose, as command lines and campaigns ask for them: `force:0.07:2`.
//!
//! To add one, add a [`Kind`] to [`KINDS`] and do what it says in [`ImuEffects`](super::ImuEffects) or in the [`Scenario`].

use super::samples::{Inertial, recorded_along};
use super::{FlightPath, Knock, Scenario};
use std::fmt;
use std::str::FromStr;

/// Most doses that an error has.
const DOSES: usize = 3;
/// Relative standard deviation of the frequency of a vibration: rotors never turn quite alike.
const ROTOR_WANDER: f64 = 0.02;
/// A knock comes so long after the first frame, s.
const KNOCK_AT_S: f64 = 6.0;

/// One number that an error is given.
#[derive(Debug)]
pub struct Dose {
    /// Its meaning and unit.
    pub unit: &'static str,
    /// Value of a dose that is left out.
    pub default: f64,
    /// Largest value; the smallest is 0.
    pub most: f64,
}

/// A kind of error.
#[derive(Debug)]
pub struct Kind {
    /// Its name.
    pub name: &'static str,
    /// What it is, in a sentence.
    pub about: &'static str,
    /// Its doses, in order.
    pub doses: &'static [Dose],
    /// Doses with which a campaign flies it, the first ones of each.
    cases: &'static [&'static [f64]],
    apply: fn(&mut Scenario, &[f64; DOSES]),
}

/// All kinds of errors.
pub static KINDS: [Kind; 8] = [
    Kind {
        name: "force",
        about: "Coloured error of the accelerometer (Gauss-Markov, each axis by itself)",
        doses: &[dose("standard deviation, m/s²", 0.03, 10.0), dose("correlation time, s", 2.0, 1000.0)],
        cases: &[&[0.03], &[0.07]],
        apply: |scenario, [sigma, time_s, _]| {
            scenario.imu.force_sigma_m_s2 = *sigma;
            scenario.imu.force_time_s = *time_s;
        },
    },
    Kind {
        name: "scale",
        about: "Scale error of every axis of both sensors, of drawn signs",
        doses: &[dose("%", 0.5, 20.0)],
        cases: &[&[]],
        apply: |scenario, [percent, ..]| scenario.imu.scale_error = 0.01 * percent,
    },
    Kind {
        name: "misalignment",
        about: "Every axis of both sensors tilted in a drawn direction",
        doses: &[dose("mrad", 3.0, 200.0)],
        cases: &[&[]],
        apply: |scenario, [mrad, ..]| scenario.imu.misalignment_rad = 1e-3 * mrad,
    },
    Kind {
        name: "g-sensitivity",
        about: "Gyroscope that feels forces; 0.3e-3 is typical of industrial sensors, 1e-3 to 2e-3 of a flight controller's",
        doses: &[dose("rad/s per g", 1e-3, 0.1)],
        cases: &[&[]],
        apply: |scenario, [rad_s_per_g, ..]| scenario.imu.g_sensitivity_rad_s_per_g = *rad_s_per_g,
    },
    Kind {
        name: "vibration",
        about: "Vibration of the rotors with its first harmonic at half the amplitude, aliased by the sampling; the frequency \
                wanders by 2 %",
        doses: &[
            dose("amplitude, m/s²", 5.0, 1000.0),
            dose("frequency, Hz", 120.0, 2000.0),
            dose("amplitude of the gyroscope, rad/s", 0.0, 10.0),
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
        doses: &[dose("% of the samples", 5.0, 50.0)],
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
            dose("mm", 20.0, 1000.0),
            dose("length, ms", 15.0, 1000.0),
            dose("time after the first frame, s", KNOCK_AT_S, 1e6),
        ],
        cases: &[&[5.0], &[20.0]],
        apply: |scenario, [mm, ms, at_s]| {
            scenario.knock = Some(Knock { at_s: *at_s, length_s: 1e-3 * ms, distance_m: 1e-3 * mm });
        },
    },
    Kind {
        name: "residual",
        about: "What the samples recorded along the path (euroc/imu) hold above 10 Hz and the path does not",
        doses: &[dose("multiple of what was recorded", 1.0, 100.0)],
        cases: &[&[]],
        apply: |scenario, [multiple, ..]| {
            scenario.imu.residual_scale = *multiple;
            if let FlightPath::Tum(path) = &scenario.path {
                scenario.inertial = Inertial::Residual(recorded_along(path));
            }
        },
    },
];

const fn dose(unit: &'static str, default: f64, most: f64) -> Dose {
    Dose { unit, default, most }
}

/// An error of an inertial sensor with its doses.
#[derive(Clone, Copy)]
pub struct ImuError {
    kind: &'static Kind,
    doses: [f64; DOSES],
}

impl ImuError {
    /// The errors with which a campaign flies.
    pub fn cases() -> impl Iterator<Item = Self> {
        KINDS.iter().flat_map(|kind| {
            kind.cases.iter().map(move |doses| {
                let mut error = Self::of(kind);
                error.doses[..doses.len()].copy_from_slice(doses);
                error
            })
        })
    }

    /// `kind` with its default doses.
    fn of(kind: &'static Kind) -> Self {
        let doses = std::array::from_fn(|i| kind.doses.get(i).map_or(0.0, |dose| dose.default));
        Self { kind, doses }
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.kind.name
    }

    /// Makes `scenario` one with this error.
    pub fn apply(&self, scenario: &mut Scenario) {
        (self.kind.apply)(scenario, &self.doses);
    }

    /// One line for each kind: name, doses with units and defaults, and what it is.
    #[must_use]
    pub fn help() -> String {
        let line = |kind: &Kind| {
            let doses: Vec<_> =
                kind.doses.iter().map(|dose| format!("{} [{}]", dose.unit, dose.default)).collect();
            format!("{}:{} - {}", kind.name, doses.join(":"), kind.about)
        };
        KINDS.iter().map(line).collect::<Vec<_>>().join("\n")
    }
}

impl FromStr for ImuError {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(':');
        let name = parts.next().unwrap_or_default();
        let names = || KINDS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ");
        let kind = KINDS
            .iter()
            .find(|kind| kind.name == name)
            .ok_or_else(|| format!("'{name}' is no error of an inertial sensor; choose {}", names()))?;
        let mut error = Self::of(kind);
        for (i, part) in parts.enumerate() {
            let dose = kind
                .doses
                .get(i)
                .ok_or_else(|| format!("'{text}': {name} has {} doses", kind.doses.len()))?;
            let value = part.parse().ok().filter(|value| (0.0..=dose.most).contains(value));
            error.doses[i] = value.ok_or_else(|| {
                format!("'{text}': '{part}' is no number from 0 to {} ({})", dose.most, dose.unit)
            })?;
        }
        Ok(error)
    }
}

impl fmt::Display for ImuError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.kind.name)?;
        self.doses[..self.kind.doses.len()].iter().try_for_each(|dose| write!(f, ":{dose}"))
    }
}

impl fmt::Debug for ImuError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl PartialEq for ImuError {
    fn eq(&self, other: &Self) -> bool {
        self.kind.name == other.kind.name && self.doses.map(f64::to_bits) == other.doses.map(f64::to_bits)
    }
}

impl Eq for ImuError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_doses_are_read_and_written() {
        let error: ImuError = "force:0.07".parse().unwrap();
        assert_eq!(error.to_string(), "force:0.07:2");
        let mut scenario = Scenario::default();
        error.apply(&mut scenario);
        assert_eq!((scenario.imu.force_sigma_m_s2, scenario.imu.force_time_s), (0.07, 2.0));
        for error in ImuError::cases() {
            assert_eq!(error.to_string().parse::<ImuError>().unwrap(), error);
            let mut changed = Scenario::default();
            error.apply(&mut changed);
            assert_ne!(changed, Scenario::default(), "{error}");
        }
        assert!("forse".parse::<ImuError>().unwrap_err().contains("misalignment"));
        assert!("force:-1".parse::<ImuError>().unwrap_err().contains("m/s²"));
        assert!("scale:1:2".parse::<ImuError>().unwrap_err().contains("1 doses"));
    }
}
