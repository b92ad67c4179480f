//! The order of a run: which frame was estimated after which samples, and at which level of work.
//!
//! In virtual time a rule gives these orders. In a live run the wall clock has a say in them (a frame
//! refused under overload, an estimate that came late), so they are inputs of the estimate like any sample:
//! the flight log holds them, and a re-execution follows the log instead of the rule.

use plumbline_config::Timestamp;
use plumbline_estimator::{Instant, ResetKind};
use plumbline_fields::{Field, Record, Shape, Value};

/// Order about a frame: what became of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Record)]
#[record("FrameOrder", Self::REFUSED, Self::LEVEL, Self::LOST)]
pub struct FrameOrder {
    /// Sequence number of the frame.
    #[field(1)]
    pub frame: u64,
    /// Inertial readings that the estimator had been given before it, counted from the start of the run.
    #[field(2)]
    pub readings_before: u64,
    /// Estimation of the frame, or its omission.
    #[field(none)]
    pub verdict: Verdict,
}

impl FrameOrder {
    const REFUSED: Field<Self> = Field::new(
        (3, "refused", "refused", "The estimator never saw it."),
        Shape::Flag,
        |o| Value::Whole((o.verdict == Verdict::Refused).into()),
        |o, value| o.set_if(value, Verdict::Refused),
    );
    const LEVEL: Field<Self> = Field::new(
        (4, "level", "level", "Steps down from full work; 0 when refused."),
        Shape::Uint32,
        |o| Value::Whole(if let Verdict::Taken { level } = o.verdict { level.into() } else { 0 }),
        |o, value| {
            let given = u8::try_from(value.whole()).map_err(|_| "a level out of range")?;
            if let Verdict::Taken { level } = &mut o.verdict {
                *level = given;
            }
            Ok(())
        },
    );
    const LOST: Field<Self> = Field::new(
        (
            5,
            "lost",
            "lost",
            "Front-end or window ended by a fault of its own while it had the frame: there is no estimate, whatever an order \
             before this one said.",
        ),
        Shape::Flag,
        |o| Value::Whole((o.verdict == Verdict::Lost).into()),
        |o, value| o.set_if(value, Verdict::Lost),
    );

    #[allow(clippy::unnecessary_wraps, reason = "as a field is written")]
    fn set_if(&mut self, value: Value<'_>, verdict: Verdict) -> Result<(), &'static str> {
        if value.whole() != 0 {
            self.verdict = verdict;
        }
        Ok(())
    }
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

impl Default for Verdict {
    fn default() -> Self {
        Self::Taken { level: 0 }
    }
}

/// When an estimate took effect on the odometry.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Record)]
#[record("CorrectionOrder")]
pub struct CorrectionOrder {
    /// Sequence number of the frame that was estimated.
    #[field(1)]
    pub frame: u64,
    /// Inertial readings that the odometry had been given before, counted from the start of the run.
    #[field(2)]
    pub readings_before: u64,
}

/// When a reset took effect that somebody asked for, or that a fault of ours made necessary.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Record)]
#[record("ResetOrder")]
pub struct ResetOrder {
    /// Extent of the reset.
    #[field(1)]
    pub kind: ResetKind,
    /// Sequence number of the first frame after it.
    #[field(2)]
    pub before_frame: u64,
    /// Front-end and window were made anew: one of them had ended by a fault of its own.
    #[field(3, wire = "renewal")]
    pub is_renewal: bool,
}

/// Order about a frame for the map: what became of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Record)]
#[record("MapOrder", Self::PASSED_OVER, Self::AT_FRAME)]
pub struct MapOrder {
    /// Sequence number of the frame.
    #[field(1)]
    pub frame: u64,
    /// Fate of the frame.
    #[field(none)]
    pub verdict: MapVerdict,
}

impl MapOrder {
    const PASSED_OVER: Field<Self> = Field::new(
        (2, "passed_over", "passed_over", "The map never saw it: it was not done with the one before."),
        Shape::Flag,
        |o| Value::Whole((o.verdict == MapVerdict::PassedOver).into()),
        |o, value| {
            if value.whole() != 0 {
                o.verdict = MapVerdict::PassedOver;
            }
            Ok(())
        },
    );
    const AT_FRAME: Field<Self> = Field::new(
        (3, "at_frame", "at_frame", "Else what was found took effect with the estimate of this frame."),
        Shape::Uint64,
        |o| Value::Whole(if let MapVerdict::Applied { at_frame } = o.verdict { at_frame as i64 } else { 0 }),
        |o, value| {
            if let MapVerdict::Applied { at_frame } = &mut o.verdict {
                *at_frame = value.whole() as u64;
            }
            Ok(())
        },
    );
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

impl Default for MapVerdict {
    fn default() -> Self {
        Self::Applied { at_frame: 0 }
    }
}

/// Source of a request for the state at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Record)]
#[record("InstantOrder.Source", "an unknown source")]
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Record)]
#[record("InstantOrder")]
pub struct InstantOrder {
    /// Number of the request; of a trigger, the autopilot's; of a list, the row, from 0.
    #[field(1)]
    pub number: u64,
    /// The instant, on the IMU's clock.
    #[field(2, wire = "stamp_ns")]
    pub stamp: Timestamp,
    /// Inertial readings that the odometry had been given before, counted from the start of the run.
    #[field(3)]
    pub readings_before: u64,
    /// Source of the request.
    #[field(4)]
    pub source: InstantSource,
}

/// Outcome of a request for the state at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Record)]
#[record("Instant.Outcome", "an unknown outcome")]
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

/// State at an instant that was asked for: the answer to an order.
#[derive(Clone, Debug, Default, PartialEq, Record)]
#[record("Instant")]
pub struct InstantAnswer {
    /// Counts the answers of the flight.
    #[field(1)]
    pub sequence: u64,
    /// Number of the order.
    #[field(2, at = 16)]
    pub number: u64,
    /// Source of the request. The order holds it.
    #[field(none)]
    pub source: InstantSource,
    /// Outcome of the request.
    #[field(3, at = 502)]
    pub outcome: InstantOutcome,
    /// The state; of a refusal only the stamp counts.
    #[field(4, path = stamp, wire = "stamp_ns", at = 0, about = "The instant.")]
    #[field(5, path = pose_o_b, at = 24, about = "Body in O. Like all below, without meaning where it was refused.")]
    #[field(6, path = v_o_b, wire = "velocity_o_b", at = 80, about = "m/s, in O.")]
    #[field(7, path = angular_rate_b, at = 104, about = "rad/s, bias removed, in B.")]
    #[field(8, path = covariance, at = 128, about = "Covariance of position (m), attitude (rad) and velocity (m/s).")]
    #[field(9, path = state, at = 500)]
    #[field(10, path = quality, at = 501)]
    #[field(11, path = reset_counter, at = 496)]
    #[field(12, path = estimated, wire = "estimated_ns", at = 488, about = "Time of the estimate before the instant.")]
    #[field(
        13, path = is_settled, wire = "settled", at = 503,
        about = "There is an estimate after the instant too: the answer would not change any more."
    )]
    pub instant: Instant,
}
