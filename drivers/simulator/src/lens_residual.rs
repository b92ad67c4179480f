//! Difference between a lens and its calibration: what is left after the adjustment of a good one.
//!
//! An adjustment over the whole image leaves no residual of low order. Boards are seldom seen in the corners, where a polynomial of
//! four coefficients no longer fits. In the distance `rho` from the middle, 1 at the corners,
//!
//! ```text
//! d(rho) = a (w (7.8 rho³ - 8.8 rho⁵) + (1 + w) rho¹³)
//! ```
//!
//! is `w a` at 0.6 and `a` at the corners. A part that lies in one direction, `t a (rho² - 1/2)`, stands for a tilted sensor.

use crate::random::{Draws, Purpose};
use nalgebra::Vector2;
use plumbline_config::{CameraModel, Portable};

/// Share of the stated size that the radial part of a lens has at least, and share of the part in one direction.
const LEAST_RADIAL: f64 = 0.6;
const TILT: f64 = 0.1;
/// Share `w` of the wave within the image, before the corners.
const WAVE: f64 = 0.15;

/// Shift of the image of a lens against its calibration.
#[derive(Clone, Copy, Debug)]
pub(super) struct LensResidual {
    /// Radial part at the corners, px.
    radial_px: f64,
    /// Part in one direction, px.
    tilt_px: Vector2<f64>,
}

impl LensResidual {
    /// Lens as calibrated.
    #[cfg(test)]
    pub(super) const NONE: Self = Self { radial_px: 0.0, tilt_px: Vector2::new(0.0, 0.0) };

    /// Draws the residual of a camera, of the size `px`.
    pub(super) fn draw(px: f64, seed: u64, camera: usize) -> Self {
        let mut draws = Draws::new(seed, Purpose::Lens, camera as u64);
        let sign = if draws.unit() < 0.5 { -1.0 } else { 1.0 };
        let radial_px = sign * px * draws.range(LEAST_RADIAL, 1.0);
        let (sin, cos) = libm::sincos(draws.range(0.0, std::f64::consts::TAU));
        Self { radial_px, tilt_px: Vector2::new(cos, sin) * (TILT * px) }
    }

    /// Pixel at which a lens as calibrated shows what this one shows at `px`.
    pub(super) fn undone(&self, px: &Vector2<f64>, model: &CameraModel) -> Vector2<f64> {
        if self.radial_px == 0.0 {
            return *px;
        }
        let centre = Vector2::new(model.width_px as f64 - 1.0, model.height_px as f64 - 1.0) * 0.5;
        let from_centre = (px - centre) / centre.norm();
        let r2 = from_centre.norm_squared();
        px - from_centre * (radial_profile(r2) * self.radial_px) - self.tilt_px * (r2 - 0.5)
    }
}

/// Radial part over the distance from the middle, for a size of 1 px; `r2` is the square of that distance.
fn radial_profile(r2: f64) -> f64 {
    WAVE * r2 * (7.8 - 8.8 * r2) + (1.0 + WAVE) * r2.squared().squared() * r2.squared()
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    #[test]
    fn shifts_of_a_lens_are_as_large_as_stated() {
        let model = fixture::config().camera[0].model();
        let mut largest = 0.0_f64;
        for (seed, camera) in (0..20).flat_map(|seed| [(seed, 0), (seed, 1)]) {
            let residual = LensResidual::draw(1.0, seed, camera);
            let shift =
                |u: f64, v: f64| (residual.undone(&Vector2::new(u, v), &model) - Vector2::new(u, v)).norm();
            let within = shift(375.5, 239.5).max(shift(605.5, 379.5));
            assert!(within < 0.25 && shift(0.0, 0.0) > 0.5, "{residual:?}");
            let places =
                (0..24).flat_map(|i| (0..15).map(move |j| (32.0 * f64::from(i), 32.0 * f64::from(j))));
            largest = places.map(|(u, v)| shift(u, v)).fold(largest, f64::max);
        }
        assert!((0.8..1.1).contains(&largest), "{largest}");
    }

    #[test]
    fn cameras_and_seeds_have_lenses_of_their_own() {
        let model = fixture::config().camera[0].model();
        let at =
            |seed, camera| LensResidual::draw(0.3, seed, camera).undone(&Vector2::new(700.0, 400.0), &model);
        assert!(at(1, 0) == at(1, 0) && at(1, 0) != at(1, 1) && at(1, 0) != at(2, 0));
        let px = Vector2::new(700.0, 400.0);
        assert!(LensResidual::draw(0.0, 1, 0).undone(&px, &model) == px);
    }
}
