//! Measurement, its verdict, and the cure.

use std::fmt;

/// Verdict on a measurement, the mildest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fitness {
    /// The data do not hold it.
    NotMeasured,
    /// It was measured, but not well enough for a verdict.
    Uncertain,
    /// As it should be.
    Good,
    /// A flight is possible, with this against it.
    Mind,
    /// Do not fly with this.
    NotFit,
}

impl fmt::Display for Fitness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::NotMeasured => "not measured",
            Self::Uncertain => "uncertain",
            Self::Good => "good",
            Self::Mind => "mind",
            Self::NotFit => "not fit",
        })
    }
}

impl Fitness {
    /// [`Fitness::Good`] up to `good`, [`Fitness::Mind`] up to `mind`, and beyond (or no number) [`Fitness::NotFit`].
    #[must_use]
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
#[derive(Clone, Debug, PartialEq)]
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
    pub figures: Vec<(&'static str, f64)>,
}

impl Measure {
    /// A measure of these words; the cure of a good one is left out.
    #[must_use]
    pub fn new(
        name: &'static str,
        verdict: Fitness,
        value: String,
        cure: impl Into<String>,
        figures: &[(&'static str, f64)],
    ) -> Self {
        let cure = if verdict == Fitness::Good { String::new() } else { cure.into() };
        Self { name, value, verdict, cure, figures: figures.to_vec() }
    }

    /// Something that the data do not hold.
    #[must_use]
    pub fn missing(name: &'static str, why: &str, cure: &str) -> Self {
        Self::new(name, Fitness::NotMeasured, why.to_owned(), cure, &[])
    }

    /// The figure of this name.
    #[must_use]
    pub fn figure(&self, name: &str) -> Option<f64> {
        self.figures.iter().find(|(known, _)| *known == name).map(|(_, value)| *value)
    }
}

/// Measures, in a fixed order.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckupReport {
    /// The measures.
    pub measures: Vec<Measure>,
}

impl CheckupReport {
    /// True if nothing speaks against a flight.
    #[must_use]
    pub fn is_fit(&self) -> bool {
        self.measures.iter().all(|measure| measure.verdict != Fitness::NotFit)
    }

    /// Names of what was not looked at, or not well enough for a verdict.
    #[must_use]
    pub fn open(&self) -> Vec<&'static str> {
        let is_open = |measure: &&Measure| measure.verdict <= Fitness::Uncertain;
        self.measures.iter().filter(is_open).map(|measure| measure.name).collect()
    }

    /// Number of measures with this verdict.
    #[must_use]
    pub fn count(&self, verdict: Fitness) -> usize {
        self.measures.iter().filter(|measure| measure.verdict == verdict).count()
    }

    /// The measure of this name.
    #[must_use]
    pub fn measure(&self, name: &str) -> Option<&Measure> {
        self.measures.iter().find(|measure| measure.name == name)
    }
}
