//! The intrinsics of a camera as unknowns, and a projection with its derivatives by them.
//!
//! `(fx, fy, cx, cy)` and the coefficients of the lens, for all models of [`plumbline_config::camera`]. Unknowns that a model
//! lacks stand at the end; nothing depends on them.

use nalgebra::Matrix2x3;
use nalgebra::{SMatrix, SVector, Vector2, Vector3};
use plumbline_config::CameraModel;
use plumbline_config::camera::{Distortion, MAX_COEFFICIENTS};

/// Unknowns of a camera, of the lens with the most.
pub const LENS: usize = INTRINSICS + MAX_COEFFICIENTS;
const INTRINSICS: usize = 4;
/// Closest point that has a pixel, m.
const MIN_DEPTH_M: f64 = 1e-3;

/// Lenses that can be calibrated: name, what it is for, and the distortion from which its calibration begins.
pub const LENSES: [(&str, &str, Distortion); 6] = [
    (
        "radtan",
        "Radial and tangential: lenses up to about 100 degrees",
        Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 },
    ),
    ("equidistant", "Fisheye", Distortion::Equidistant { k1: 0.0, k2: 0.0, k3: 0.0, k4: 0.0 }),
    (
        "rational",
        "OpenCV's rational model (eight coefficients): wide lenses up to about 130 degrees",
        Distortion::Rational { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, k4: 0.0, k5: 0.0, k6: 0.0 },
    ),
    (
        "omni",
        "Unified model with radial and tangential distortion (Kalibr's omni-radtan): fisheye",
        Distortion::Omni { xi: 1.0, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 },
    ),
    (
        "eucm",
        "Enhanced unified model: fisheye, by two coefficients",
        Distortion::Eucm { alpha: 0.5, beta: 1.0 },
    ),
    (
        "double-sphere",
        "Double sphere: fisheye, by two coefficients",
        Distortion::DoubleSphere { xi: 0.0, alpha: 0.5 },
    ),
];

/// Names of the unknowns of a camera.
pub fn names(model: &CameraModel) -> Vec<&'static str> {
    let of_lens = model.distortion.coefficients().into_iter().map(|(name, _)| name);
    ["fx", "fy", "cx", "cy"].into_iter().chain(of_lens).collect()
}

/// The unknowns of a camera; 0 for those that its lens lacks.
pub fn unknowns(model: &CameraModel) -> SVector<f64, LENS> {
    let mut all: SVector<f64, LENS> = SVector::zeros();
    all.fixed_rows_mut::<2>(0).copy_from(&model.focal_px);
    all.fixed_rows_mut::<2>(2).copy_from(&model.centre_px);
    for (k, (_, value)) in model.distortion.coefficients().into_iter().enumerate() {
        all[INTRINSICS + k] = value;
    }
    all
}

/// The camera with its unknowns changed by `step`.
pub fn stepped(model: &CameraModel, step: &SVector<f64, LENS>) -> CameraModel {
    let u = unknowns(model) + step;
    CameraModel {
        focal_px: Vector2::new(u[0], u[1]),
        centre_px: Vector2::new(u[2], u[3]),
        distortion: model.distortion.with_coefficients(&u.as_slice()[INTRINSICS..]),
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
    for (k, by) in model.distortion.by_coefficients(&xy).iter().enumerate() {
        by_lens[(0, INTRINSICS + k)] = model.focal_px.x * by.x;
        by_lens[(1, INTRINSICS + k)] = model.focal_px.y * by.y;
    }
    Some(Projection { px, by_point: by_xy * xy_by_point, by_lens })
}

/// The distortion from which the calibration of a lens of [`LENSES`] begins.
#[cfg(test)]
pub(super) fn lens_named(name: &str) -> Distortion {
    LENSES.iter().find(|(known, ..)| *known == name).map(|(.., distortion)| *distortion).expect("is known")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_differences() {
        let coefficients: [&[f64]; 6] = [
            &[-0.2, 0.05, 0.001, -0.002],
            &[-0.2, 0.05, 0.001, -0.002],
            &[0.3, -0.1, 0.001, -0.002, 0.02, 0.6, 0.1, 0.03],
            &[1.4, -0.2, 0.05, 0.001, -0.002],
            &[0.6, 1.1],
            &[-0.2, 0.6],
        ];
        for ((name, _, initial), k) in LENSES.into_iter().zip(coefficients) {
            let model = CameraModel {
                width_px: 640,
                height_px: 480,
                focal_px: Vector2::new(410.0, 405.0),
                centre_px: Vector2::new(311.0, 245.0),
                distortion: initial.with_coefficients(k),
            };
            for p_c in
                [Vector3::new(0.3, -0.4, 1.1), Vector3::new(-0.7, 0.2, 0.9), Vector3::new(0.0, 1e-3, 2.0)]
            {
                let at = project(&model, &p_c).unwrap();
                assert!((at.px - model.project(&p_c).unwrap()).norm() < 1e-12);
                for k in 0..names(&model).len() {
                    let mut step = SVector::zeros();
                    step[k] = 1e-6;
                    let px = |s: &SVector<f64, LENS>| project(&stepped(&model, s), &p_c).unwrap().px;
                    let numeric = (px(&step) - px(&-step)) / 2e-6;
                    assert!((numeric - at.by_lens.column(k)).norm() < 1e-5, "{name} {}", names(&model)[k]);
                }
                for axis in 0..3 {
                    let mut step = Vector3::zeros();
                    step[axis] = 1e-6;
                    let px = |s: &Vector3<f64>| project(&model, &(p_c + s)).unwrap().px;
                    let numeric = (px(&step) - px(&-step)) / 2e-6;
                    assert!((numeric - at.by_point.column(axis)).norm() < 1e-4, "{name} {axis}");
                }
            }
        }
    }

    #[test]
    fn what_is_behind_the_camera_has_no_pixel() {
        let distortion = lens_named("radtan");
        let (focal_px, centre_px) = (Vector2::repeat(400.0), Vector2::repeat(300.0));
        let model = CameraModel { width_px: 600, height_px: 600, focal_px, centre_px, distortion };
        assert!(project(&model, &Vector3::new(0.0, 0.0, -1.0)).is_none());
        assert!(project(&model, &Vector3::new(0.0, 0.0, f64::NAN)).is_none());
    }
}
