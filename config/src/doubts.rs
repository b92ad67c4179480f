//! Doubts about a configuration: settings that are valid, and yet probably a mistake.

use crate::options::{CameraConfig, Config, Mounting};
use nalgebra::{Isometry3, Vector2};
use std::f64::consts::PI;

/// Ratio of the focal lengths of one camera, and of two cameras of a pair.
const FOCAL_RATIO: f64 = 1.1;
/// Distance of the principal point from the centre, as a share of the image.
const OFF_CENTRE: f64 = 0.2;
/// Digits by which an angle is a multiple of an eighth of a turn in radians.
const RADIANS: f64 = 0.001;
/// Least noise density of an accelerometer over that of the gyroscope beside it, m/(s rad): data sheets of sensors in one package have 4.5
/// (ADIS16490) to 45 (MPU-6050); degrees make it 57 times, g 9.8 times as small.
const NOISE_RATIO: f64 = 2.0;

impl Config {
    /// Values that are valid, and yet probably a mistake: a sentence for each, with its key.
    pub fn doubts(&self) -> Vec<String> {
        let mut doubts: Vec<String> = self.camera.iter().enumerate().flat_map(of_camera).collect();
        if let [left, right, ..] = self.camera.as_slice() {
            // Where images are compared: near the axis.
            let [left_px, right_px] =
                [left, right].map(|c| c.focal_px[0] * c.distortion.distort(&Vector2::zeros()).1.m11);
            if differs(left_px / right_px) {
                doubts.push(format!(
                    "camera[..].focal_px: the left camera has {:.1} px, the right one {:.1}; are both of this rig?",
                    left_px, right_px
                ));
            }
            doubts.extend(of_pair(&left.pose_b_c(), &right.pose_b_c()));
        }
        doubts.extend(of_mounting(&self.vehicle.imu_to_vehicle_deg));
        let [gyro, accel] = [self.imu.gyro_noise_density, self.imu.accel_noise_density];
        if accel < NOISE_RATIO * gyro {
            doubts.push(format!(
                "imu.gyro_noise_density: {gyro:e} rad/s/sqrt(Hz) is much beside {accel:e} m/s^2/sqrt(Hz) of the accelerometer; is it in \
                 degrees, or the accelerometer's in g?"
            ));
        }
        doubts
    }
}

/// Share of the baseline along an axis of the left camera that is its direction.
const ALONG: f64 = 0.8;

/// Direction of the second camera as seen from the first: to the right in all pairs that are called left and right.
fn of_pair(left: &Isometry3<f64>, right: &Isometry3<f64>) -> Option<String> {
    let baseline =
        |left: &Isometry3<f64>, right: &Isometry3<f64>| (left.inverse() * right).translation.vector;
    let as_it_is = baseline(left, right);
    let is_right = |p: &nalgebra::Vector3<f64>| p.x > ALONG * p.norm();
    if is_right(&as_it_is) || as_it_is.norm() == 0.0 {
        return None;
    }
    let is_right_if_inverted = is_right(&baseline(&left.inverse(), &right.inverse()));
    let is_left = as_it_is.x < -ALONG * as_it_is.norm();
    let cause = match (is_left, is_right_if_inverted) {
        (true, true) => "are the cameras exchanged, or T_cam_imu inverted (T_imu_cam)?",
        (true, false) => "are the cameras exchanged?",
        (false, true) => {
            "is T_cam_imu inverted (T_imu_cam, or T_BS given for it)? Inverted it lies to the right"
        }
        (false, false) => return None,
    };
    let [x, y, z] = [as_it_is.x, as_it_is.y, as_it_is.z];
    Some(format!(
        "camera[1].pose_b_c: camera[1] does not lie to the right of camera[0], but at ({x:.3} {y:.3} {z:.3}) m in its axes (x right, y down, z forward); \
         {cause}"
    ))
}

/// A lens model that folds back within the corners of the image: nothing there is used.
fn of_corners(index: usize, camera: &CameraConfig) -> Option<String> {
    let fold_rad = camera.distortion.fold_rad()?;
    let model = camera.model();
    let [right, bottom] = [camera.width_px, camera.height_px].map(|size| size as f64 - 1.0);
    let corners = [(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)];
    let folded = corners.iter().filter(|(x, y)| !model.has_direction(&Vector2::new(*x, *y))).count();
    (folded > 0).then(|| {
        format!(
            "camera[{index}].distortion: the lens model folds back {:.0} degrees from the optical axis, which is within {folded} of the \
             corners of the image; what lies beyond is not used. For a larger field of view calibrate with the target in the \
             corners too",
            fold_rad.to_degrees()
        )
    })
}

/// True if a ratio of focal lengths is far from 1.
fn differs(ratio: f64) -> bool {
    !(1.0 / FOCAL_RATIO..=FOCAL_RATIO).contains(&ratio)
}

