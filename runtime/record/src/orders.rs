//! The order of a run: which frame was estimated after which samples, and at which level of work.
//!
//! In virtual time a rule gives these orders. In a live run the wall clock has a say in them (a frame
//! refused under overload, an estimate that came late), so they are inputs of the estimate like any sample:
//! the flight log holds them, and a re-execution follows the log instead of the rule.

use plumbline_estimator::ResetKind;

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
