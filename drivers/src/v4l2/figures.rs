//! Figures of the cameras while they run, for other threads.

use crate::board::Board;
use crate::clock::StampProblem;
use serde::Serialize;

/// Figures of one camera. Of a device that gives both images, the first camera's figures are the device's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct V4l2CameraFigures {
    /// Images that came whole.
    pub images: u64,
    /// Images missing by the numbers of its driver.
    pub missing: u64,
    /// Images that the driver called damaged, or that could not be decoded.
    pub corrupt: u64,
    /// Images with a stamp that is not after that of the image before; not handed out.
    pub disordered: u64,
    /// Images stamped by their arrival, since the driver's stamp was of no clock or of the future.
    pub restamped: u64,
    /// Defect of the stamps, if any.
    #[serde(skip)]
    pub problem: Option<StampProblem>,
    /// Images handed out without their partner.
    pub alone: u64,
    /// Number of times its stream was started.
    pub started: u64,
    /// Number of times it was lost or fell silent.
    pub lost: u64,
    /// Length of the exposure that stamps were shifted by half of, ms; 0 where it is not known.
    pub exposure_ms: f64,
    /// Time from the middle of the exposure to the arrival: mean of the last images and largest, ms.
    pub delay_ms: f64,
    /// The largest.
    pub max_delay_ms: f64,
}

/// Figures of both cameras together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct V4l2Figures {
    /// Left and right.
    pub cameras: [V4l2CameraFigures; 2],
    /// Frames handed out.
    #[serde(skip)]
    pub frames: u64,
    /// Frames of two images.
    #[serde(skip)]
    pub pairs: u64,
    /// Pairs whose stamps are further from each other than `driver.pair_tolerance_s`: the cameras do not expose together,
    /// or their drivers' delays differ.
    pub apart: u64,
    /// Right less left stamp in the mean of the last pairs, ms.
    pub offset_ms: f64,
    /// Largest deviation of a pair from that mean, ms.
    pub max_jitter_ms: f64,
    /// Measured time from image to image, ms.
    pub period_ms: f64,
}

/// Shows the figures of a [`V4l2Stereo`](super::V4l2Stereo) to other threads. Copies show the same.
#[derive(Clone, Debug, Default)]
pub struct V4l2Monitor {
    figures: Board<V4l2Figures>,
    trouble: Board<[Option<String>; 2]>,
}

impl V4l2Monitor {
    /// The figures up to the last frame.
    pub fn figures(&self) -> V4l2Figures {
        self.figures.read()
    }

    /// Reasons why left and right camera do not stream; `None` while they do.
    pub fn trouble(&self) -> [Option<String>; 2] {
        self.trouble.read()
    }

    /// Shows these from now on; where somebody is reading at the moment, the next ones.
    pub(super) fn show(&self, figures: &V4l2Figures) {
        self.figures.show(|| *figures);
    }

    pub(super) fn set_trouble(&self, camera: usize, trouble: Option<String>) {
        self.trouble.change(|shown| shown[camera] = trouble);
    }
}
