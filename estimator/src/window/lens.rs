//! Intrinsics of the cameras as unknowns: by how much the configured ones are off.
//!
//! A camera of focal length `f (1 + s)` and principal point `c + f t` sees at a place `z` of the normalized image, as the
//! configured lens `z_d = D(z)` has it,
//!
//! ```text
//! z' = z - J (s, t)        J = (dD/dz)⁻¹ (z_d  I)
//! ```
//!
//! which is exact to first order. Measurements are kept at the intrinsics of a *reference*, which follows every solution: so
//! whatever looks at a measurement (triangulation, outliers, epipolar lines) sees refined ones. Within a solution residuals
//! are those of measurements moved by what the present intrinsics differ.

use super::state::{INTRINSICS_DIM, RIG_DIM, Rig};
use nalgebra::{Matrix2x3, SVector, Vector2, Vector3};
use plumbline_config::{CameraModel, Portable, ValidSetup};

/// Cells of a table, along and across the image: within one, `J` varies by some percents at the rim of a wide lens.
const CELLS: [usize; 2] = [48, 32];

/// Largest step of the intrinsics in which a place keeps its `J`.
const MOST_STEP: f64 = 5e-3;

/// `J` over the image of a camera.
#[derive(Clone, Debug)]
pub(super) struct Lens {
    least: Vector2<f64>,
    cells_per_unit: Vector2<f64>,
    by: Vec<Matrix2x3<f32>>,
}

impl Lens {
    /// Parameters whose `mask` is zero have no derivative.
    fn of(camera: &CameraModel, mask: &Vector3<f64>) -> Self {
        let (width, height) = (camera.width_px as f64 - 1.0, camera.height_px as f64 - 1.0);
        let share = |k: usize| k as f64 / 8.0;
        let rim = (0..=8).flat_map(|k| {
            let (x, y) = (share(k) * width, share(k) * height);
            [(x, 0.0), (x, height), (0.0, y), (width, y)].map(|(x, y)| Vector2::new(x, y))
        });
        let (mut least, mut most) = (Vector2::repeat(-0.1), Vector2::repeat(0.1));
        for xy in rim.filter_map(|px| camera.unproject(&px)) {
            (least, most) = (least.inf(&xy), most.sup(&xy));
        }
        let cells = Vector2::new(CELLS[0] as f64, CELLS[1] as f64);
        let cells_per_unit = cells.component_div(&(most - least));
        let cell = |k: usize| {
            let at = Vector2::new((k % CELLS[0]) as f64 + 0.5, (k / CELLS[0]) as f64 + 0.5);
            let by = derivative(camera, &(least + at.component_div(&cells_per_unit)));
            Matrix2x3::from_fn(|i, k| (by[(i, k)] * mask[k]) as f32)
        };
        Self { least, cells_per_unit, by: (0..CELLS[0] * CELLS[1]).map(cell).collect() }
    }

    #[inline]
    pub(super) fn at(&self, xy: &Vector2<f64>) -> &Matrix2x3<f32> {
        let at = (xy - self.least).component_mul(&self.cells_per_unit);
        // Conversions saturate, and what is no number becomes zero; those to 32 bits are quicker.
        let cell = |at: f64, cells: usize| (at as i32).clamp(0, cells as i32 - 1) as usize;
        &self.by[cell(at.y, CELLS[1]) * CELLS[0] + cell(at.x, CELLS[0])]
    }

    /// Shift of what was measured at `xy` when the intrinsics move by `step`.
    #[inline]
    pub(super) fn shift(&self, xy: &Vector2<f64>, step: &Vector3<f64>) -> Vector2<f64> {
        -(self.at(xy).cast::<f64>() * step)
    }
}

/// `J` at `xy`; that of an ideal lens where the configured one folds.
fn derivative(camera: &CameraModel, xy: &Vector2<f64>) -> Matrix2x3<f64> {
    let (distorted, by_xy) = camera.distortion.distort(xy);
    let inverse = by_xy.try_inverse().filter(|_| camera.distortion.is_regular(xy));
    let of = |z: &Vector2<f64>| Matrix2x3::new(z.x, 1.0, 0.0, z.y, 0.0, 1.0);
    inverse.map_or_else(|| of(xy), |inverse| inverse * of(&distorted))
}

/// Lenses of a rig whose intrinsics are refined.
#[derive(Clone, Debug)]
pub struct Lenses {
    pub(super) lenses: Vec<Lens>,
    /// Intrinsics that the measurements of the window are corrected by.
    pub(super) reference: [Vector3<f64>; 2],
}

impl Lenses {
    /// Lenses of a configuration; `None` where `sigmas` leave no intrinsics to refine.
    pub fn of(config: &ValidSetup, sigmas: &SVector<f64, RIG_DIM>) -> Option<Self> {
        let mask = |k: usize| {
            let sigmas = sigmas.fixed_rows::<INTRINSICS_DIM>(Rig::of_lens(k));
            sigmas.map(|sigma| if sigma > 0.0 { 1.0 } else { 0.0 })
        };
        let cameras = config.camera.iter().enumerate().take(2);
        let is_refined = cameras.clone().any(|(k, _)| mask(k) != Vector3::zeros());
        let lenses = || cameras.map(|(k, camera)| Lens::of(&camera.model(), &mask(k))).collect();
        is_refined.then(|| Self { lenses: lenses(), reference: [Vector3::zeros(); 2] })
    }

    /// Step of the intrinsics of `camera` from the reference.
    #[inline]
    pub fn step(&self, rig: &Rig, camera: usize) -> Vector3<f64> {
        rig.intrinsics[camera] - self.reference[camera]
    }

    /// Shift of what `camera` measured at `xy` when its intrinsics move by `step`, in parts that derivatives hold for.
    pub(super) fn shift(&self, camera: usize, xy: &Vector2<f64>, step: &Vector3<f64>) -> Vector2<f64> {
        // A step by a whole focal length is that of an estimate that has been lost: its time is bounded all the same.
        let parts = (step.amax() / MOST_STEP).ceil().at_least(1.0).at_most(1.0 / MOST_STEP);
        let part = step / parts;
        let shifted = |shift, _| shift + self.lenses[camera].shift(&(xy + shift), &part);
        (0..parts as usize).fold(Vector2::zeros(), shifted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Config;

    #[test]
    fn a_place_moves_as_the_intrinsics_say() {
        let config = Config::preset("euroc").expect("is good");
        let camera = config.setup().camera[0].model();
        let lens = Lens::of(&camera, &Vector3::repeat(1.0));
        let step = Vector3::new(3e-3, -2.0 / camera.focal_px.x, 1.5 / camera.focal_px.y);
        let mut moved = camera;
        moved.focal_px *= 1.0 + step.x;
        moved.centre_px += step.yz().component_mul(&camera.focal_px);
        for px in
            [(40.0, 30.0), (376.0, 240.0), (700.0, 450.0), (20.0, 400.0)].map(|(x, y)| Vector2::new(x, y))
        {
            let [before, after] =
                [&camera, &moved].map(|camera| camera.unproject(&px).expect("is in the image"));
            let predicted = before - lens.at(&before).cast::<f64>() * step;
            let off_px = (predicted - after).norm() * camera.focal_px.x;
            let moved_px = (after - before).norm() * camera.focal_px.x;
            assert!(moved_px > 1.0 && off_px < 0.03 * moved_px, "{px}: off by {off_px} of {moved_px} px");
        }
    }
}
