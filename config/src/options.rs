//! The configuration as plain typed data: what one TOML file says.
//!
//! Units stand in the names; every field is required unless it has a default written here. Loading,
//! validation and importers are in their own modules. The presets document the same fields for users;
//! tests hold both together. A value of [`Config`] handed to the estimator has
//! passed validation.

mod autopilot;
mod lines;
mod network;
mod recorder;
mod ros;
mod runtime;

pub use autopilot::{AutopilotClock, AutopilotConfig, AutopilotEndpoint, LostPose};
pub use lines::LinesConfig;
pub use network::{Commands, Link, LoginConfig, NetworkConfig, TlsConfig};
pub use recorder::{ImageRecording, KeepPolicy, RecorderConfig};
pub use ros::{RosConfig, RosDistribution, RosStamp};
pub use runtime::RuntimeConfig;

use crate::CameraModel;
use crate::camera::Distortion;
use nalgebra::{Isometry3, Vector2};
use serde::{Deserialize, Serialize};

/// Everything Plumbline needs to know before the first sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// One or two cameras: `camera[0]` is left (`C0`), `camera[1]` right (`C1`).
    pub camera: Vec<CameraConfig>,
    /// The inertial sensor.
    pub imu: ImuConfig,
    /// How well the extrinsics of the sensors are known.
    #[serde(default)]
    pub rig: RigConfig,
    /// Capacities and thresholds of the estimator.
    #[serde(default)]
    pub estimator: EstimatorConfig,
    /// Where samples come from.
    #[serde(default)]
    pub driver: DriverConfig,
    /// What is published, and to whom.
    #[serde(default)]
    pub network: NetworkConfig,
    /// What is published to ROS 2.
    #[serde(default)]
    pub ros: RosConfig,
    /// What a live run asks of the host.
    #[serde(default)]
    pub runtime: RuntimeConfig,
    /// What the flight recorder keeps, and how much of it.
    #[serde(default)]
    pub recorder: RecorderConfig,
    /// The vehicle's autopilot, and what it is told.
    #[serde(default)]
    pub autopilot: AutopilotConfig,
}

impl Config {
    /// These sensors, and the defaults for all else.
    #[must_use]
    pub fn with_defaults(camera: Vec<CameraConfig>, imu: ImuConfig) -> Self {
        Self {
            camera,
            imu,
            rig: RigConfig::default(),
            estimator: EstimatorConfig::default(),
            driver: DriverConfig::default(),
            network: NetworkConfig::default(),
            ros: RosConfig::default(),
            runtime: RuntimeConfig::default(),
            recorder: RecorderConfig::default(),
            autopilot: AutopilotConfig::default(),
        }
    }
}

/// One camera: intrinsics and extrinsics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraConfig {
    /// Image width in pixels.
    pub width_px: usize,
    /// Image height in pixels.
    pub height_px: usize,
    /// Frames per second.
    pub rate_hz: f64,
    /// Focal lengths `[fx, fy]` in pixels.
    pub focal_px: [f64; 2],
    /// Principal point `[cx, cy]` in pixels.
    pub centre_px: [f64; 2],
    /// Lens distortion.
    pub distortion: Distortion,
    /// `T_BC`, row-major 4x4: takes coordinates from the camera to the body (metres).
    pub pose_b_c: [[f64; 4]; 4],
}

impl CameraConfig {
    /// The camera model of this calibration.
    #[must_use]
    pub fn model(&self) -> CameraModel {
        CameraModel {
            width_px: self.width_px,
            height_px: self.height_px,
            focal_px: Vector2::from(self.focal_px),
            centre_px: Vector2::from(self.centre_px),
            distortion: self.distortion,
        }
    }

    /// `pose_b_c` as a rigid transform (the rotation block made orthonormal).
    #[must_use]
    pub fn pose_b_c(&self) -> Isometry3<f64> {
        crate::options::isometry_from_rows(&self.pose_b_c)
    }
}

/// A rigid transform from a row-major 4x4 matrix whose rotation block is orthonormal up to rounding.
///
/// The nearest rotation is found by the iteration `R <- R (3 - RᵀR) / 2` (Higham 1986), which squares the
/// error in each step: from the 1e-3 that validation admits, three reach machine precision.
#[must_use]
pub fn isometry_from_rows(rows: &[[f64; 4]; 4]) -> Isometry3<f64> {
    use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};
    let mut r = Matrix3::from_fn(|i, j| rows[i][j]);
    for _ in 0..4 {
        r = r * (Matrix3::identity() * 3.0 - r.transpose() * r) * 0.5;
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
    Isometry3::from_parts(Translation3::new(rows[0][3], rows[1][3], rows[2][3]), rotation)
}

