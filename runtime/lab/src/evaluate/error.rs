//! Why two trajectories cannot be compared.

use super::Delta;
use plumbline_config::Timestamp;
use plumbline_drivers::DriverError;
use plumbline_flight::flight::FlightError;
use thiserror::Error;

/// Which of the two trajectories.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The one that is judged.
    Estimate,
    /// The one it is held against.
    Reference,
}

impl std::fmt::Display for Side {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Estimate => "estimate",
            Self::Reference => "reference",
        })
    }
}

/// Why two trajectories cannot be compared.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EvaluateError {
    /// A file could not be read.
    #[error(transparent)]
    Read(#[from] DriverError),
    /// The truth of a data set cannot be read.
    #[error(transparent)]
    Truth(#[from] FlightError),
    /// A trajectory has no poses.
    #[error("the {0} contains no pose")]
    Empty(Side),
    /// A pose has a component that is not a finite number.
    #[error("pose {index} of the {side} is not finite")]
    NotFinite {
        /// Which trajectory.
        side: Side,
        /// Index of the pose, from 0.
        index: usize,
    },
    /// The trajectories have no time in common.
    #[error(
        "no stamps within {max_difference_s} s of each other: the estimate runs from {} to {} s, the reference \
         from {} to {} s; {}",
        estimate.0, estimate.1, reference.0, reference.1, why_apart(*estimate, *reference)
    )]
    NoCommonStamps {
        /// First and last stamp of the estimate.
        estimate: (Timestamp, Timestamp),
        /// First and last stamp of the reference.
        reference: (Timestamp, Timestamp),
        /// Largest difference of stamps that was allowed, s.
        max_difference_s: f64,
    },
    /// Fewer pairs than the figure needs.
    #[error("only {found} common stamps, at least {needed} are needed; is the estimate complete?")]
    TooFew {
        /// Pairs there are.
        found: usize,
        /// Pairs there must be.
        needed: usize,
    },
    /// The positions lie in one point or on one line: no rotation can be told.
    #[error(
        "the positions lie in a point or on a line, so no alignment is defined; align by the origin instead"
    )]
    Degenerate,
    /// No two poses are that far apart.
    #[error("no two poses are {0} apart; give a smaller delta")]
    NoPairs(Delta),
    /// The distance of relative errors is not a positive number.
    #[error("invalid delta {0}; it must be above zero")]
    BadDelta(Delta),
}

/// Probable cause of stamps that have no time in common.
fn why_apart(estimate: (Timestamp, Timestamp), reference: (Timestamp, Timestamp)) -> String {
    const UNITS: [(&str, f64); 3] = [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)];
    let factor = reference.1.seconds_since(reference.0) / estimate.1.seconds_since(estimate.0);
    let named = |(side, factor): (Side, f64)| {
        let unit = UNITS.iter().find(|(_, unit)| (0.5..2.0).contains(&(factor / unit)));
        unit.map(|(unit, _)| {
            format!("the stamps of the {side} are probably in {unit}: write them in seconds")
        })
    };
    let sides = [(Side::Reference, factor), (Side::Estimate, 1.0 / factor)];
    sides.into_iter().find_map(named).unwrap_or_else(|| {
        "are they of the same flight? If their clocks differ, give the shift with --time-offset".into()
    })
}
