//! The calibration that an estimator believes, drawn around the true one as the configuration says that it may be off.

use super::IntrinsicsError;
use crate::random::{Draws, Purpose};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_config::Config;
use plumbline_config::options::CameraConfig;

/// Puts the cameras of `config` elsewhere and shifts its time offset, by normal draws of `seed` with `multiple` of the standard
/// deviations in `[rig]`: the left camera against the IMU, the right one against the left. A quantity of standard deviation zero
/// stays.
pub fn draw_calibration(config: &mut Config, multiple: f64, seed: u64) {
    let mut draws = Draws::new(seed, Purpose::Calibration, 0);
    let mut normal3 = |sigma: f64| Vector3::from_fn(|_, _| draws.normal()) * (sigma * multiple);
    let rig = config.rig.clone();
    let imu = [rig.camera_imu_rotation_sigma_rad, rig.camera_imu_translation_sigma_m].map(&mut normal3);
    let pair =
        [rig.camera_camera_rotation_sigma_rad, rig.camera_camera_translation_sigma_m].map(&mut normal3);
    config.rig.time_offset_s += normal3(rig.time_offset_sigma_s).x;
    for camera in &mut config.camera {
        let [focal, centre] = [rig.camera_focal_sigma, rig.camera_centre_sigma_px].map(&mut normal3);
        camera.focal_px = camera.focal_px.map(|f| f * (1.0 + focal.x));
        camera.centre_px = [0, 1].map(|k| camera.centre_px[k] + centre[k]);
    }
    let [Some(left), right] = [0, 1].map(|k| config.camera.get(k).map(CameraConfig::pose_b_c)) else {
        return;
    };
    let moved = |pose: &Isometry3<f64>, [turn, shift]: [Vector3<f64>; 2]| {
        let rotation = pose.rotation * UnitQuaternion::from_scaled_axis(turn);
        Isometry3::from_parts((pose.translation.vector + shift).into(), rotation)
    };
    let left_believed = moved(&left, imu);
    place(&mut config.camera[0], &left_believed);
    if let Some(right) = right {
        let right_believed = left_believed * moved(&(left.inverse() * right), pair);
        place(&mut config.camera[1], &right_believed);
    }
}

/// Puts focal lengths, principal points and the angle between the cameras of `config`, whose images are `scale` times as large as
/// configured, off by `error`. Signs are drawn by `seed`.
pub fn mistake_intrinsics(config: &mut Config, error: &IntrinsicsError, scale: f64, seed: u64) {
    let mut draws = Draws::new(seed, Purpose::Intrinsics, 0);
    let mut sign = || if draws.unit() < 0.5 { -1.0 } else { 1.0 };
    for camera in &mut config.camera {
        let focal = 1.0 + sign() * error.focal;
        camera.focal_px = camera.focal_px.map(|f| f * focal);
        camera.centre_px = camera.centre_px.map(|c| c + sign() * error.centre_px * scale);
    }
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), sign() * error.vergence_rad);
    if let Some(right) = config.camera.get_mut(1).filter(|_| error.vergence_rad != 0.0) {
        let mut pose = right.pose_b_c();
        pose.rotation *= turn;
        place(right, &pose);
    }
}

/// Mounts `camera` at `pose_b_c`.
pub(crate) fn place(camera: &mut CameraConfig, pose_b_c: &Isometry3<f64>) {
    let matrix = pose_b_c.to_homogeneous();
    camera.pose_b_c = std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn drawn_rigs_scatter_as_stated() {
        let truth = fixture::config();
        let [left, right] = [0, 1].map(|k| truth.camera[k].pose_b_c());
        let count = 2000;
        let mut squares = [0.0; 5];
        for seed in 0..count {
            let mut drawn = truth.clone();
            draw_calibration(&mut drawn, 2.0, seed);
            let [a, b] = [0, 1].map(|k| drawn.camera[k].pose_b_c());
            let pair = (left.inverse() * right).inverse() * (a.inverse() * b);
            squares[0] += left.rotation.angle_to(&a.rotation).powi(2);
            squares[1] += (left.translation.vector - a.translation.vector).norm_squared();
            squares[2] += pair.rotation.angle().powi(2);
            squares[3] += pair.translation.vector.norm_squared();
            squares[4] += (drawn.rig.time_offset_s - truth.rig.time_offset_s).powi(2) * 3.0;
        }
        let rig = &truth.rig;
        let stated = [
            rig.camera_imu_rotation_sigma_rad,
            rig.camera_imu_translation_sigma_m,
            rig.camera_camera_rotation_sigma_rad,
            rig.camera_camera_translation_sigma_m,
            rig.time_offset_sigma_s,
        ];
        for (square, sigma) in squares.into_iter().zip(stated) {
            let found = (square / (3.0 * count as f64)).sqrt();
            assert!((found / (2.0 * sigma) - 1.0).abs() < 0.05, "{found} {sigma}");
        }
    }

    #[test]
    fn intrinsics_are_off_by_what_is_asked_for() {
        let truth = fixture::config();
        let error = IntrinsicsError { focal: 0.003, centre_px: 2.0, vergence_rad: 1e-3 };
        let mut drawn = truth.clone();
        mistake_intrinsics(&mut drawn, &error, 0.5, 3);
        for (a, b) in truth.camera.iter().zip(&drawn.camera) {
            assert!(((b.focal_px[0] / a.focal_px[0] - 1.0).abs() - 0.003).abs() < 1e-12);
            assert!(((b.centre_px[1] - a.centre_px[1]).abs() - 1.0).abs() < 1e-12);
        }
        let turned = truth.camera[1].pose_b_c().rotation.angle_to(&drawn.camera[1].pose_b_c().rotation);
        assert!((turned - 1e-3).abs() < 1e-9 && truth.camera[0].pose_b_c == drawn.camera[0].pose_b_c);
    }

    #[test]
    fn what_is_exact_stays() {
        let mut config = fixture::config();
        config.rig.camera_camera_rotation_sigma_rad = 0.0;
        config.rig.camera_camera_translation_sigma_m = 0.0;
        let pair = |config: &Config| config.camera[0].pose_b_c().inverse() * config.camera[1].pose_b_c();
        let before = pair(&config);
        draw_calibration(&mut config, 1.0, 7);
        let apart = before.inverse() * pair(&config);
        assert!(apart.rotation.angle() < 1e-9 && apart.translation.vector.norm() < 1e-9);
        assert_ne!(config.camera[0].pose_b_c, fixture::config().camera[0].pose_b_c);
    }
}
