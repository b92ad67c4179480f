//! Observations by a row of a rolling shutter.
//!
//! The front-end has turned it to the axes that the camera has at the time of the frame ([`crate::shutter`]). What is left is the
//! way of the camera between row and frame, which moves a point of inverse depth `rho` by `rho way / z`: it is known once depth
//! and velocity are, and a measurement is put where a global shutter would have made it.

use nalgebra::Vector2;

/// A place as the row saw it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SeenByRow {
    /// Normalized coordinates, turned to the time of the frame.
    pub xy: Vector2<f64>,
    /// Time by which the row is later than the frame, s.
    pub late_s: f64,
}

impl SeenByRow {
    /// Moves the place by what `shift` makes of it; with a global shutter, whose rows are not late, nobody asks for it.
    #[inline]
    pub(super) fn shift(&mut self, shift: impl Fn(&Vector2<f64>) -> Vector2<f64>) {
        if self.late_s != 0.0 {
            self.xy += shift(&self.xy);
        }
    }
}
