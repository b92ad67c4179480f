//! Fixtures of the simulator's tests: a EuRoC rig, and short flights.

use super::trajectory::Trajectory;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use plumbline_config::camera::Distortion;
use plumbline_config::options::{CameraConfig, ImuConfig};
use plumbline_config::{Config, Timestamp};
use plumbline_drivers::StampedPose;

fn camera(focal_px: [f64; 2], centre_px: [f64; 2], d: [f64; 4], pose_b_c: [[f64; 4]; 4]) -> CameraConfig {
    let distortion = Distortion::RadialTangential { k1: d[0], k2: d[1], p1: d[2], p2: d[3] };
    CameraConfig {
        width_px: 752,
        height_px: 480,
        rate_hz: 20.0,
        readout_s: 0.0,
        exposure_s: 0.0,
        mask: None,
        focal_px,
        centre_px,
        distortion,
        pose_b_c,
    }
}

/// The EuRoC rig.
pub(crate) fn config() -> Config {
    let left = camera(
        [458.654, 457.296],
        [367.215, 248.375],
        [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05],
        [
            [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975],
            [0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768],
            [-0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949],
            [0.0, 0.0, 0.0, 1.0],
        ],
    );
    let right = camera(
        [457.587, 456.134],
        [379.999, 255.238],
        [-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05],
        [
            [0.0125552670891, -0.999755099723, 0.0182237714554, -0.0198435579556],
            [0.999598781151, 0.0130119051815, 0.0251588363115, 0.0453689425024],
            [-0.0253898008918, 0.0179005838253, 0.999517347078, 0.00786212447038],
            [0.0, 0.0, 0.0, 1.0],
        ],
    );
    let imu = ImuConfig {
        gyro_error_sigma_rad_s: 0.0,
        accel_error_sigma_m_s2: 0.0,
        gyro_scale_sigma: 0.0,
        accel_scale_sigma: 0.0,
        ..ImuConfig::with_noise(200.0, (1.6968e-4, 1.9393e-5), (2.0e-3, 3.0e-3))
    };
    Config::new(vec![left, right], imu)
}

/// Poses at 200 Hz of a flight that turns about all axes.
pub(crate) fn wobble_poses(duration_s: f64) -> Vec<StampedPose> {
    let count = (duration_s * 200.0) as i64;
    (0..=count)
        .map(|i| {
            let t = i as f64 * 0.005;
            let p = Vector3::new((0.9 * t).sin(), 0.8 * (1.1 * t).cos(), 1.5 + 0.3 * (1.7 * t).sin());
            let r = Vector3::new(0.4 * (1.3 * t).sin(), 0.3 * (0.8 * t).cos(), 2.0 * (0.6 * t).sin());
            let rotation = UnitQuaternion::from_scaled_axis(r);
            let pose = Isometry3::from_parts(Translation3::from(p), rotation);
            StampedPose { stamp: Timestamp::from_nanos(2_000_000_000 + i * 5_000_000), pose }
        })
        .collect()
}

/// A flight that turns about all axes.
pub(crate) fn wobble(duration_s: f64) -> Trajectory {
    Trajectory::from_poses(&wobble_poses(duration_s)).unwrap()
}

/// A body that stands still, tilted.
pub(crate) fn standing(duration_s: f64) -> Trajectory {
    let mut poses = wobble_poses(duration_s);
    let tilted = Isometry3::new(Vector3::new(1.0, 2.0, 1.0), Vector3::new(0.2, -0.1, 0.7));
    poses.iter_mut().for_each(|p| p.pose = tilted);
    Trajectory::from_poses(&poses).unwrap()
}
