//! The rig for those who look at a log: how its cameras see, and where cameras and vehicle are on the body.
//!
//! It is what the configuration says. What the estimator refines of it in flight is in its estimates. The names of
//! frames are those of ROS ([`RosConfig`](plumbline_config::options::RosConfig)); cameras are named as their images are.

use super::channel::Channel;
use nalgebra::{Isometry3, Translation3, Vector2};
use plumbline_config::camera::Distortion;
use plumbline_config::options::CameraConfig;
use plumbline_config::{Config, Timestamp};
use plumbline_scene::messages::{CameraCalibration, FrameTransforms};
use plumbline_scene::{frame_transform, timestamp};
use prost::Message as _;

/// Names of the cameras' frames: x right, y down, z forward.
pub const CAMERA_FRAMES: [&str; 2] = ["left", "right"];
/// Bound on the size of the messages, bytes: the names of three frames have up to 64 each.
pub const MAX_BYTES: u64 = 2_048;

/// The messages of a rig of up to two cameras.
pub fn messages(config: &Config, stamp: Timestamp) -> Vec<(Channel, Vec<u8>)> {
    let channels = [Channel::LeftCalibration, Channel::RightCalibration];
    let cameras = config.camera.iter().zip(CAMERA_FRAMES).zip(channels);
    let calibrations = cameras
        .map(|((camera, frame), channel)| (channel, calibration(camera, frame, stamp).encode_to_vec()));
    let mounting = (Channel::Mounting, mounting(config, stamp).encode_to_vec());
    calibrations.chain([mounting]).collect()
}

/// Intrinsics and distortion. Images are as the camera delivers them: rectification changes nothing.
fn calibration(camera: &CameraConfig, frame: &str, stamp: Timestamp) -> CameraCalibration {
    let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.centre_px);
    let mut coefficients: Vec<f64> = camera.distortion.coefficients().iter().map(|(_, k)| *k).collect();
    let (mut fx, mut fy) = (fx, fy);
    let model = match camera.distortion {
        Distortion::RadialTangential { .. } => {
            coefficients.push(0.0);
            "plumb_bob"
        }
        Distortion::Equidistant { .. } => "kannala_brandt",
        Distortion::Rational { .. } => "rational_polynomial",
        // Viewers have no word for these: they are told the pinhole that the lens is near its axis.
        Distortion::Omni { .. } | Distortion::Eucm { .. } | Distortion::DoubleSphere { .. } => {
            let (_, by_xy) = camera.distortion.distort(&Vector2::zeros());
            (fx, fy) = (fx * by_xy.m11, fy * by_xy.m22);
            coefficients.clear();
            ""
        }
    };
    CameraCalibration {
        timestamp: timestamp(stamp),
        frame_id: frame.into(),
        width: camera.width_px as u32,
        height: camera.height_px as u32,
        distortion_model: model.into(),
        d: coefficients,
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
}

/// Cameras and vehicle, as children of the body; no vehicle where the mounting is unknown. They are in one message, so that who begins to look in the middle, and
/// is given the newest one of each topic, has them all.
fn mounting(config: &Config, stamp: Timestamp) -> FrameTransforms {
    let body = &config.ros.body_frame;
    let vehicle = config.vehicle.rot_v_b().map(|rot_v_b| {
        let pose_b_v = Isometry3::from_parts(Translation3::identity(), rot_v_b.inverse());
        frame_transform(stamp, body, &config.ros.base_frame, &pose_b_v)
    });
    let cameras = config.camera.iter().zip(CAMERA_FRAMES);
    let cameras = cameras.map(|(camera, frame)| frame_transform(stamp, body, frame, &camera.pose_b_c()));
    FrameTransforms { transforms: vehicle.into_iter().chain(cameras).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    fn config() -> Config {
        Config::clone(&Config::preset("euroc").unwrap())
    }

    #[test]
    fn the_matrix_projects_as_the_camera_does_where_the_lens_is_straight() {
        let mut config = config();
        let straight = Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 };
        for (camera, frame) in config.camera.iter_mut().zip(CAMERA_FRAMES) {
            camera.distortion = straight;
            let message = calibration(camera, frame, Timestamp::default());
            let p_c = Vector3::new(0.3, -0.2, 1.5);
            let seen = Matrix3::from_row_slice(&message.k) * p_c;
            let expected = camera.model().project(&p_c).unwrap();
            assert!((seen.xy() / seen.z - expected).norm() < 1e-9, "{seen} {expected}");
            assert_eq!((message.width, message.height), (752, 480));
            assert_eq!(message.frame_id, frame);
        }
    }

    #[test]
    fn lenses_are_told_by_the_names_that_foxglove_knows() {
        let mut camera = config().camera.remove(0);
        let message = calibration(&camera, "left", Timestamp::default());
        assert_eq!((message.distortion_model.as_str(), message.d.len()), ("plumb_bob", 5));
        assert!((message.d[0] + 0.283_408_11).abs() < 1e-6, "{:?}", message.d);
        camera.distortion = Distortion::Equidistant { k1: 0.1, k2: 0.2, k3: 0.3, k4: 0.4 };
        let message = calibration(&camera, "left", Timestamp::default());
        assert_eq!(
            (message.distortion_model.as_str(), message.d),
            ("kannala_brandt", vec![0.1, 0.2, 0.3, 0.4])
        );
        camera.distortion =
            Distortion::Rational { k1: 1.0, k2: 2.0, p1: 3.0, p2: 4.0, k3: 5.0, k4: 6.0, k5: 7.0, k6: 8.0 };
        let message = calibration(&camera, "left", Timestamp::default());
        assert_eq!(message.distortion_model, "rational_polynomial");
        assert_eq!(message.d, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
    }

    #[test]
    fn a_lens_without_a_name_is_told_as_the_pinhole_near_its_axis() {
        let mut camera = config().camera.remove(0);
        for distortion in [
            Distortion::Omni { xi: 1.2, k1: -0.1, k2: 0.0, p1: 0.0, p2: 0.0 },
            Distortion::Eucm { alpha: 0.6, beta: 1.1 },
            Distortion::DoubleSphere { xi: -0.2, alpha: 0.6 },
        ] {
            camera.distortion = distortion;
            let message = calibration(&camera, "left", Timestamp::default());
            assert_eq!((message.distortion_model.as_str(), message.d.len()), ("", 0));
            let p_c = Vector3::new(1e-4, -2e-4, 1.0);
            let seen = Matrix3::from_row_slice(&message.k) * p_c;
            let expected = camera.model().project(&p_c).unwrap();
            assert!((seen.xy() - expected).norm() < 1e-6, "{distortion:?}");
        }
    }

    #[test]
    fn messages_are_bounded_and_one_camera_has_one_calibration() {
        let mut config = config();
        for name in [&mut config.ros.body_frame, &mut config.ros.base_frame] {
            *name = "f".repeat(64);
        }
        let late = Timestamp::from_nanos(i64::MAX);
        let bytes: usize = messages(&config, late).iter().map(|(_, message)| message.len() + 64).sum();
        assert!(bytes as u64 <= MAX_BYTES, "{bytes}");
        config.camera.truncate(1);
        let channels: Vec<_> = messages(&config, late).into_iter().map(|(channel, _)| channel).collect();
        assert_eq!(channels, [Channel::LeftCalibration, Channel::Mounting]);
    }
}
