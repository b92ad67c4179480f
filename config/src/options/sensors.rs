//! The sensors as they were calibrated: cameras, inertial sensor, and how well their extrinsics are known.

use super::Mask;
use crate::CameraModel;
use crate::camera::Distortion;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2};
use plumbline_keys::keys;
use serde::de::Error;
use serde::{Deserialize, Deserializer};

/// One camera: intrinsics and extrinsics.
#[keys]
pub struct CameraConfig {
    /// Image width in pixels.
    #[key(range = 64..=4096, unit = PIXELS)]
    pub width_px: usize,
    /// Image height in pixels.
    #[key(range = 64..=4096, unit = PIXELS)]
    pub height_px: usize,
    /// Frames per second.
    #[key(range = 1.0..=500.0, unit = HZ, cure = "write it in frames per second (is this a period?)")]
    pub rate_hz: f64,
    /// Focal lengths `[fx, fy]` in pixels.
    #[key(range = 10.0..=2e4, unit = PIXELS, cure = "write it in pixels (is this in mm?)")]
    pub focal_px: [f64; 2],
    /// Principal point `[cx, cy]` in pixels; the first pixel's centre is (0, 0).
    #[key]
    pub centre_px: [f64; 2],
    /// Lens distortion. Models: "radial-tangential" (k1, k2, p1, p2, as OpenCV and Kalibr's radtan), "equidistant" (k1, k2, k3,
    /// k4, as OpenCV's fisheye), "rational" (k1, k2, p1, p2, k3, k4, k5, k6, as OpenCV's eight coefficients), "omni" (xi, k1,
    /// k2, p1, p2, as Kalibr's omni-radtan), "eucm" (alpha, beta) or "double-sphere" (xi, alpha).
    #[key]
    pub distortion: Distortion,
    /// Readout of a rolling shutter, from the first row to the last; 0 for a global shutter. Stamps are the middle of
    /// the exposure of the middle row.
    #[key(default, range = 0.0..=0.1, unit = SECONDS, cure = "write it in seconds (is this in ms?); 0 for a global shutter")]
    pub readout_s: f64,
    /// Longest exposure, from which blur is reported; 0 where it is unknown. No estimate depends on it.
    #[serde(skip_serializing_if = "is_zero")]
    #[key(default, range = 0.0..=0.2, unit = SECONDS, cure = "write it in seconds (is this in ms?); 0 where it is unknown")]
    pub exposure_s: f64,
    /// PNG mask of the size of the images; black is ignored. It is for parts of the vehicle in view. The path begins
    /// at the folder of this file. Empty for the whole image.
    #[serde(deserialize_with = "mask_or_none", skip_serializing_if = "Option::is_none")]
    #[key(default)]
    pub mask: Option<Mask>,
    /// `T_BC`, camera to body, row by row. The last column is the camera's position in the body in metres.
    #[key]
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
pub fn image_sizes(cameras: &[CameraConfig]) -> [(usize, usize); 2] {
    [0, 1].map(|k| cameras.get(k).map_or((0, 0), |camera| (camera.width_px, camera.height_px)))
}

impl CameraConfig {
    /// The camera model of this calibration.
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
pub fn rows_from_isometry(pose: &Isometry3<f64>) -> [[f64; 4]; 4] {
    let matrix = pose.to_homogeneous();
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]))
}

