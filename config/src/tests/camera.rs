use crate::camera::{CameraModel, Distortion};
use crate::options::{isometry_from_rows, rows_from_isometry};
use nalgebra::{Isometry3, Matrix2x3, Translation3, UnitQuaternion, Vector2, Vector3};
use proptest::prelude::*;

/// Largest error of `project(unproject(px))`: Newton stops at 1e-11 of a focal length of 460 px.
const ROUND_TRIP_PX: f64 = 1e-7;

fn model(distortion: Distortion) -> CameraModel {
    CameraModel {
        width_px: 752,
        height_px: 480,
        focal_px: Vector2::new(458.654, 457.296),
        centre_px: Vector2::new(367.215, 248.375),
        distortion,
    }
}

fn radtan() -> CameraModel {
    let (k1, k2, p1, p2) = (-0.283_408_11, 0.073_959_07, 0.000_193_59, 1.761_871_14e-5);
    model(Distortion::RadialTangential { k1, k2, p1, p2 })
}

/// The fisheye of the TUM-VI data set, scaled to the image here: its corners look 89 degrees aside, which is as far as
/// an image plane reaches.
fn equidistant() -> CameraModel {
    let (k1, k2, k3, k4) = (0.003_482_389, 0.000_715_035, -0.002_053_236, 0.000_202_936);
    let wide = model(Distortion::Equidistant { k1, k2, k3, k4 });
    CameraModel { focal_px: Vector2::new(297.0, 297.0), ..wide }
}

fn round_trip_px(camera: &CameraModel, px: Vector2<f64>) -> f64 {
    let xy = camera.unproject(&px).expect("a pixel of the image has a direction");
    let back = camera.project(&(xy.push(1.0) * 3.0)).expect("in front of the camera");
    (back - px).norm()
}

/// Largest deviation of the analytic Jacobian from central differences, relative to its largest element.
fn jacobian_error(camera: &CameraModel, p_c: &Vector3<f64>) -> f64 {
    let (_, analytic) = camera.project_with_jacobian(p_c).expect("in front of the camera");
    let h = 1e-6 * p_c.z;
    let numeric = Matrix2x3::from_columns(&[0, 1, 2].map(|axis| {
        let step = Vector3::ith(axis, h);
        let ahead = camera.project(&(p_c + step)).expect("in front");
        (ahead - camera.project(&(p_c - step)).expect("in front")) / (2.0 * h)
    }));
    (analytic - numeric).amax() / analytic.amax()
}

#[test]
fn the_corners_of_the_image_round_trip() {
    for (x, y) in [(0.0, 0.0), (751.0, 0.0), (0.0, 479.0), (751.0, 479.0)] {
        for camera in [radtan(), equidistant()] {
            assert!(round_trip_px(&camera, Vector2::new(x, y)) < ROUND_TRIP_PX, "{x} {y}");
        }
    }
}

