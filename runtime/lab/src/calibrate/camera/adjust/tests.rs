//! Rigs of known cameras are found again.

use super::*;
use crate::calibrate::camera::lens::lens_named;

fn rig() -> Cameras {
    let model = |f: f64, c: [f64; 2], k: [f64; 4]| CameraModel {
        width_px: 752,
        height_px: 480,
        focal_px: Vector2::new(f, f - 1.0),
        centre_px: Vector2::from(c),
        distortion: lens_named("radtan").with_coefficients(&k),
    };
    Cameras {
        models: vec![
            model(458.0, [367.0, 248.0], [-0.28, 0.07, 2e-4, 2e-5]),
            model(457.0, [380.0, 255.0], [-0.28, 0.07, -1e-4, -4e-5]),
        ],
        pose_c1_c0: Isometry3::new(Vector3::new(-0.11, 4e-4, -8e-4), Vector3::new(0.01, -0.002, 0.003)),
    }
}

fn points() -> Vec<Vector2<f64>> {
    (0..48).map(|k| Vector2::new(f64::from(k % 8) * 0.08, f64::from(k / 8) * 0.08)).collect()
}

/// Poses of the board all over the image, tilted by turns.
fn poses() -> Vec<Isometry3<f64>> {
    let pose = |k: i32| {
        let (a, b) = (f64::from(k % 4), f64::from(k / 4));
        let shift = Vector3::new(-0.75 + 0.3 * a, -0.5 + 0.2 * b, 0.8 + 0.1 * ((a + b) % 3.0));
        Isometry3::new(shift, Vector3::new(0.5 * (a - 1.5), 0.4 * (b - 1.0), 0.2 * (a - b)))
    };
    (0..12).map(pose).collect()
}

/// Corners that the rig sees, each coordinate off by up to `noise_px`.
fn sights(rig: &Cameras, noise_px: f64) -> Vec<Sight> {
    let mut draw = 1_u64;
    let mut noise = || {
        draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((draw >> 33) as f64 / f64::from(1_u32 << 31) * 2.0 - 1.0) * noise_px
    };
    let mut corners = |camera: usize, pose: &Isometry3<f64>| {
        let seen = points().into_iter().enumerate().filter_map(|(number, point)| {
            let px = rig.models[camera].project(&rig.seen_from(camera, pose, &point))?;
            rig.models[camera].contains(&px, 4.0).then_some(Corner { number, px })
        });
        let seen: Vec<Corner> = seen.collect();
        seen.into_iter().map(|c| Corner { px: c.px + Vector2::new(noise(), noise()), ..c }).collect()
    };
    poses().iter().map(|pose| [corners(0, pose), corners(1, pose)]).collect()
}

/// The rig and the poses, put out of place.
fn disturbed() -> (Cameras, Vec<Isometry3<f64>>) {
    let mut rig = rig();
    for model in &mut rig.models {
        model.focal_px *= 1.06;
        model.centre_px = Vector2::new(375.5, 239.5);
        model.distortion = lens_named("radtan").with_coefficients(&[0.0; 4]);
    }
    rig.pose_c1_c0.translation.vector *= 0.9;
    let off = Isometry3::new(Vector3::new(0.02, -0.01, 0.05), Vector3::new(0.05, 0.02, -0.03));
    (rig, poses().iter().map(|pose| pose * off).collect())
}

#[test]
fn exact_corners_give_the_rig_back() {
    let (start, poses) = disturbed();
    let sights = sights(&rig(), 0.0);
    let adjusted = adjust(&points(), &sights, &start, &poses).unwrap();
    assert!(adjusted.cost < 1e-12, "{}", adjusted.cost);
    for (found, true_model) in adjusted.cameras.models.iter().zip(rig().models) {
        assert!((found.focal_px - true_model.focal_px).norm() < 1e-6);
        assert!((found.centre_px - true_model.centre_px).norm() < 1e-6);
    }
    let error = adjusted.cameras.pose_c1_c0.inverse() * rig().pose_c1_c0;
    assert!(error.translation.vector.norm() < 1e-9 && error.rotation.angle() < 1e-9, "{error}");
}

