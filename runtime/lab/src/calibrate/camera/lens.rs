//! The intrinsics of a camera as eight unknowns, and a projection with its derivatives by them.
//!
//! `(fx, fy, cx, cy)` and the four coefficients of the distortion, for both models of [`plumbline_config::camera`].

use nalgebra::Matrix2x3;
use nalgebra::{SMatrix, SVector, Vector2, Vector3};
use plumbline_config::CameraModel;
use plumbline_config::camera::Distortion;

/// Unknowns of a camera.
pub const LENS: usize = 8;
/// What the unknowns are called, by the model of the distortion.
const RADTAN_NAMES: [&str; LENS] = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"];
const EQUIDISTANT_NAMES: [&str; LENS] = ["fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"];
/// Closest point that has a pixel, m.
const MIN_DEPTH_M: f64 = 1e-3;

/// Which model of distortion is calibrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LensKind {
    /// Radial and tangential distortion: lenses up to some 100 degrees.
    RadialTangential,
    /// Fisheye lenses.
    Equidistant,
}

impl LensKind {
    /// The model with these coefficients.
    #[must_use]
    pub fn distortion(self, [a, b, c, d]: [f64; 4]) -> Distortion {
        match self {
            Self::RadialTangential => Distortion::RadialTangential { k1: a, k2: b, p1: c, p2: d },
            Self::Equidistant => Distortion::Equidistant { k1: a, k2: b, k3: c, k4: d },
        }
    }
}

/// What the unknowns of a camera are called.
#[must_use]
pub fn names(model: &CameraModel) -> [&'static str; LENS] {
    match model.distortion {
        Distortion::RadialTangential { .. } => RADTAN_NAMES,
        Distortion::Equidistant { .. } => EQUIDISTANT_NAMES,
    }
}

/// The unknowns of a camera.
#[must_use]
pub fn unknowns(model: &CameraModel) -> SVector<f64, LENS> {
    let k = match model.distortion {
        Distortion::RadialTangential { k1, k2, p1, p2 } => [k1, k2, p1, p2],
        Distortion::Equidistant { k1, k2, k3, k4 } => [k1, k2, k3, k4],
    };
    let (f, c) = (model.focal_px, model.centre_px);
    SVector::from([f.x, f.y, c.x, c.y, k[0], k[1], k[2], k[3]])
}

/// The camera with its unknowns changed by `step`.
#[must_use]
pub fn stepped(model: &CameraModel, step: &SVector<f64, LENS>) -> CameraModel {
    let u = unknowns(model) + step;
    let kind = match model.distortion {
        Distortion::RadialTangential { .. } => LensKind::RadialTangential,
        Distortion::Equidistant { .. } => LensKind::Equidistant,
    };
    CameraModel {
        focal_px: Vector2::new(u[0], u[1]),
        centre_px: Vector2::new(u[2], u[3]),
        distortion: kind.distortion([u[4], u[5], u[6], u[7]]),
        ..*model
    }
}

/// A pixel and its derivatives.
pub struct Projection {
    /// The pixel.
    pub px: Vector2<f64>,
    /// By the point in the camera frame, px/m.
    pub by_point: Matrix2x3<f64>,
    /// By the unknowns of the camera.
    pub by_lens: SMatrix<f64, 2, LENS>,
}

/// Projects a point in the camera frame, m; `None` behind the camera. Beyond the reach of the lens model the formula is
/// followed, so that a solution on its way is not held up there.
#[must_use]
pub fn project(model: &CameraModel, p_c: &Vector3<f64>) -> Option<Projection> {
    if p_c.z.is_nan() || p_c.z < MIN_DEPTH_M {
        return None;
    }
    let inv_z = 1.0 / p_c.z;
    let xy = Vector2::new(p_c.x * inv_z, p_c.y * inv_z);
    let (px, by_xy) = model.project_normalized(&xy);
    let xy_by_point = Matrix2x3::new(inv_z, 0.0, -xy.x * inv_z, 0.0, inv_z, -xy.y * inv_z);
    let mut by_lens = SMatrix::zeros();
    let distorted = (px - model.centre_px).component_div(&model.focal_px);
    by_lens[(0, 0)] = distorted.x;
    by_lens[(1, 1)] = distorted.y;
    by_lens[(0, 2)] = 1.0;
    by_lens[(1, 3)] = 1.0;
    for (k, by) in distorted_by_coefficients(&model.distortion, &xy).iter().enumerate() {
        by_lens[(0, 4 + k)] = model.focal_px.x * by.x;
        by_lens[(1, 4 + k)] = model.focal_px.y * by.y;
    }
    Some(Projection { px, by_point: by_xy * xy_by_point, by_lens })
}

fn distorted_by_coefficients(distortion: &Distortion, xy: &Vector2<f64>) -> [Vector2<f64>; 4] {
    let (x, y, r2) = (xy.x, xy.y, xy.norm_squared());
    match distortion {
        Distortion::RadialTangential { .. } => [
            xy * r2,
            xy * (r2 * r2),
            Vector2::new(2.0 * x * y, r2 + 2.0 * y * y),
            Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y),
        ],
        Distortion::Equidistant { .. } => {
            let r = r2.sqrt();
            let theta = r.atan();
            // Near the axis theta³ / r vanishes.
            let unit = if r < 1e-8 { Vector2::zeros() } else { xy / r };
            [3, 5, 7, 9].map(|power| unit * theta.powi(power))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_differences() {
        for kind in [LensKind::RadialTangential, LensKind::Equidistant] {
            let model = CameraModel {
                width_px: 640,
                height_px: 480,
                focal_px: Vector2::new(410.0, 405.0),
                centre_px: Vector2::new(311.0, 245.0),
                distortion: kind.distortion([-0.2, 0.05, 0.001, -0.002]),
            };
            for p_c in
                [Vector3::new(0.3, -0.4, 1.1), Vector3::new(-0.7, 0.2, 0.9), Vector3::new(0.0, 1e-3, 2.0)]
            {
                let at = project(&model, &p_c).unwrap();
                assert!((at.px - model.project(&p_c).unwrap()).norm() < 1e-12);
                for k in 0..LENS {
                    let mut step = SVector::zeros();
                    step[k] = 1e-6;
                    let px = |s: &SVector<f64, LENS>| project(&stepped(&model, s), &p_c).unwrap().px;
                    let numeric = (px(&step) - px(&-step)) / 2e-6;
                    assert!((numeric - at.by_lens.column(k)).norm() < 1e-5, "{kind:?} {}", names(&model)[k]);
                }
                for axis in 0..3 {
                    let mut step = Vector3::zeros();
                    step[axis] = 1e-6;
                    let px = |s: &Vector3<f64>| project(&model, &(p_c + s)).unwrap().px;
                    let numeric = (px(&step) - px(&-step)) / 2e-6;
                    assert!((numeric - at.by_point.column(axis)).norm() < 1e-4, "{kind:?} {axis}");
                }
            }
        }
    }

    #[test]
    fn what_is_behind_the_camera_has_no_pixel() {
        let distortion = LensKind::RadialTangential.distortion([0.0; 4]);
        let (focal_px, centre_px) = (Vector2::repeat(400.0), Vector2::repeat(300.0));
        let model = CameraModel { width_px: 600, height_px: 600, focal_px, centre_px, distortion };
        assert!(project(&model, &Vector3::new(0.0, 0.0, -1.0)).is_none());
        assert!(project(&model, &Vector3::new(0.0, 0.0, f64::NAN)).is_none());
    }
}
