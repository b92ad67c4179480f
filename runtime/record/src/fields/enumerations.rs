//! Enumerations as fields: their names and comments in the schema.

use super::{Enumeration, Part, Shape, Value};
use crate::orders::{InstantOutcome, InstantSource};
use plumbline_estimator::{ResetKind, TrackingState};

/// Implements [`Part`] for an enumeration, which cannot be absent.
macro_rules! enumeration {
    ($type:ty, $about:expr, $otherwise:literal, [$($enumerator:ident),*]) => {
        impl Part for $type {
            const SHAPE: Shape = {
                static ABOUT: Enumeration = $about;
                Shape::Enumerator(&ABOUT)
            };

            fn get(&self) -> Value<'_> {
                Value::Whole(*self as i64)
            }

            fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
                let Value::Whole(place) = value else { return Err($otherwise) };
                let all = [$(Self::$enumerator),*];
                *self = *all.iter().find(|one| **one as i64 == place).ok_or($otherwise)?;
                Ok(())
            }
        }
    };
}

enumeration!(
    TrackingState,
    Enumeration {
        name: "State",
        first: 1,
        names: &["STATE_UNSPECIFIED", "STATE_INITIALISING", "STATE_TRACKING", "STATE_BLIND", "STATE_FAILED"],
        about: &["", "", "", "", ""],
    },
    "an unknown state",
    [Initialising, Tracking, Blind, Failed]
);
enumeration!(
    ResetKind,
    Enumeration {
        name: "ResetOrder.Kind",
        first: 1,
        names: &["KIND_UNSPECIFIED", "KIND_SOFT", "KIND_HARD"],
        about: &["", "The pose stays.", "The new start begins at the origin."],
    },
    "an unknown kind of reset",
    [Soft, Hard]
);
enumeration!(
    InstantSource,
    Enumeration {
        name: "InstantOrder.Source",
        first: 1,
        names: &["SOURCE_UNSPECIFIED", "SOURCE_REQUEST", "SOURCE_TRIGGER", "SOURCE_LIST"],
        about: &[
            "",
            "A program, over the local socket.",
            "The autopilot, which triggered a camera.",
            "A list that was given before the flight.",
        ],
    },
    "an unknown source",
    [Request, Trigger, List]
);
enumeration!(
    InstantOutcome,
    Enumeration {
        name: "Instant.Outcome",
        first: 1,
        names: &[
            "OUTCOME_UNSPECIFIED",
            "OUTCOME_ANSWERED",
            "OUTCOME_NO_POSE",
            "OUTCOME_TOO_OLD",
            "OUTCOME_AHEAD"
        ],
        about: &[
            "",
            "",
            "There was no pose then.",
            "It is longer ago than is kept.",
            "It is later than the newest inertial sample.",
        ],
    },
    "an unknown outcome",
    [Answered, NoPose, TooOld, Ahead]
);