/// Noise model and limits of the inertial sensor (the IMU frame is the body frame `B`).
#[keys]
pub struct ImuConfig {
    /// Samples per second.
    #[key(range = 50.0..=4000.0, unit = HZ)]
    pub rate_hz: f64,
    /// Gyroscope white noise density.
    #[key(range = 1e-7..=0.05, unit = GYRO_DENSITY)]
    pub gyro_noise_density: f64,
    /// Gyroscope bias random walk.
    #[key(range = 1e-9..=0.01, unit = GYRO_WALK)]
    pub gyro_bias_walk: f64,
    /// Accelerometer white noise density.
    #[key(range = 1e-6..=1.0, unit = ACCEL_DENSITY)]
    pub accel_noise_density: f64,
    /// Accelerometer bias random walk.
    #[key(range = 1e-8..=0.1, unit = ACCEL_WALK)]
    pub accel_bias_walk: f64,
    /// Standard deviation of the gyroscope's coloured error; 0 for none. Coloured errors (Gauss-Markov) occur in
    /// flight, for example as rectified vibration. They neither average out like white noise nor stay constant like a
    /// bias.
    #[key(default = 2e-4, range = 0.0..=0.5, unit = RADIANS_PER_SECOND)]
    pub gyro_error_sigma_rad_s: f64,
    /// Standard deviation of the accelerometer's coloured error; 0 for none.
    // ADIS16448 and rig of EuRoC show 0.01 to 0.03 m/s² an octave against their recorded paths, below 1 Hz and noise of the
    // paths included.
    #[key(default = 0.015, range = 0.0..=5.0, unit = METRES_PER_SECOND_2)]
    pub accel_error_sigma_m_s2: f64,
    /// Correlation time of both coloured errors.
    #[key(default = 1.5, range = 0.05..=100.0, unit = SECONDS)]
    pub error_time_s: f64,
    /// Standard deviation of the gyroscope's scale and alignment, as a fraction of the rate. The data sheet states it
    /// (0.3 % = 0.003); 0 for none.
    // Scale and alignment of a sensor of a few grams after calibration by its maker.
    #[key(default = 0.003, range = 0.0..=0.1, unit = SHARE)]
    pub gyro_scale_sigma: f64,
    /// Standard deviation of the accelerometer's scale and alignment, as a fraction of the force beyond gravity.
    #[key(default = 0.005, range = 0.0..=0.1, unit = SHARE)]
    pub accel_scale_sigma: f64,
    /// Range of the gyroscope (1000 deg/s).
    #[key(default = 17.4, range = 1.0..=100.0, unit = RADIANS_PER_SECOND, cure = "write it in rad/s (1000 deg/s = 17.45 rad/s)")]
    pub gyro_range_rad_s: f64,
    /// Range of the accelerometer (16 g).
    #[key(default = 156.9, range = 15.0..=2000.0, unit = METRES_PER_SECOND_2, cure = "write it in m/s² (16 g = 156.9 m/s²)")]
    pub accel_range_m_s2: f64,
    /// Time after which a sensor counts as stuck, if all axes repeat bit for bit. It is shorter while the vehicle
    /// moves. 0 disables the check, for sensors without noise.
    #[key(default = 0.1, range = 0.0..=10.0, unit = SECONDS, cure = "write it in seconds, 0 to switch it off")]
    pub stuck_after_s: f64,
    /// Standard deviation of the gyroscope bias at switch-on.
    #[key(default = 0.1, range = 1e-6..=1.0, unit = RADIANS_PER_SECOND)]
    pub gyro_bias_sigma_rad_s: f64,
    /// Standard deviation of the accelerometer bias at switch-on.
    #[key(default = 0.3, range = 1e-6..=5.0, unit = METRES_PER_SECOND_2)]
    pub accel_bias_sigma_m_s2: f64,
    /// Magnitude of gravity.
    #[key(default = 9.81, range = 9.7..=9.9, unit = METRES_PER_SECOND_2,
        cure = "write the positive magnitude on Earth in m/s², about 9.81")]
    pub gravity_m_s2: f64,
}

impl ImuConfig {
    /// A sensor of `(density, bias walk)` of the gyroscope and of the accelerometer, and the default limits.
    pub fn with_noise(rate_hz: f64, gyro: (f64, f64), accel: (f64, f64)) -> Self {
        Self::new(rate_hz, gyro.0, gyro.1, accel.0, accel.1)
    }
}

/// Uncertainty of the calibration of the rig, one standard deviation each: the priors of the online
/// refinement. Zero switches the refinement of that quantity off.
#[keys]
pub struct RigConfig {
    /// `t_imu = t_camera + time_offset_s`, s.
    #[key(default = 0.0, range = -0.1..=0.1, unit = SECONDS)]
    pub time_offset_s: f64,
    /// Standard deviation of the time offset.
    #[key(default = 0.004, range = 0.0..=0.05, unit = SECONDS)]
    pub time_offset_sigma_s: f64,
    /// Standard deviation of the left camera's rotation against the IMU.
    #[key(default = 0.008, range = 0.0..=0.2, unit = RADIANS)]
    pub camera_imu_rotation_sigma_rad: f64,
    /// Standard deviation of the left camera's position in the body.
    #[key(default = 0.004, range = 0.0..=0.5, unit = METRES)]
    pub camera_imu_translation_sigma_m: f64,
    /// Standard deviation of the right camera's rotation against the left.
    #[key(default = 0.001, range = 0.0..=0.1, unit = RADIANS)]
    pub camera_camera_rotation_sigma_rad: f64,
    /// Standard deviation of the right camera's position against the left.
    #[key(default = 0.0005, range = 0.0..=0.1, unit = METRES)]
    pub camera_camera_translation_sigma_m: f64,
    /// Standard deviation of the focal length of each camera of a pair, as a fraction of it.
    #[key(default = 0.0002, range = 0.0..=0.05, unit = SHARE)]
    pub camera_focal_sigma: f64,
    /// Standard deviation of the principal point of each camera of a pair, in each direction.
    #[key(default = 0.2, range = 0.0..=50.0, unit = PIXELS)]
    pub camera_centre_sigma_px: f64,
    /// Time in which the variance of the refined calibration grows by that of a careful one. That is 1 mm and 0.3
    /// mrad to the IMU, 0.05 mm and 0.1 mrad between the cameras, 0.3 ms. The growth prevents the refinement from
    /// becoming overconfident under systematic errors. 0 disables it.
    #[key(default = 30.0, range = 0.0..=1e6, unit = SECONDS)]
    pub memory_s: f64,
}
