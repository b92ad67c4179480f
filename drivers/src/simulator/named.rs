//! Errors and conditions by name and dose, as command lines and campaigns ask for them: `force:0.07:2`.
//!
//! A family is a table of [`NamedKind`]s; [`Named`] is one of them with its doses.

use super::Scenario;
use std::fmt;
use std::marker::PhantomData;
use std::str::FromStr;

/// Most doses of a kind.
pub(super) const DOSES: usize = 3;

/// One number that an error or a condition is given.
#[derive(Debug)]
pub struct Dose {
    /// Meaning and unit.
    pub unit: &'static str,
    /// Value of a dose that is left out.
    pub default: f64,
    /// Smallest value.
    pub least: f64,
    /// Largest value.
    pub most: f64,
}

impl Dose {
    /// Creates a dose from 0 to `most`.
    pub(crate) const fn new(unit: &'static str, default: f64, most: f64) -> Self {
        Self { unit, default, least: 0.0, most }
    }

    /// Creates a dose of either sign, from `-most` to `most`.
    pub(crate) const fn signed(unit: &'static str, default: f64, most: f64) -> Self {
        Self { unit, default, least: -most, most }
    }

    /// Reads `part` of the argument `text`.
    pub(crate) fn read(&self, part: &str, text: &str) -> Result<f64, String> {
        let value = part.parse().ok().filter(|value| (self.least..=self.most).contains(value));
        let Self { unit, least, most, .. } = self;
        value.ok_or_else(|| format!("'{text}': '{part}' is not a number from {least} to {most} ({unit})"))
    }
}

/// A kind of error or condition.
#[derive(Debug)]
pub struct NamedKind {
    /// Name.
    pub name: &'static str,
    /// Description, in a sentence.
    pub about: &'static str,
    /// Doses, in order.
    pub doses: &'static [Dose],
    /// Doses with which a campaign flies it, the first ones of each.
    pub(super) cases: &'static [&'static [f64]],
    pub(super) apply: fn(&mut Scenario, &[f64; DOSES]),
}

/// A table of kinds.
pub trait Family: 'static {
    /// The noun for one of them in messages.
    const NOUN: &'static str;
    /// All kinds.
    const KINDS: &'static [NamedKind];
}

/// A kind of the family `F` with its doses.
pub struct Named<F> {
    kind: &'static NamedKind,
    doses: [f64; DOSES],
    family: PhantomData<F>,
}

impl<F: Family> Named<F> {
    /// All kinds with the doses of a campaign.
    pub fn cases() -> impl Iterator<Item = Self> {
        F::KINDS.iter().flat_map(|kind| {
            kind.cases.iter().map(move |doses| {
                let mut named = Self::of(kind);
                named.doses[..doses.len()].copy_from_slice(doses);
                named
            })
        })
    }

    /// `kind` with its default doses.
    fn of(kind: &'static NamedKind) -> Self {
        let doses = std::array::from_fn(|i| kind.doses.get(i).map_or(0.0, |dose| dose.default));
        Self { kind, doses, family: PhantomData }
    }

    /// Name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.kind.name
    }

    /// Makes `scenario` one with it.
    pub fn apply(&self, scenario: &mut Scenario) {
        (self.kind.apply)(scenario, &self.doses);
    }

    /// One line for each kind: name, doses with units and defaults, and what it is.
    #[must_use]
    pub fn help() -> String {
        let line = |kind: &NamedKind| {
            let doses: Vec<_> =
                kind.doses.iter().map(|dose| format!("{} [{}]", dose.unit, dose.default)).collect();
            format!("{}:{} - {}", kind.name, doses.join(":"), kind.about)
        };
        F::KINDS.iter().map(line).collect::<Vec<_>>().join("\n")
    }
}

impl<F: Family> FromStr for Named<F> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(':');
        let name = parts.next().unwrap_or_default();
        let names = || F::KINDS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ");
        let kind = F::KINDS
            .iter()
            .find(|kind| kind.name == name)
            .ok_or_else(|| format!("unknown {} '{name}'; choose {}", F::NOUN, names()))?;
        let mut named = Self::of(kind);
        for (i, part) in parts.enumerate() {
            let dose = kind
                .doses
                .get(i)
                .ok_or_else(|| format!("'{text}': {name} has {} doses", kind.doses.len()))?;
            named.doses[i] = dose.read(part, text)?;
        }
        Ok(named)
    }
}

impl<F> fmt::Display for Named<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.kind.name)?;
        self.doses[..self.kind.doses.len()].iter().try_for_each(|dose| write!(f, ":{dose}"))
    }
}

impl<F> fmt::Debug for Named<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

// Derived, these would ask the same of the family.
impl<F> Clone for Named<F> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<F> Copy for Named<F> {}

impl<F> PartialEq for Named<F> {
    fn eq(&self, other: &Self) -> bool {
        self.kind.name == other.kind.name && self.doses.map(f64::to_bits) == other.doses.map(f64::to_bits)
    }
}

impl<F> Eq for Named<F> {}

#[cfg(test)]
mod tests {
    use super::super::{ImuError, SimulatedCondition};
    use super::*;

    fn each_case_changes_a_flight<F: Family>() {
        for named in Named::<F>::cases() {
            assert_eq!(named.to_string().parse::<Named<F>>().unwrap(), named);
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
    fn each_case_of_a_campaign_changes_the_flight() {
        each_case_changes_a_flight::<super::super::imu_errors::ImuErrors>();
        each_case_changes_a_flight::<super::super::conditions::Conditions>();
    }
}