/// The row-major 4x4 matrix of a rigid transform: the inverse of [`isometry_from_rows`].
#[must_use]
pub fn rows_from_isometry(pose: &Isometry3<f64>) -> [[f64; 4]; 4] {
    let matrix = pose.to_homogeneous();
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]))
}

/// Noise model and limits of the inertial sensor (the IMU frame is the body frame `B`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImuConfig {
    /// Samples per second.
    pub rate_hz: f64,
    /// Gyroscope white noise density, rad/s/sqrt(Hz).
    pub gyro_noise_density: f64,
    /// Gyroscope bias random walk, rad/s²/sqrt(Hz).
    pub gyro_bias_walk: f64,
    /// Accelerometer white noise density, m/s²/sqrt(Hz).
    pub accel_noise_density: f64,
    /// Accelerometer bias random walk, m/s³/sqrt(Hz).
    pub accel_bias_walk: f64,
    /// Largest angular rate the sensor can report, rad/s.
    #[serde(default = "default_gyro_range")]
    pub gyro_range_rad_s: f64,
    /// Largest specific force the sensor can report, m/s².
    #[serde(default = "default_accel_range")]
    pub accel_range_m_s2: f64,
    /// Standard deviation of the gyroscope bias at switch-on, rad/s.
    #[serde(default = "default_gyro_bias_sigma")]
    pub gyro_bias_sigma_rad_s: f64,
    /// Standard deviation of the accelerometer bias at switch-on, m/s².
    #[serde(default = "default_accel_bias_sigma")]
    pub accel_bias_sigma_m_s2: f64,
    /// Magnitude of gravity, m/s².
    #[serde(default = "default_gravity")]
    pub gravity_m_s2: f64,
}

impl ImuConfig {
    /// A sensor of `(density, bias walk)` of the gyroscope and of the accelerometer, and the default limits.
    #[must_use]
    pub fn with_noise(rate_hz: f64, gyro: (f64, f64), accel: (f64, f64)) -> Self {
        Self {
            rate_hz,
            gyro_noise_density: gyro.0,
            gyro_bias_walk: gyro.1,
            accel_noise_density: accel.0,
            accel_bias_walk: accel.1,
            gyro_range_rad_s: default_gyro_range(),
            accel_range_m_s2: default_accel_range(),
            gyro_bias_sigma_rad_s: default_gyro_bias_sigma(),
            accel_bias_sigma_m_s2: default_accel_bias_sigma(),
            gravity_m_s2: default_gravity(),
        }
    }
}

fn default_gyro_range() -> f64 {
    17.4
}
fn default_accel_range() -> f64 {
    156.9
}
fn default_gyro_bias_sigma() -> f64 {
    0.1
}
fn default_accel_bias_sigma() -> f64 {
    0.3
}
fn default_gravity() -> f64 {
    9.81
}

/// How far the calibration of the rig may be off, one standard deviation each: the priors of the online
/// refinement. Zero switches the refinement of that quantity off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RigConfig {
    /// `t_imu = t_camera + time_offset_s`: added to every image stamp.
    pub time_offset_s: f64,
    /// Standard deviation of the time offset, s.
    pub time_offset_sigma_s: f64,
    /// Rotation of the left camera against the IMU, rad.
    pub camera_imu_rotation_sigma_rad: f64,
    /// Position of the left camera in the body, m.
    pub camera_imu_translation_sigma_m: f64,
    /// Rotation of the right camera against the left, rad.
    pub camera_camera_rotation_sigma_rad: f64,
    /// Position of the right camera against the left, m.
    pub camera_camera_translation_sigma_m: f64,
}

impl Default for RigConfig {
    fn default() -> Self {
        Self {
            time_offset_s: 0.0,
            time_offset_sigma_s: 0.004,
            camera_imu_rotation_sigma_rad: 0.008,
            camera_imu_translation_sigma_m: 0.004,
            camera_camera_rotation_sigma_rad: 0.001,
            camera_camera_translation_sigma_m: 0.0005,
        }
    }
}

/// Capacities and thresholds of the estimator.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EstimatorConfig {
    /// Point features.
    pub points: PointsConfig,
    /// Line segments.
    pub lines: LinesConfig,
    /// Sliding window.
    pub window: WindowConfig,
    /// Initialisation.
    pub initial: InitialConfig,
    /// Failure detection and resets.
    pub health: HealthConfig,
}

