//! Measurement, its verdict, and the cure.

use crate::FLIGHT;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;

/// Name of the measure of a recording that is too short.
pub(crate) const TOO_SHORT: &str = "calibration";

/// Verdict on a measurement, the mildest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Fitness {
    /// The data do not hold it.
    #[serde(rename = "not measured")]
    NotMeasured,
    /// It was measured, but not well enough for a verdict.
    Uncertain,
    /// As it should be.
    Good,
    /// A flight is possible, with this against it.
    Mind,
    /// Do not fly with this.
    #[serde(rename = "not fit")]
    NotFit,
}

impl fmt::Display for Fitness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(["not measured", "uncertain", "good", "mind", "not fit"][*self as usize])
    }
}

impl Fitness {
    /// [`Fitness::Good`] up to `good`, [`Fitness::Mind`] up to `mind`, and beyond (or no number) [`Fitness::NotFit`].
    pub fn within(value: f64, good: f64, mind: f64) -> Self {
        if value <= good {
            Self::Good
        } else if value <= mind {
            Self::Mind
        } else {
            Self::NotFit
        }
    }
}

/// One thing that was looked at.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measure {
    /// Name, always the same.
    pub name: &'static str,
    /// Measurement, in words with units.
    pub value: String,
    /// Verdict on it.
    pub verdict: Fitness,
    /// Cure, in one line; empty where it is good.
    pub cure: String,
    /// Measured values as numbers; each name ends with its unit.
    pub figures: BTreeMap<&'static str, f64>,
    /// Motion that shows it, where no flight should begin without it.
    #[serde(skip)]
    pub motion: Option<&'static str>,
}

impl Measure {
    /// A measure of these words; the cure of a good one is left out.
    pub fn new(
        name: &'static str,
        verdict: Fitness,
        value: String,
        cure: impl Into<String>,
        figures: &[(&'static str, f64)],
    ) -> Self {
        let cure = if verdict == Fitness::Good { String::new() } else { cure.into() };
        Self { name, value, verdict, cure, figures: figures.iter().copied().collect(), motion: None }
    }

    /// Something that no flight should begin with.
    pub fn not_fit(name: &'static str, value: String, cure: &str) -> Self {
        Self::new(name, Fitness::NotFit, value, cure, &[])
    }

    /// Something that the data do not hold.
    pub fn missing(name: &'static str, why: &str, cure: &str) -> Self {
        Self::new(name, Fitness::NotMeasured, why.to_owned(), cure, &[])
    }

    /// Marks a measure without which no flight should begin, with the motion that shows it.
    #[must_use]
    pub(crate) fn shown_by(self, motion: Option<&'static str>) -> Self {
        Self { motion, ..self }
    }

    /// True if a flight needs it and the data do not show it.
    pub fn is_missing(&self) -> bool {
        self.verdict <= Fitness::Uncertain && self.motion.is_some()
    }

    /// Name for a sentence; of what only a flight or the whole recording shows, with it.
    pub fn title(&self) -> String {
        let words =
            self.value.split(" (health bit").next().filter(|_| [FLIGHT, TOO_SHORT].contains(&self.name));
        words.map_or_else(|| self.name.to_owned(), |words| format!("{}: {words}", self.name))
    }
}
