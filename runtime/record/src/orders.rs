//! The order of a run: which frame was estimated after which samples, and at which level of work.
//!
//! In virtual time a rule gives these orders. In a live run the wall clock has a say in them (a frame
//! refused under overload, an estimate that came late), so they are inputs of the estimate like any sample:
//! the flight log holds them, and a re-execution follows the log instead of the rule.

use plumbline_config::Timestamp;
use plumbline_estimator::{Instant, ResetKind};

/// Order about a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameOrder {
    /// Sequence number of the frame.
    pub frame: u64,
    /// Inertial readings that the estimator had been given before it, counted from the start of the run.
    pub readings_before: u64,
    /// Estimation of the frame, or its omission.
    pub verdict: Verdict,
}

/// Estimation of a frame, or its omission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Estimated, at this level of the degradation ladder (0: everything).
    Taken {
        /// Steps down from everything.
        level: u8,
    },
    /// Refused: the estimator never saw it.
    Refused,
    /// Lost: whoever worked on it ended by a fault of its own. Told after it may have been told that it was taken.
    Lost,
}

/// When an estimate took effect on the odometry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CorrectionOrder {
    /// Sequence number of the frame that was estimated.
    pub frame: u64,
    /// Inertial readings that the odometry had been given before, counted from the start of the run.
    pub readings_before: u64,
}

/// When a reset took effect that somebody asked for, or that a fault of ours made necessary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResetOrder {
    /// Extent of the reset.
    pub kind: ResetKind,
    /// Sequence number of the first frame after it.
    pub before_frame: u64,
    /// Front-end and window were made anew: one of them had ended by a fault of its own.
    pub is_renewal: bool,
}

/// Order about a frame for the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapOrder {
    /// Sequence number of the frame.
    pub frame: u64,
    /// Fate of the frame.
    pub verdict: MapVerdict,
}

/// When the map took effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapVerdict {
    /// The results of the frame took effect with the estimate of frame `at_frame`.
    Applied {
        /// Sequence number of that frame.
        at_frame: u64,
    },
    /// The map never saw the frame: it was not done with the one before.
    PassedOver,
}

/// Source of a request for the state at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InstantSource {
    /// A program, over the local socket.
    #[default]
    Request,
    /// The autopilot, which triggered a camera.
    Trigger,
    /// A list that was given before the flight.
    List,
}

/// Request for the state at an instant, with its place in the input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstantOrder {
    /// Number of the request; of a trigger, the autopilot's; of a list, the row, from 0.
    pub number: u64,
    /// The instant, on the IMU's clock.
    pub stamp: Timestamp,
    /// Inertial readings that the odometry had been given before, counted from the start of the run.
    pub readings_before: u64,
    /// Source of the request.
    pub source: InstantSource,
}

/// Outcome of a request for the state at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InstantOutcome {
    /// Answer with a state.
    #[default]
    Answered,
    /// There was no pose then.
    NoPose,
    /// It is longer ago than is kept.
    TooOld,
    /// It is later than the newest inertial sample.
    Ahead,
}

impl InstantOutcome {
    /// Why there is no answer, in words; none where there is.
    #[must_use]
    pub const fn refusal(self) -> Option<&'static str> {
        match self {
            Self::Answered => None,
            Self::NoPose => Some("there was no pose at this instant"),
            Self::TooOld => {
                Some("the instant is longer ago than the flight keeps (3 s), or from another clock")
            }
            Self::Ahead => Some(
                "the instant is later than the newest inertial sample; wait for it, and stamp by the clock of the odometry",
            ),
        }
    }
}

/// Answer to an [`InstantOrder`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InstantAnswer {
    /// Counts the answers of the flight.
    pub sequence: u64,
    /// Number of the order.
    pub number: u64,
    /// Source of the request. The order holds it.
    pub source: InstantSource,
    /// Outcome of the request.
    pub outcome: InstantOutcome,
    /// The state; of a refusal only the stamp counts.
    pub instant: Instant,
}
