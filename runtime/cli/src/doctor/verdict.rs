//! Verdicts of the checks of the host and its equipment.

/// Verdict of a check.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum CheckVerdict {
    Fine(String),
    /// A flight is possible, with this against it.
    Poor(String),
    /// A part of the configured flight is unavailable.
    NotFit(String),
}

impl CheckVerdict {
    /// A mark, and what was found.
    pub(super) fn told(&self) -> (&'static str, &str) {
        match self {
            Self::Fine(words) => ("ok", words),
            Self::Poor(words) => ("poor", words),
            Self::NotFit(words) => ("not fit", words),
        }
    }

    pub(super) fn is_poor(&self) -> bool {
        matches!(self, Self::Poor(_))
    }

    pub(super) fn is_not_fit(&self) -> bool {
        matches!(self, Self::NotFit(_))
    }
}

/// A check by its name.
pub(super) type Check = (&'static str, CheckVerdict);