fn of_camera((index, camera): (usize, &CameraConfig)) -> Vec<String> {
    let mut doubts = Vec::new();
    let [fx, fy] = camera.focal_px;
    if differs(fx / fy) {
        doubts.push(format!(
            "camera[{index}].focal_px: fx/fy is {:.2}; are these intrinsics in the order fu, fv, cu, cv?",
            fx / fy
        ));
    }
    let size = [camera.width_px, camera.height_px].map(|size| size as f64);
    let is_aside = (0..2).any(|axis| (camera.centre_px[axis] / size[axis] - 0.5).abs() > OFF_CENTRE);
    if is_aside {
        doubts.push(format!(
            "camera[{index}].centre_px: {:.0} {:.0} is far from the centre of an image of {}x{} px; is the calibration of \
             this image size?",
            camera.centre_px[0], camera.centre_px[1], camera.width_px, camera.height_px
        ));
    }
    doubts.extend(of_corners(index, camera));
    doubts
}

fn of_mounting(mounting: &Mounting) -> Option<String> {
    let degrees = mounting.degrees()?;
    let is_turn = |angle: f64| {
        let eighths = (angle / (0.25 * PI)).round();
        eighths != 0.0 && (angle - eighths * 0.25 * PI).abs() < RADIANS
    };
    let radians = degrees.into_iter().find(|angle| is_turn(*angle))?;
    degrees.iter().all(|angle| angle.abs() < 2.0 * PI + RADIANS).then(|| {
        format!(
            "vehicle.imu_to_vehicle_deg: {radians} looks like radians; degrees are expected: {:.0}",
            radians.to_degrees()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::VehicleConfig;

    /// A number as it is written by hand.
    fn written(x: f64) -> f64 {
        (x * 1e4).round() / 1e4
    }

    #[test]
    fn presets_give_no_doubts() {
        for preset in crate::PRESETS {
            assert_eq!(Config::preset(preset).unwrap().doubts(), Vec::<String>::new(), "{preset}");
        }
    }

    #[test]
    fn pairs_that_are_exchanged_or_inverted_are_named() {
        let doubts = |change: fn(&mut Config)| {
            let mut config = Config::preset("euroc").unwrap().into_inner();
            change(&mut config);
            config.doubts()
        };
        let invert = |config: &mut Config| {
            for camera in &mut config.camera {
                camera.pose_b_c = crate::options::rows_from_isometry(&camera.pose_b_c().inverse());
            }
        };
        let exchanged = doubts(|config| config.camera.swap(0, 1));
        assert!(
            exchanged.len() == 1 && exchanged[0].contains("does not lie to the right of camera[0]"),
            "{exchanged:?}"
        );
        assert!(exchanged[0].ends_with("are the cameras exchanged?"), "{exchanged:?}");
        let inverted = doubts(invert);
        assert!(
            inverted.len() == 1 && inverted[0].contains("does not lie to the right of camera[0]"),
            "{inverted:?}"
        );
        assert!(inverted[0].contains("is T_cam_imu inverted"), "{inverted:?}");
        // An IMU with the axes of the camera: inverting looks like exchanging.
        let aligned = doubts(|config| {
            for (k, camera) in config.camera.iter_mut().enumerate() {
                camera.pose_b_c =
                    crate::options::rows_from_isometry(&Isometry3::translation(-0.1 * k as f64, 0.0, 0.0));
            }
        });
        assert!(aligned[0].contains("exchanged, or T_cam_imu inverted"), "{aligned:?}");
        // One camera above the other, as some rigs have it.
        let upright = doubts(|config| {
            for (k, camera) in config.camera.iter_mut().enumerate() {
                camera.pose_b_c =
                    crate::options::rows_from_isometry(&Isometry3::translation(0.0, 0.1 * k as f64, 0.0));
            }
        });
        assert_eq!(upright, Vec::<String>::new());
    }

    #[test]
    fn probable_mistakes_are_named_by_their_keys() {
        type Change = fn(&mut Config);
        let cases: [(Change, &str); 7] = [
            (|c| c.imu.gyro_noise_density *= 57.3, "imu.gyro_noise_density"),
            (|c| c.imu.accel_noise_density /= 9.81, "accelerometer's in g?"),
            (|c| c.camera[1].focal_px[0] *= 1.48, "camera[1].focal_px: fx/fy is 1.48; are these"),
            (|c| c.camera[1].focal_px = c.camera[0].focal_px.map(|f| 1.2 * f), "are both of this rig?"),
            (|c| c.camera[0].centre_px[0] = 0.25 * c.camera[0].width_px as f64, "camera[0].centre_px"),
            (|c| c.vehicle = VehicleConfig::mounted([written(PI), 0.0, 0.0]), "degrees are expected: 180"),
            (
                |c| c.vehicle = VehicleConfig::mounted([0.0, written(-0.5 * PI), written(PI)]),
                "looks like radians",
            ),
        ];
        for (change, words) in cases {
            let mut config = Config::preset("euroc").unwrap().into_inner();
            change(&mut config);
            let doubts = config.doubts();
            assert!(doubts.iter().any(|doubt| doubt.contains(words)), "{words}: {doubts:?}");
        }
        let mut config = Config::preset("euroc").unwrap().into_inner();
        config.vehicle = VehicleConfig::mounted([2.0, -1.0, 0.5]);
        assert_eq!(config.doubts(), Vec::<String>::new());
    }
}
