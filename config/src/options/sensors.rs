//! The sensors as they were calibrated: cameras, inertial sensor, and how well their extrinsics are known.

use super::Mask;
use crate::CameraModel;
use crate::camera::Distortion;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

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
    /// Readout of a rolling shutter: time from the exposure of the first row to that of the last, s. 0 for a global shutter.
    /// Stamps mean the middle of the exposure of the middle row.
    #[serde(default)]
    pub readout_s: f64,
    /// Longest exposure, s, from which blur by turning is reported; 0 where it is unknown. No estimate depends on it.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub exposure_s: f64,
    /// What of the images is ignored, as parts of the vehicle: a PNG picture of their size, black where nothing is looked at,
    /// by its path from the folder of the configuration on.
    #[serde(default, deserialize_with = "mask_or_none", skip_serializing_if = "Option::is_none")]
    pub mask: Option<Mask>,
    /// `T_BC`, row-major 4x4: takes coordinates from the camera to the body (metres).
    pub pose_b_c: [[f64; 4]; 4],
}

/// The mask of a text; an empty one is none.
fn mask_or_none<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Mask>, D::Error> {
    let text = String::deserialize(deserializer)?;
    if text.is_empty() { Ok(None) } else { Mask::try_from(text).map(Some).map_err(D::Error::custom) }
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// Sizes of the images of left and right camera, px; (0, 0) for a camera that is not there.
#[must_use]
pub fn image_sizes(cameras: &[CameraConfig]) -> [(usize, usize); 2] {
    [0, 1].map(|k| cameras.get(k).map_or((0, 0), |camera| (camera.width_px, camera.height_px)))
}

impl CameraConfig {
    /// The camera model of this calibration.
    #[must_use]
    #[inline]
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
    #[inline]
    pub fn pose_b_c(&self) -> Isometry3<f64> {
        isometry_from_rows(&self.pose_b_c)
    }
}

/// A rigid transform from a row-major 4x4 matrix whose rotation block is orthonormal up to rounding.
///
/// The nearest rotation is found by the iteration `R <- R (3 - RᵀR) / 2` (Higham 1986), which squares the
/// error in each step: from the 1e-3 that validation admits, three reach machine precision, and the fourth changes
/// nothing but the last bit.
#[must_use]
#[inline]
pub fn isometry_from_rows(rows: &[[f64; 4]; 4]) -> Isometry3<f64> {
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
    /// Standard deviation of the gyroscope's coloured error in flight, rad/s, such as rectified vibration: neither white nor a
    /// constant bias. 0 for none.
    #[serde(default = "default_gyro_error_sigma")]
    pub gyro_error_sigma_rad_s: f64,
    /// Standard deviation of the accelerometer's coloured error in flight, m/s². 0 for none.
    #[serde(default = "default_accel_error_sigma")]
    pub accel_error_sigma_m_s2: f64,
    /// Correlation time of both, s (Gauss-Markov).
    #[serde(default = "default_error_time")]
    pub error_time_s: f64,
    /// Share of an angular rate that the gyroscope's scale and alignment may be wrong by (one standard deviation).
    #[serde(default = "default_gyro_scale_sigma")]
    pub gyro_scale_sigma: f64,
    /// Share of a specific force beyond gravity that the accelerometer's scale and alignment may be wrong by.
    #[serde(default = "default_accel_scale_sigma")]
    pub accel_scale_sigma: f64,
    /// Largest angular rate the sensor can report, rad/s.
    #[serde(default = "default_gyro_range")]
    pub gyro_range_rad_s: f64,
    /// Largest specific force the sensor can report, m/s².
    #[serde(default = "default_accel_range")]
    pub accel_range_m_s2: f64,
    /// A sensor counts as stuck when all three axes repeat their readings bit for bit for this time, s; sooner if the
    /// vehicle moves. 0 disables the check, for sensors without noise.
    #[serde(default = "default_stuck_after")]
    pub stuck_after_s: f64,
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
            gyro_error_sigma_rad_s: default_gyro_error_sigma(),
            accel_error_sigma_m_s2: default_accel_error_sigma(),
            error_time_s: default_error_time(),
            gyro_scale_sigma: default_gyro_scale_sigma(),
            accel_scale_sigma: default_accel_scale_sigma(),
            gyro_range_rad_s: default_gyro_range(),
            accel_range_m_s2: default_accel_range(),
            stuck_after_s: default_stuck_after(),
            gyro_bias_sigma_rad_s: default_gyro_bias_sigma(),
            accel_bias_sigma_m_s2: default_accel_bias_sigma(),
            gravity_m_s2: default_gravity(),
        }
    }
}

fn default_gyro_error_sigma() -> f64 {
    2e-4
}
/// ADIS16448 and rig of EuRoC show 0.01 to 0.03 m/s² an octave against their recorded paths, below 1 Hz and noise of the paths
/// included.
fn default_accel_error_sigma() -> f64 {
    0.015
}
fn default_error_time() -> f64 {
    1.5
}
/// Scale and alignment of a sensor of a few grams after calibration by its maker.
fn default_gyro_scale_sigma() -> f64 {
    0.003
}
fn default_accel_scale_sigma() -> f64 {
    0.005
}
fn default_gyro_range() -> f64 {
    17.4
}
fn default_accel_range() -> f64 {
    156.9
}
fn default_stuck_after() -> f64 {
    0.1
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
    /// Standard deviation of the rotation of the left camera relative to the IMU, rad.
    pub camera_imu_rotation_sigma_rad: f64,
    /// Standard deviation of the position of the left camera in the body, m.
    pub camera_imu_translation_sigma_m: f64,
    /// Standard deviation of the rotation of the right camera relative to the left, rad.
    pub camera_camera_rotation_sigma_rad: f64,
    /// Standard deviation of the position of the right camera relative to the left, m.
    pub camera_camera_translation_sigma_m: f64,
    /// Time in which the refined calibration loses a careful calibration's accuracy again, s: 1 mm and 0.3 mrad against the
    /// IMU, 0.05 mm and 0.1 mrad between the cameras, 0.3 ms. Keeps systematic errors from becoming certainty. 0: never.
    pub memory_s: f64,
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
            memory_s: 30.0,
        }
    }
}