/// Detection and tracking of points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PointsConfig {
    /// Most points tracked at a time.
    pub max_points: usize,
    /// Side of the square detection cells, px: an empty cell gets a new point.
    pub cell_px: usize,
    /// Smallest Shi-Tomasi score (lesser eigenvalue of the structure tensor per pixel, in squared grey
    /// levels per px²) of a new point.
    pub min_corner_score: f32,
    /// Pyramid levels, the full image included.
    pub pyramid_levels: usize,
    /// Gauss-Newton steps per level and point, at most.
    pub max_iterations: usize,
    /// Largest distance between a point and its forward-backward return, px.
    pub max_forward_backward_px: f32,
    /// Largest distance of a stereo match from its epipolar line, px.
    pub max_epipolar_px: f32,
    /// Points this close to the image edge are dropped, px.
    pub border_px: usize,
    /// Standard deviation of a tracked point, px at full resolution.
    pub sigma_px: f64,
}

impl Default for PointsConfig {
    fn default() -> Self {
        Self {
            max_points: 120,
            cell_px: 52,
            min_corner_score: 12.0,
            pyramid_levels: 4,
            max_iterations: 8,
            max_forward_backward_px: 0.4,
            max_epipolar_px: 2.5,
            border_px: 8,
            sigma_px: 0.4,
        }
    }
}

/// The sliding window and its solver.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WindowConfig {
    /// Keyframes held.
    pub keyframes: usize,
    /// Newest frames held beside the keyframes.
    pub recent_frames: usize,
    /// Landmarks held.
    pub max_landmarks: usize,
    /// Gauss-Newton or Levenberg-Marquardt steps per frame, at most.
    pub max_iterations: usize,
    /// A frame becomes a keyframe when less than this share of its points is linked to the window.
    pub min_connected_ratio: f64,
    /// A frame becomes a keyframe at the latest after this time.
    pub max_keyframe_interval_s: f64,
    /// Scale of the Cauchy kernel, in standard deviations.
    pub cauchy_scale: f64,
    /// Points further than this are not triangulated, m.
    pub max_depth_m: f64,
    /// Points nearer than this are not triangulated, m.
    pub min_depth_m: f64,
}

impl Default for WindowConfig {
    fn default() -> Self {
        Self {
            keyframes: 7,
            recent_frames: 3,
            max_landmarks: 600,
            max_iterations: 5,
            min_connected_ratio: 0.7,
            max_keyframe_interval_s: 2.0,
            cauchy_scale: 2.0,
            max_depth_m: 60.0,
            min_depth_m: 0.2,
        }
    }
}

/// Initialisation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct InitialConfig {
    /// Stereo frames gathered before the first pose.
    pub stereo_frames: usize,
    /// Data gathered before the first monocular pose, s.
    pub mono_window_s: f64,
    /// Mean parallax (rotation taken out) that a monocular start needs, px.
    pub mono_min_parallax_px: f64,
}

impl Default for InitialConfig {
    fn default() -> Self {
        Self { stereo_frames: 4, mono_window_s: 1.5, mono_min_parallax_px: 20.0 }
    }
}

/// When an estimate counts as failed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HealthConfig {
    /// Speed above which the estimate is taken for diverged, m/s.
    pub max_speed_m_s: f64,
    /// Standard deviation of the velocity above which it is taken for diverged, m/s.
    pub max_velocity_sigma_m_s: f64,
    /// Flight without any visual landmark that is survived on the IMU alone, s.
    pub max_blind_s: f64,
    /// Gyroscope bias above which the estimate is taken for diverged, rad/s.
    pub max_gyro_bias_rad_s: f64,
    /// Accelerometer bias above which the estimate is taken for diverged, m/s².
    pub max_accel_bias_m_s2: f64,
    /// No automatic reset within this time after the last one, s.
    pub reset_holdoff_s: f64,
}

impl Default for HealthConfig {
    fn default() -> Self {
        Self {
            max_speed_m_s: 20.0,
            max_velocity_sigma_m_s: 2.0,
            max_blind_s: 5.0,
            max_gyro_bias_rad_s: 0.5,
            max_accel_bias_m_s2: 2.0,
            reset_holdoff_s: 2.0,
        }
    }
}

/// Where samples come from when none is named on the command line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DriverConfig {
    /// Stereo pairs decoded or rendered ahead of need.
    pub image_queue: usize,
    /// Largest difference of stamps within a stereo pair, s.
    pub pair_tolerance_s: f64,
    /// Late samples are put in order within this time, s; later ones are refused and counted.
    pub reorder_window_s: f64,
}

impl Default for DriverConfig {
    fn default() -> Self {
        Self { image_queue: 4, pair_tolerance_s: 0.002, reorder_window_s: 0.02 }
    }
}
