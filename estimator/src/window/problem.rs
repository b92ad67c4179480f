//! The states and measurements of a window, as its factors are given them.

use super::frame::Frame;
use super::landmark::{LineLandmark, PointLandmark};
use super::options::Options;
use super::refined_lens::MovedLenses;
use super::state::Rig;

/// Problem to be linearized.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a> {
    /// Calibration.
    pub rig: &'a Rig,
    /// Frames in order of time.
    pub frames: &'a [Frame],
    /// Points.
    pub points: &'a [PointLandmark],
    /// Lines.
    pub lines: &'a [LineLandmark],
    /// Options of the window.
    pub options: &'a Options,
    /// Lenses that have moved since measurements were corrected.
    pub(super) moved_lenses: MovedLenses<'a>,
}

impl<'a> Problem<'a> {
    /// The problem without its landmarks.
    pub fn of_frames(rig: &'a Rig, frames: &'a [Frame], options: &'a Options) -> Self {
        let moved_lenses = MovedLenses::of(options.lenses.as_ref(), rig);
        Self { rig, frames, points: &[], lines: &[], options, moved_lenses }
    }
}
