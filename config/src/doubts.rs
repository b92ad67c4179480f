//! What is valid, and yet probably a mistake.

use crate::options::{CameraConfig, Config, Mounting};
use std::f64::consts::PI;

/// Ratio of the focal lengths of one camera, and of two cameras of a pair.
const FOCAL_RATIO: f64 = 1.1;
/// Distance of the principal point from the centre, as a share of the image.
const OFF_CENTRE: f64 = 0.2;
/// Digits by which an angle is a multiple of an eighth of a turn in radians.
const RADIANS: f64 = 0.001;

impl Config {
    /// Values that are valid, and yet probably a mistake: a sentence for each, with its key.
    #[must_use]
    pub fn doubts(&self) -> Vec<String> {
        let mut doubts: Vec<String> = self.camera.iter().enumerate().flat_map(of_camera).collect();
        if let [left, right, ..] = self.camera.as_slice() {
            let ratio = left.focal_px[0] / right.focal_px[0];
            if differs(ratio) {
                doubts.push(format!(
                    "camera[..].focal_px: the left camera has {:.1} px, the right one {:.1}; are both of this rig?",
                    left.focal_px[0], right.focal_px[0]
                ));
            }
        }
        doubts.extend(of_mounting(&self.vehicle.imu_to_vehicle_deg));
        doubts
    }
}

/// Whether a ratio of focal lengths is far from 1.
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
    fn probable_mistakes_are_named_by_their_keys() {
        type Change = fn(&mut Config);
        let cases: [(Change, &str); 5] = [
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