proptest! {
    #[test]
    fn pixels_of_the_image_round_trip(x in 0.0..751.0f64, y in 0.0..479.0f64) {
        for camera in [radtan(), equidistant()] {
            prop_assert!(round_trip_px(&camera, Vector2::new(x, y)) < ROUND_TRIP_PX);
        }
    }

    #[test]
    fn the_jacobian_is_the_derivative(x in -0.8..0.8f64, y in -0.6..0.6f64, z in 0.3..50.0f64) {
        for camera in [radtan(), equidistant()] {
            let error = jacobian_error(&camera, &Vector3::new(x * z, y * z, z));
            prop_assert!(error < 1e-7, "{error}");
        }
    }

    #[test]
    fn rigid_transforms_round_trip(
        axis in prop::array::uniform3(-3.0..3.0f64),
        p in prop::array::uniform3(-5.0..5.0f64),
    ) {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(axis));
        let pose = Isometry3::from_parts(Translation3::new(p[0], p[1], p[2]), rotation);
        let difference = isometry_from_rows(&rows_from_isometry(&pose)).inverse() * pose;
        prop_assert!(difference.translation.vector.norm() < 1e-12);
        prop_assert!(difference.rotation.angle() < 1e-7);
    }

    /// Whatever the lens and the pixel: the solution projects to the pixel, from the centre's branch.
    #[test]
    fn unproject_is_right_or_says_no(
        k in prop::array::uniform4(-1.0..1.0f64),
        x in -500.0..1500.0f64,
        y in -500.0..1000.0f64,
        fisheye: bool,
    ) {
        let [k1, k2, k3, k4] = k;
        let camera = model(if fisheye {
            Distortion::Equidistant { k1, k2, k3, k4 }
        } else {
            Distortion::RadialTangential { k1, k2, p1: 0.02 * k3, p2: 0.02 * k4 }
        });
        let px = Vector2::new(x, y);
        if let Some(xy) = camera.unproject(&px) {
            prop_assert!(camera.distortion.is_regular(&xy));
            let (back, jacobian) = camera.project_normalized(&xy);
            prop_assert!((back - px).norm() < 1e-6);
            prop_assert!(jacobian.determinant() > 0.0);
        }
    }

    #[test]
    fn no_number_makes_it_panic(p in prop::array::uniform3(prop::num::f64::ANY), k in prop::array::uniform4(prop::num::f64::ANY)) {
        let [k1, k2, k3, k4] = k;
        for distortion in [
            Distortion::RadialTangential { k1, k2, p1: k3, p2: k4 },
            Distortion::Equidistant { k1, k2, k3, k4 },
        ] {
            let camera = model(distortion);
            let _ = camera.project_with_jacobian(&Vector3::from(p));
            let _ = camera.unproject(&Vector2::new(p[0], p[1]));
        }
        for camera in [radtan(), equidistant()] {
            if let Some(px) = camera.project(&Vector3::from(p)) {
                prop_assert!(px.iter().all(|x| x.is_finite()));
            }
        }
    }
}

#[test]
fn what_is_not_a_number_has_no_pixel_and_no_direction() {
    for camera in [radtan(), equidistant()] {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(camera.unproject(&Vector2::new(bad, 100.0)), None);
            assert_eq!(camera.project(&Vector3::new(bad, 0.0, 1.0)), None);
        }
        assert_eq!(camera.project(&Vector3::new(0.0, 0.0, f64::NAN)), None);
        assert_eq!(camera.project(&Vector3::new(0.0, 0.0, -1.0)), None);
    }
}

/// With `k1 = -0.3` alone the radius folds at `r = 1.054`, so that `r = 2` would be seen at `r_d = -0.4`.
#[test]
fn a_point_beyond_the_fold_is_not_seen_and_no_pixel_points_there() {
    let camera = model(Distortion::RadialTangential { k1: -0.3, k2: 0.0, p1: 0.0, p2: 0.0 });
    let fold = (1.0f64 / 0.9).sqrt();
    assert!(camera.project(&Vector3::new(0.999 * fold, 0.0, 1.0)).is_some());
    assert_eq!(camera.project(&Vector3::new(1.001 * fold, 0.0, 1.0)), None);
    assert_eq!(camera.project(&Vector3::new(2.0, 0.0, 1.0)), None);
    for percent in 1..100 {
        let xy = Vector2::new(fold * f64::from(percent) / 100.0, 0.0);
        let (px, _) = camera.project_normalized(&xy);
        let found = camera.unproject(&px).expect("within the reach of the lens");
        assert!((found - xy).norm() < 1e-7, "{xy} came back as {found}");
    }
    let (furthest, _) = camera.project_normalized(&Vector2::new(fold, 0.0));
    assert_eq!(camera.unproject(&(furthest + Vector2::new(1.0, 0.0))), None);
}

#[test]
fn a_fisheye_that_folds_gives_the_near_branch_or_nothing() {
    let (k1, k2, k3, k4) = (-0.3, 0.0, 0.0, 0.0);
    let camera = model(Distortion::Equidistant { k1, k2, k3, k4 });
    let fold = (1.0f64 / 0.9).sqrt();
    for percent in 1..99 {
        let xy = Vector2::new((fold * f64::from(percent) / 100.0).tan(), 0.0);
        let (px, _) = camera.project_normalized(&xy);
        let found = camera.unproject(&px).expect("within the reach of the lens");
        assert!((found - xy).norm() < 1e-6 * (1.0 + xy.norm()), "{xy} came back as {found}");
    }
    assert_eq!(camera.project(&Vector3::new(0.0, (1.2 * fold).tan(), 1.0)), None);
}