#[test]
fn errors_are_within_three_standard_deviations() {
    let (start, poses) = disturbed();
    let sights = sights(&rig(), 0.4);
    let adjusted = adjust(&points(), &sights, &start, &poses).unwrap();
    let covariance = covariance(&points(), &sights, &adjusted).unwrap();
    for camera in 0..2 {
        let unknowns = |rig: &Cameras| super::super::lens::unknowns(&rig.models[camera]);
        let error = unknowns(&adjusted.cameras) - unknowns(&rig());
        for k in 0..names(&rig().models[camera]).len() {
            let sigma = covariance[(camera * LENS + k, camera * LENS + k)].sqrt();
            assert!(sigma > 0.0 && error[k].abs() < 3.0 * sigma, "{camera} {k}: {} of {sigma}", error[k]);
        }
    }
    let shift = adjusted.cameras.pose_c1_c0.translation.vector - rig().pose_c1_c0.translation.vector;
    for axis in 0..3 {
        let sigma = covariance[(PAIR + 3 + axis, PAIR + 3 + axis)].sqrt();
        assert!(sigma < 1e-3 && shift[axis].abs() < 3.0 * sigma, "{axis}: {} of {sigma}", shift[axis]);
    }
}

#[test]
fn every_lens_is_found_again_from_the_one_it_begins_with() {
    let lenses: [(&str, f64, &[f64]); 6] = [
        ("radtan", 458.0, &[-0.28, 0.07, 2e-4, 2e-5]),
        ("equidistant", 300.0, &[-0.01, 0.02, -0.01, 0.002]),
        ("rational", 400.0, &[0.4, -0.05, 2e-4, 2e-5, 0.01, 0.7, 0.05, 0.02]),
        ("omni", 290.0 * 2.4, &[1.4, -0.2, 0.03, 2e-4, 2e-5]),
        ("eucm", 290.0, &[0.6, 1.1]),
        ("double-sphere", 290.0 * 0.8, &[-0.2, 0.6]),
    ];
    for (name, focal_px, k) in lenses {
        let lens = lens_named(name);
        let mut model = rig().models[0];
        (model.distortion, model.focal_px) = (lens.with_coefficients(k), Vector2::repeat(focal_px));
        let sights: Vec<Sight> = sights(&Cameras { models: vec![model, model], ..rig() }, 0.02)
            .into_iter()
            .map(|[left, _]| [left, Vec::new()])
            .collect();
        let mut start = model;
        start.distortion = lens;
        let near_axis = |lens: &CameraModel| lens.distortion.distort(&Vector2::zeros()).1.m11;
        start.focal_px *= 1.05 * near_axis(&model) / near_axis(&start);
        let adjusted = adjust(&points(), &sights, &Cameras::single(start), &poses()).expect("fits");
        // Uniform errors of up to 0.02 px have a root mean square of 0.0163 px for both coordinates.
        let rms_px = (adjusted.cost / adjusted.corners as f64).sqrt();
        assert!(rms_px < 0.018, "{name}: {rms_px} px");
        let covariance = covariance(&points(), &sights, &adjusted);
        assert!(covariance.is_some(), "{name}: not determined");
        let found = &adjusted.cameras.models[0];
        for (x, y) in [(120.0, 100.0), (640.0, 100.0), (376.0, 240.0), (120.0, 400.0), (640.0, 400.0)] {
            let px = Vector2::new(x, y);
            let ray = model.unproject(&px).expect("a pixel of the image").push(1.0);
            let off_px = (found.project(&ray).expect("seen") - px).norm();
            assert!(off_px < 0.3, "{name}: {off_px} px off at {px}");
        }
    }
}

#[test]
fn one_camera_is_adjusted_by_itself() {
    let (start, poses) = disturbed();
    let left: Vec<Sight> = sights(&rig(), 0.0).into_iter().map(|[left, _]| [left, Vec::new()]).collect();
    let adjusted = adjust(&points(), &left, &Cameras::single(start.models[0]), &poses).unwrap();
    assert!((adjusted.cameras.models[0].focal_px - rig().models[0].focal_px).norm() < 1e-6);
    assert!(covariance(&points(), &left, &adjusted).is_some());
}

#[test]
fn a_single_view_of_a_board_before_the_camera_determines_no_lens() {
    let sight = sights(&rig(), 0.3).remove(1);
    let pose = [Isometry3::new(Vector3::new(-0.3, -0.2, 0.7), Vector3::zeros())];
    let sights = [[sight[0].clone(), Vec::new()]];
    let adjusted = adjust(&points(), &sights, &Cameras::single(rig().models[0]), &pose);
    let sigma = adjusted.and_then(|a| covariance(&points(), &sights, &a)).map(|c| c[(0, 0)].sqrt());
    assert!(sigma.is_none_or(|sigma| sigma > 0.2), "{sigma:?}");
}
