//! Errors of the inertial sensor and conditions of light, camera, scene and motion, by name and dose: `force:0.07:2`.
//!
//! `disturbances.toml` is the table of both; what an entry sets is in [`super::settings`].

use super::Scenario;
use super::settings::Setting;
use serde::Deserialize;
use std::fmt;
use std::str::FromStr;
use std::sync::LazyLock;

/// Most doses of a kind.
const DOSES: usize = 3;

/// One number that an error, a condition or a fault is given.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dose {
    /// Meaning and unit.
    pub unit: String,
    /// Value of a dose that is left out.
    pub default: f64,
    /// Smallest and largest value.
    pub range: [f64; 2],
    sets: Option<Setting>,
    times: Option<f64>,
}

impl Dose {
    /// Reads `part` of the argument `text`.
    pub(crate) fn read(&self, part: &str, text: &str) -> Result<f64, String> {
        let Self { unit, range: [least, most], .. } = self;
        let value = part.parse().ok().filter(|value| (*least..=*most).contains(value));
        value.ok_or_else(|| format!("'{text}': '{part}' is not a number from {least} to {most} ({unit})"))
    }
}

/// A kind of error or condition.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct NamedKind {
    name: String,
    about: String,
    doses: Vec<Dose>,
    #[serde(default)]
    also: Vec<(Setting, f64)>,
}

/// Table of the kinds.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Kinds {
    imu_error: Vec<NamedKind>,
    condition: Vec<NamedKind>,
}

static KINDS: LazyLock<Kinds> =
    LazyLock::new(|| toml::from_str(include_str!("disturbances.toml")).expect("the table of disturbances"));

/// An error of the inertial sensor (`IS_IMU`) or a condition, with its doses.
#[derive(Clone, Copy)]
pub struct Named<const IS_IMU: bool> {
    kind: &'static NamedKind,
    doses: [f64; DOSES],
}

/// An error of the inertial sensor.
pub type ImuError = Named<true>;
/// A condition of light, camera, scene or motion.
pub type SimulatedCondition = Named<false>;

impl<const IS_IMU: bool> Named<IS_IMU> {
    const NOUN: &str = if IS_IMU { "error of an inertial sensor" } else { "condition" };

    fn kinds() -> &'static [NamedKind] {
        if IS_IMU { &KINDS.imu_error } else { &KINDS.condition }
    }

    /// `kind` with its default doses.
    fn of(kind: &'static NamedKind) -> Self {
        Self { kind, doses: std::array::from_fn(|i| kind.doses.get(i).map_or(0.0, |dose| dose.default)) }
    }

    /// Makes `scenario` one with it.
    pub fn apply(&self, scenario: &mut Scenario) {
        let dosed = self.kind.doses.iter().zip(self.doses);
        let dosed = dosed.filter_map(|(dose, value)| Some((dose.sets?, value * dose.times.unwrap_or(1.0))));
        dosed.chain(self.kind.also.iter().copied()).for_each(|(set, value)| set.apply(scenario, value));
    }

    /// One line for each kind: name, doses with units and defaults, and what it is.
    pub fn help() -> String {
        let line = |kind: &NamedKind| {
            let doses = kind.doses.iter().map(|dose| format!("{} [{}]", dose.unit, dose.default));
            format!("{}:{} - {}", kind.name, doses.collect::<Vec<_>>().join(":"), kind.about)
        };
        Self::kinds().iter().map(line).collect::<Vec<_>>().join("\n")
    }
}

impl<const IS_IMU: bool> FromStr for Named<IS_IMU> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(':');
        let name = parts.next().unwrap_or_default();
        let kind = Self::kinds().iter().find(|kind| kind.name == name).ok_or_else(|| {
            let names: Vec<_> = Self::kinds().iter().map(|kind| kind.name.as_str()).collect();
            format!("unknown {} '{name}'; choose {}", Self::NOUN, names.join(", "))
        })?;
        let mut named = Self::of(kind);
        for (i, part) in parts.enumerate() {
            let dose = kind.doses.get(i);
            let dose = dose.ok_or_else(|| format!("'{text}': {name} has {} doses", kind.doses.len()))?;
            named.doses[i] = dose.read(part, text)?;
        }
        Ok(named)
    }
}

impl<const IS_IMU: bool> fmt::Display for Named<IS_IMU> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.kind.name)?;
        self.doses[..self.kind.doses.len()].iter().try_for_each(|dose| write!(f, ":{dose}"))
    }
}

impl<const IS_IMU: bool> fmt::Debug for Named<IS_IMU> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn each_kind_changes_a_flight<const IS_IMU: bool>() {
        for named in Named::<IS_IMU>::kinds().iter().map(Named::<IS_IMU>::of) {
            assert_eq!(named.to_string().parse::<Named<IS_IMU>>().unwrap().to_string(), named.to_string());
            let mut changed = Scenario::default();
            named.apply(&mut changed);
            assert_ne!(changed, Scenario::default(), "{named}");
        }
    }

    #[test]
    fn names_and_doses_are_read_and_written() {
        let error: ImuError = "force:0.07".parse().unwrap();
        assert_eq!(error.to_string(), "force:0.07:2");
        let mut scenario = Scenario::default();
        error.apply(&mut scenario);
        assert_eq!((scenario.imu.force_sigma_m_s2, scenario.imu.force_time_s), (0.07, 2.0));
        assert_eq!("blur:10:6".parse::<SimulatedCondition>().unwrap().to_string(), "blur:10:6:1");
        assert!("forse".parse::<ImuError>().unwrap_err().contains("misalignment"));
        assert!("force".parse::<SimulatedCondition>().unwrap_err().contains("rolling-shutter"));
        assert!("force:-1".parse::<ImuError>().unwrap_err().contains("m/s²"));
        assert!("scale:1:2".parse::<ImuError>().unwrap_err().contains("1 doses"));
    }

    #[test]
    fn each_kind_in_its_usual_dose_changes_the_flight() {
        each_kind_changes_a_flight::<true>();
        each_kind_changes_a_flight::<false>();
    }
}
