//! Capacities and thresholds of the estimator: points, lines, window, health, places.

use plumbline_keys::keys;

/// Capacities and thresholds of the estimator.
#[keys]
pub struct EstimatorConfig {
    /// Detection and tracking of points.
    #[key(default)]
    pub points: PointsConfig,
    /// Line segments: extraction, description, matching.
    #[key(default)]
    pub lines: LinesConfig,
    /// The sliding window and its solver; keyframes and recent frames together are at most 15.
    #[key(default)]
    pub window: WindowConfig,
    /// Conditions under which an estimate counts as failed.
    #[key(default)]
    pub health: HealthConfig,
    /// Recognition of places, and the map that is built in flight.
    #[key(default)]
    pub places: PlacesConfig,
}

/// Detection and tracking of points.
#[keys]
pub struct PointsConfig {
    /// Largest number of points tracked at a time.
    #[key(default = 120, range = 8..=2000)]
    pub max_points: usize,
    /// Side of the square detection cells. An empty cell gets a new point.
    #[key(default = 52, range = 8..=128, unit = PIXELS)]
    pub cell_px: usize,
    /// Smallest Shi-Tomasi score of a new point, (grey levels/px)².
    #[key(default = 12.0, range = 1e-3..=1e5)]
    pub min_corner_score: f32,
    /// Pyramid levels, the full image included.
    #[key(default = 4, range = 1..=8)]
    pub pyramid_levels: usize,
    /// Largest number of Gauss-Newton steps per level and point.
    #[key(default = 8, range = 1..=100, experiment)]
    pub max_iterations: usize,
    /// Largest forward-backward error of a tracked point, px.
    #[key(default = 0.4, range = 1e-3..=20.0, unit = PIXELS, experiment)]
    pub max_forward_backward_px: f32,
    /// Largest distance of a stereo match from its epipolar line.
    #[key(default = 2.5, range = 0.01..=50.0, unit = PIXELS)]
    pub max_epipolar_px: f32,
    /// Points this close to the image edge are dropped.
    #[key(default = 8, range = 0..=200, unit = PIXELS)]
    pub border_px: usize,
    /// Smooths noisy images (by night, at a high gain) before points are looked for.
    #[key(default = true, experiment)]
    pub denoise: bool,
    /// Tracks only points whose surroundings do not repeat close by, and matches them on the full image. It is for
    /// fine repeated texture (perforated plates, fabric), at half as much processor time again.
    #[key(default = false)]
    pub unique_only: bool,
    /// Standard deviation of a tracked point, at full resolution.
    #[key(default = 0.4, range = 0.01..=20.0, unit = PIXELS)]
    pub sigma_px: f64,
}

/// The sliding window and its solver.
#[keys]
pub struct WindowConfig {
    /// Number of keyframes in the window.
    #[key(default = 7, range = 2..=14)]
    pub keyframes: usize,
    /// Number of newest frames in the window besides the keyframes.
    #[key(default = 3, range = 1..=13)]
    pub recent_frames: usize,
    /// Largest number of point landmarks in the window.
    #[key(default = 600, range = 8..=10_000, experiment)]
    pub max_landmarks: usize,
    /// Largest number of solver steps per frame.
    #[key(default = 5, range = 1..=100)]
    pub max_iterations: usize,
    /// A frame becomes a keyframe if less than this share of its points is linked to the window.
    #[key(default = 0.7, range = 0.0..=1.0, cure = "write a share from 0 to 1 (is this in percent?)", experiment)]
    pub min_connected_ratio: f64,
    /// Longest time between keyframes, s.
    #[key(default = 2.0, range = 0.05..=60.0, unit = SECONDS, experiment)]
    pub max_keyframe_interval_s: f64,
    /// Largest fraction of a frame's features that is dropped as moving. Features count as moving if they contradict
    /// the motion predicted by window and IMU. 0 drops none. With one camera none are dropped.
    #[key(default = 0.85, range = 0.0..=0.95, cure = "write a share between 0 and 0.95; 0 takes nothing for moving")]
    pub max_moving_share: f64,
    /// Errors of single stamps are corrected by what frames show. The calibration of a rig leaves them to the time offset.
    #[key(default = true, experiment)]
    pub correct_stamps: bool,
    /// Scale of the Cauchy kernel, in standard deviations.
    #[key(default = 2.0, range = 0.1..=100.0, cure = "write it in standard deviations", experiment)]
    pub cauchy_scale: f64,
    /// Points farther away than this are not triangulated, m.
    #[key(default = 60.0, range = 1.0..=1e4, unit = METRES, experiment)]
    pub max_depth_m: f64,
    /// Points nearer than this are not triangulated, m.
    #[key(default = 0.2, range = 0.01..=100.0, unit = METRES, experiment)]
    pub min_depth_m: f64,
}

