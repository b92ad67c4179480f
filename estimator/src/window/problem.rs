//! The states and measurements of a window, as its factors are given them.

use super::frame::Frame;
use super::landmark::{LineLandmark, PointLandmark};
use super::manhattan::Manhattan;
use super::options::Options;
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
    /// The Manhattan world.
    pub manhattan: &'a Manhattan,
    /// Options of the window.
    pub options: &'a Options,
}
