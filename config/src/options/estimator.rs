//! Capacities and thresholds of the estimator: points, window, initialisation, health. Lines have their own
//! module.

use super::{LinesConfig, PlacesConfig};
use serde::{Deserialize, Serialize};

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
    /// Recognition of places.
    pub places: PlacesConfig,
}

/// Detection and tracking of points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PointsConfig {
    /// Most points tracked at a time.
    pub max_points: usize,
    /// Side length of the square detection cells, px. An empty cell gets a new point.
    pub cell_px: usize,
    /// Smallest Shi-Tomasi score (lesser eigenvalue of the structure tensor per pixel, in squared grey
    /// levels per px²) of a new point.
    pub min_corner_score: f32,
    /// Pyramid levels, the full image included.
    pub pyramid_levels: usize,
    /// Largest number of Gauss-Newton steps per level and point.
    pub max_iterations: usize,
    /// Largest distance between a point and its forward-backward return, px.
    pub max_forward_backward_px: f32,
    /// Largest distance of a stereo match from its epipolar line, px.
    pub max_epipolar_px: f32,
    /// Points this close to the image edge are dropped, px.
    pub border_px: usize,
    /// Whether noisy images (by night, at a high gain) are smoothed before points are looked for.
    pub denoise: bool,
    /// Whether only points are tracked whose surroundings do not repeat close by, and matched on the full image: for scenes of fine
    /// repeated texture.
    pub unique_only: bool,
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
            denoise: true,
            unique_only: false,
            sigma_px: 0.4,
        }
    }
}

/// The sliding window and its solver.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WindowConfig {
    /// Number of keyframes in the window.
    pub keyframes: usize,
    /// Number of newest frames in the window, in addition to the keyframes.
    pub recent_frames: usize,
    /// Largest number of point landmarks in the window.
    pub max_landmarks: usize,
    /// Gauss-Newton or Levenberg-Marquardt steps per frame, at most.
    pub max_iterations: usize,
    /// A frame becomes a keyframe if less than this share of its points is linked to the window.
    pub min_connected_ratio: f64,
    /// A frame becomes a keyframe at the latest after this time.
    pub max_keyframe_interval_s: f64,
    /// Largest share of what a frame sees that is taken for moving things because it contradicts the motion which window and IMU
    /// predict; 0 for none.
    pub max_moving_share: f64,
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
            max_moving_share: 0.85,
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
    /// Number of stereo frames collected before the first pose.
    pub stereo_frames: usize,
    /// Duration of the data collected before the first monocular pose, s.
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
    /// Speed above which the estimate counts as diverged, m/s.
    pub max_speed_m_s: f64,
    /// Standard deviation of the velocity in the body at which the quality is 0, m/s. After a start, nothing is published until
    /// it is below a tenth of this.
    pub max_velocity_sigma_m_s: f64,
    /// Longest time without visual landmarks that is bridged by the IMU alone, s.
    pub max_blind_s: f64,
    /// Gyroscope bias above which the estimate counts as diverged, rad/s.
    pub max_gyro_bias_rad_s: f64,
    /// Accelerometer bias above which the estimate counts as diverged, m/s².
    pub max_accel_bias_m_s2: f64,
    /// Least time between automatic resets, s.
    pub reset_holdoff_s: f64,
    /// Treat an image that repeats the previous one bit for bit as missing. `false` for cameras without noise, whose
    /// images repeat while the vehicle stands.
    pub refuse_repeated_images: bool,
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
            refuse_repeated_images: true,
        }
    }
}