/// When an estimate counts as failed.
#[keys]
pub struct HealthConfig {
    /// Speed above which the estimate counts as diverged.
    #[key(default = 20.0, range = 0.5..=300.0, unit = METRES_PER_SECOND, cure = "write it in m/s (is this in km/h?)")]
    pub max_speed_m_s: f64,
    /// Standard deviation of the body's velocity at which the quality is 0. After a start, no pose is published until
    /// the standard deviation is below a tenth of this value.
    #[key(default = 2.0, range = 0.01..=100.0, unit = METRES_PER_SECOND)]
    pub max_velocity_sigma_m_s: f64,
    /// Longest time without landmarks that the IMU bridges alone.
    #[key(default = 5.0, range = 0.05..=60.0, unit = SECONDS)]
    pub max_blind_s: f64,
    /// Gyroscope bias above which the estimate counts as diverged, rad/s.
    #[key(default = 0.5, range = 1e-4..=5.0, unit = RADIANS_PER_SECOND, experiment)]
    pub max_gyro_bias_rad_s: f64,
    /// Accelerometer bias above which the estimate counts as diverged, m/s².
    #[key(default = 2.0, range = 1e-3..=20.0, unit = METRES_PER_SECOND_2, experiment)]
    pub max_accel_bias_m_s2: f64,
    /// Shortest time between automatic resets, s.
    #[key(default = 2.0, range = 0.0..=600.0, unit = SECONDS, experiment)]
    pub reset_holdoff_s: f64,
    /// Treat an image that repeats the previous one as missing. false for cameras without noise, whose images repeat
    /// while the vehicle stands.
    #[key(default = true)]
    pub refuse_repeated_images: bool,
}

/// Line segments and line landmarks.
#[keys]
pub struct LinesConfig {
    /// Extract and use lines.
    #[key(default = true)]
    pub enabled: bool,
    /// Smallest gradient of an edge pixel, grey levels per pixel. Edges are detected at half the resolution, with a
    /// threshold of 0.7 times this value per half-resolution pixel.
    #[key(default = 8.0, range = 0.5..=200.0, cure = "write it in grey levels per pixel")]
    pub min_gradient: f64,
    /// Shortest raw segment, px.
    #[key(default = 22.0, range = 8.0..=500.0, unit = PIXELS, experiment)]
    pub min_raw_length_px: f64,
    /// Apply the adaptive length threshold.
    #[key(default = true, experiment)]
    pub length_filter: bool,
    /// Largest number of edge pixels visited in an image. At this limit, the strongest segments found so far are used.
    #[key(default = 24_000, range = 1000..=100_000_000)]
    pub max_visits: usize,
    /// Largest number of raw segments of an image.
    #[key(default = 1000, range = 8..=10_000, experiment)]
    pub max_raw: usize,
    /// Largest number of segments of an image that are refined and matched. Long segments of high contrast are
    /// preferred.
    #[key(default = 48, range = 8..=500)]
    pub max_segments: usize,
    /// Largest Hamming distance of a match, of 256 bits.
    #[key(default = 60, range = 1..=256, experiment)]
    pub max_hamming: u32,
    /// Largest ratio of the distances of the best and the second best match.
    #[key(default = 0.75, range = 0.1..=1.0, experiment)]
    pub max_hamming_ratio: f64,
    /// Largest number of line landmarks in the window.
    #[key(default = 120, range = 4..=2000, experiment)]
    pub max_landmarks: usize,
    /// Standard deviation of a segment's end points, across the segment. It is larger for real lenses than for
    /// simulated ones.
    #[key(default = 0.3, range = 0.01..=20.0, unit = PIXELS)]
    pub sigma_px: f64,
}

/// Recognition of places and the map that a flight makes.
#[keys]
pub struct PlacesConfig {
    /// Recognize places, and build a map.
    #[key(default = true)]
    pub enabled: bool,
    /// Largest number of keyframes in the map, 27 kB each. Above it, the most redundant keyframe is dropped.
    #[key(default = 1000, range = 16..=20_000)]
    pub max_keyframes: usize,
    /// Largest number of features of a keyframe.
    #[key(default = 400, range = 50..=2000, experiment)]
    pub max_features: usize,
    /// Smallest distance between successive keyframes, m; a rotation of 30 degrees counts as one metre.
    #[key(default = 0.2, range = 0.0..=10.0, unit = METRES, experiment)]
    pub spacing_m: f64,
}
