//! Findings about the data of a sensor that cannot be right, in plain words: the same in a checkup and in a
//! flight.

use crate::verdict::{Fitness, Measure};
use serde::Serialize;
use std::fmt;

/// Name of the measure of what cannot be right.
pub const UNITS_AND_COLUMNS: &str = "units and columns";

/// Something that cannot be right, in words for people.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Finding: what cannot be right.
    pub what: String,
    /// The figures that show it.
    pub evidence: String,
    /// Probable cause.
    pub cause: String,
    /// Cure.
    pub cure: String,
    /// Severity for the flight.
    #[serde(skip)]
    pub fitness: Fitness,
    /// True if everything else that goes wrong with these data is a consequence.
    #[serde(skip)]
    pub explains_all: bool,
}

impl Finding {
    /// A finding of these words.
    pub fn new(
        what: impl Into<String>,
        evidence: impl Into<String>,
        cause: impl Into<String>,
        cure: impl Into<String>,
    ) -> Self {
        Self {
            what: what.into(),
            evidence: evidence.into(),
            cause: cause.into(),
            cure: cure.into(),
            fitness: Fitness::NotFit,
            explains_all: false,
        }
    }

    /// The finding as a measure of this name.
    #[must_use]
    pub fn into_measure_of(self, name: &'static str) -> Measure {
        let value = format!("{} ({})", self.what, self.evidence);
        Measure::new(name, self.fitness, value, self.advice(), &[])
    }

    /// The finding of something that a flight is possible with.
    #[must_use]
    pub fn mild(self) -> Self {
        Self { fitness: Fitness::Mind, ..self }
    }

    /// Cause and cure.
    pub fn advice(&self) -> String {
        match self.cause.as_str() {
            "" => self.cure.clone(),
            cause => format!("probably {cause}; {}", self.cure),
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}): {}", self.what, self.evidence, self.advice())
    }
}
