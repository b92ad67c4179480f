//! One camera of a pair that is late by whole frames: what was found, and its cure.

use plumbline_config::Config;

/// One camera is late by whole frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lag {
    /// Frames by which the right camera is late; negative where the left one is.
    pub frames: i8,
    /// Median epipolar error with images of one moment, and as they came, px.
    pub errors_px: (f64, f64),
}

impl Lag {
    /// Finding in words.
    #[must_use]
    pub fn words(&self) -> String {
        let (side, count) = (self.late(), self.frames.unsigned_abs());
        let frames = if count == 1 { "frame" } else { "frames" };
        format!(
            "left and right are of different moments: the {side} camera is late by {count} {frames} (median {:.2} px with images of one \
             moment, {:.2} px as they came)",
            self.errors_px.0, self.errors_px.1
        )
    }

    /// Cure.
    pub(crate) fn cure(&self, config: &Config) -> String {
        let rate_hz = config.camera.first().map_or(f64::NAN, |camera| camera.rate_hz);
        format!(
            "pair the images by the stamps of their exposure, not by their arrival: the {} camera's images are {:.0} ms older than \
             their stamps",
            self.late(),
            1e3 * f64::from(self.frames.unsigned_abs()) / rate_hz
        )
    }

    fn late(&self) -> &'static str {
        if self.frames > 0 { "right" } else { "left" }
    }
}
