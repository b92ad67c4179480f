//! Every number of the configuration with the range it must lie in, as a table.
//!
//! The bounds are those beyond which a value is a mistake (a wrong unit, a lost sign, a slipped digit) or
//! would take more memory than a companion computer has; inside them a value may still be a poor choice.

use crate::error::Violation;
use crate::options::{CameraConfig, Config, EstimatorSetup};

/// One row: key, value, smallest and largest that is accepted, and what a value outside often means.
type Row<T> = (&'static str, fn(&T) -> f64, f64, f64, &'static str);

const NOISE: &str =
    "write it per sqrt(Hz) and in radians and metres (1 deg = 0.01745 rad, 1 mg = 0.00981 m/s²)";
const RAD: &str = "write it in radians (1 deg = 0.01745 rad)";
const DEGREES: &str = "write it in degrees, from -180 to 180";
const METRES: &str = "write it in metres (is this in mm?)";
const SECONDS: &str = "write it in seconds (is this in ms?)";
const PX: &str = "write it in pixels";
const COUNT: &str = "choose a count in the range";
const SHARE: &str = "write it as a share (0.5 % = 0.005)";
const CHOOSE: &str = "choose a value in the range";

#[rustfmt::skip]
const SETUP_ROWS: &[Row<EstimatorSetup>] = &[
    ("imu.rate_hz",                 |c| c.imu.rate_hz,                 50.0, 4000.0, "write it in Hz (is this a period?)"),
    ("imu.gyro_noise_density",      |c| c.imu.gyro_noise_density,      1e-7, 0.05,   NOISE),
    ("imu.gyro_bias_walk",          |c| c.imu.gyro_bias_walk,          1e-9, 0.01,   NOISE),
    ("imu.accel_noise_density",     |c| c.imu.accel_noise_density,     1e-6, 1.0,    NOISE),
    ("imu.accel_bias_walk",         |c| c.imu.accel_bias_walk,         1e-8, 0.1,    NOISE),
    ("imu.gyro_error_sigma_rad_s",  |c| c.imu.gyro_error_sigma_rad_s,  0.0,  0.5,    "write it in rad/s (1 deg/s = 0.01745 rad/s)"),
    ("imu.accel_error_sigma_m_s2",  |c| c.imu.accel_error_sigma_m_s2,  0.0,  5.0,    "write it in m/s² (1 mg = 0.00981 m/s²)"),
    ("imu.error_time_s",            |c| c.imu.error_time_s,            0.05, 100.0,  SECONDS),
    ("imu.gyro_scale_sigma",        |c| c.imu.gyro_scale_sigma,        0.0,  0.1,    SHARE),
    ("imu.accel_scale_sigma",       |c| c.imu.accel_scale_sigma,       0.0,  0.1,    SHARE),
    ("imu.gyro_range_rad_s",        |c| c.imu.gyro_range_rad_s,        1.0,  100.0,  "write it in rad/s (1000 deg/s = 17.45 rad/s)"),
    ("imu.accel_range_m_s2",        |c| c.imu.accel_range_m_s2,        15.0, 2000.0, "write it in m/s² (16 g = 156.9 m/s²)"),
    ("imu.stuck_after_s",           |c| c.imu.stuck_after_s,           0.0,  10.0,   "write it in seconds, 0 to switch it off"),
    ("imu.gyro_bias_sigma_rad_s",   |c| c.imu.gyro_bias_sigma_rad_s,   1e-6, 1.0,    "write it in rad/s (1 deg/s = 0.01745 rad/s)"),
    ("imu.accel_bias_sigma_m_s2",   |c| c.imu.accel_bias_sigma_m_s2,   1e-6, 5.0,    "write it in m/s² (1 mg = 0.00981 m/s²)"),
    ("imu.gravity_m_s2",            |c| c.imu.gravity_m_s2,            9.7,  9.9,    "write the positive magnitude on Earth in m/s², about 9.81"),

    ("rig.time_offset_s",                      |c| c.rig.time_offset_s,                      -0.1, 0.1,  SECONDS),
    ("rig.time_offset_sigma_s",                |c| c.rig.time_offset_sigma_s,                0.0,  0.05, SECONDS),
    ("rig.camera_imu_rotation_sigma_rad",      |c| c.rig.camera_imu_rotation_sigma_rad,      0.0,  0.2,  RAD),
    ("rig.camera_imu_translation_sigma_m",     |c| c.rig.camera_imu_translation_sigma_m,     0.0,  0.5,  METRES),
    ("rig.camera_camera_rotation_sigma_rad",   |c| c.rig.camera_camera_rotation_sigma_rad,   0.0,  0.1,  RAD),
    ("rig.camera_camera_translation_sigma_m",  |c| c.rig.camera_camera_translation_sigma_m,  0.0,  0.1,  METRES),
    ("rig.memory_s",                           |c| c.rig.memory_s,                           0.0,  1e6,  SECONDS),

    ("estimator.points.max_points",              |c| c.estimator.points.max_points as f64,               8.0,  2000.0, COUNT),
    ("estimator.points.cell_px",                 |c| c.estimator.points.cell_px as f64,                  8.0,  128.0,  PX),
    ("estimator.points.min_corner_score",        |c| f64::from(c.estimator.points.min_corner_score),     1e-3, 1e5,    CHOOSE),
    ("estimator.points.pyramid_levels",          |c| c.estimator.points.pyramid_levels as f64,           1.0,  8.0,    COUNT),
    ("estimator.points.max_iterations",          |c| c.estimator.points.max_iterations as f64,           1.0,  100.0,  COUNT),
    ("estimator.points.max_forward_backward_px", |c| f64::from(c.estimator.points.max_forward_backward_px), 1e-3, 20.0, PX),
    ("estimator.points.max_epipolar_px",         |c| f64::from(c.estimator.points.max_epipolar_px),      0.01, 50.0,   PX),
    ("estimator.points.border_px",               |c| c.estimator.points.border_px as f64,                0.0,  200.0,  PX),
    ("estimator.points.sigma_px",                |c| c.estimator.points.sigma_px,                        0.01, 20.0,   PX),

    ("estimator.lines.min_gradient",             |c| c.estimator.lines.min_gradient,                     0.5,  200.0,  "write it in grey levels per pixel"),
    ("estimator.lines.min_raw_length_px",        |c| c.estimator.lines.min_raw_length_px,                8.0,  500.0,  PX),
    ("estimator.lines.merge_across_px",          |c| c.estimator.lines.merge_across_px,                  0.0,  50.0,   PX),
    ("estimator.lines.merge_along_px",           |c| c.estimator.lines.merge_along_px,                   0.0,  200.0,  PX),
    ("estimator.lines.merge_angle_deg",          |c| c.estimator.lines.merge_angle_deg,                  0.0,  45.0,   "write it in degrees"),
    ("estimator.lines.max_visits",               |c| c.estimator.lines.max_visits as f64,                1e3,  1e8,    COUNT),
    ("estimator.lines.max_raw",                  |c| c.estimator.lines.max_raw as f64,                   8.0,  10_000.0, COUNT),
    ("estimator.lines.max_segments",             |c| c.estimator.lines.max_segments as f64,              8.0,  500.0,  COUNT),
    ("estimator.lines.max_hamming",              |c| f64::from(c.estimator.lines.max_hamming),           1.0,  256.0,  COUNT),
    ("estimator.lines.max_hamming_ratio",        |c| c.estimator.lines.max_hamming_ratio,                0.1,  1.0,    CHOOSE),
    ("estimator.lines.max_landmarks",            |c| c.estimator.lines.max_landmarks as f64,             4.0,  2000.0, COUNT),
    ("estimator.lines.sigma_px",                 |c| c.estimator.lines.sigma_px,                         0.01, 20.0,   PX),
    ("estimator.lines.structure_sigma_deg",      |c| c.estimator.lines.structure_sigma_deg,              0.01, 10.0,   "write it in degrees"),

    ("estimator.window.keyframes",               |c| c.estimator.window.keyframes as f64,                2.0,  14.0,   COUNT),
    ("estimator.window.recent_frames",           |c| c.estimator.window.recent_frames as f64,            1.0,  13.0,   COUNT),
    ("estimator.window.max_landmarks",           |c| c.estimator.window.max_landmarks as f64,            8.0,  10_000.0, COUNT),
    ("estimator.window.max_iterations",          |c| c.estimator.window.max_iterations as f64,           1.0,  100.0,  COUNT),
    ("estimator.window.min_connected_ratio",     |c| c.estimator.window.min_connected_ratio,             0.0,  1.0,    "write a share from 0 to 1 (is this in percent?)"),
    ("estimator.window.max_keyframe_interval_s", |c| c.estimator.window.max_keyframe_interval_s,         0.05, 60.0,   SECONDS),
    ("estimator.window.max_moving_share",        |c| c.estimator.window.max_moving_share,                0.0,  0.95,   "write a share between 0 and 0.95; 0 takes nothing for moving"),
    ("estimator.window.cauchy_scale",            |c| c.estimator.window.cauchy_scale,                    0.1,  100.0,  "write it in standard deviations"),
    ("estimator.window.max_depth_m",             |c| c.estimator.window.max_depth_m,                     1.0,  1e4,    METRES),
    ("estimator.window.min_depth_m",             |c| c.estimator.window.min_depth_m,                     0.01, 100.0,  METRES),

    ("estimator.initial.stereo_frames",          |c| c.estimator.initial.stereo_frames as f64,           2.0,  15.0,   COUNT),
    ("estimator.initial.mono_window_s",          |c| c.estimator.initial.mono_window_s,                  0.2,  20.0,   SECONDS),
    ("estimator.initial.mono_min_parallax_px",   |c| c.estimator.initial.mono_min_parallax_px,           1.0,  500.0,  PX),

    ("estimator.health.max_speed_m_s",           |c| c.estimator.health.max_speed_m_s,                   0.5,  300.0,  "write it in m/s (is this in km/h?)"),
    ("estimator.health.max_velocity_sigma_m_s",  |c| c.estimator.health.max_velocity_sigma_m_s,          0.01, 100.0,  "write it in m/s"),
    ("estimator.health.max_blind_s",             |c| c.estimator.health.max_blind_s,                     0.05, 60.0,   SECONDS),
    ("estimator.health.max_gyro_bias_rad_s",     |c| c.estimator.health.max_gyro_bias_rad_s,             1e-4, 5.0,    "write it in rad/s (1 deg/s = 0.01745 rad/s)"),
    ("estimator.health.max_accel_bias_m_s2",     |c| c.estimator.health.max_accel_bias_m_s2,             1e-3, 20.0,   "write it in m/s² (1 mg = 0.00981 m/s²)"),
    ("estimator.health.reset_holdoff_s",         |c| c.estimator.health.reset_holdoff_s,                 0.0,  600.0,  SECONDS),

    ("estimator.places.max_keyframes",           |c| c.estimator.places.max_keyframes as f64,            16.0, 20_000.0, COUNT),
    ("estimator.places.max_features",            |c| c.estimator.places.max_features as f64,             50.0, 2000.0, COUNT),
    ("estimator.places.spacing_m",               |c| c.estimator.places.spacing_m,                       0.0,  10.0,   METRES),
];

#[rustfmt::skip]
const CONFIG_ROWS: &[Row<Config>] = &[
    ("driver.image_queue",      |c| c.driver.image_queue as f64, 1.0, 64.0, COUNT),
    ("driver.pair_tolerance_s", |c| c.driver.pair_tolerance_s,   0.0, 0.1,  SECONDS),

    ("driver.imu.delay_s",         |c| c.driver.imu.delay_s,         0.0,  0.1, SECONDS),
    ("driver.imu.trigger_pulse_s", |c| c.driver.imu.trigger_pulse_s, 1e-6, 0.1, SECONDS),

    ("driver.v4l2.buffers",     |c| c.driver.v4l2.buffers as f64, 4.0,  32.0,  COUNT),
    ("driver.v4l2.exposure_us", |c| c.driver.v4l2.exposure_us,    0.0,  1e6,   "write it in microseconds, 0 to leave it to the camera"),
    ("driver.v4l2.gain",        |c| c.driver.v4l2.gain,           -1.0, 1e6,   "write it in the driver's own unit, -1 to leave it to the camera"),
    ("driver.v4l2.row_us",      |c| c.driver.v4l2.row_us,         0.0,  1000.0, "write it in microseconds, 0 where the exposure is not counted in rows"),
    ("driver.v4l2.readout_us",  |c| c.driver.v4l2.readout_us,     0.0,  1e5,   "write it in microseconds"),

    ("ros.domain_id",                |c| f64::from(c.ros.domain_id),         0.0, 232.0,  "give the ROS_DOMAIN_ID of the others"),
    ("ros.rate_hz",                  |c| c.ros.rate_hz,                      0.0, 4000.0, "write it in Hz, 0 for every sample"),
    ("ros.angular_rate_sigma_rad_s", |c| c.ros.angular_rate_sigma_rad_s,     0.0, 10.0,   "write it in rad/s (1 deg/s = 0.01745 rad/s)"),

    ("recorder.max_file_mb",    |c| c.recorder.max_file_mb as f64,   32.0, 65_536.0,     "write it in MB (10^6 bytes)"),
    ("recorder.max_total_mb",   |c| c.recorder.max_total_mb as f64,  32.0, 16_777_216.0, "write it in MB (10^6 bytes)"),
    ("recorder.queue_entries",  |c| c.recorder.queue_entries as f64, 0.0,  65_536.0,     COUNT),
    ("recorder.queue_frames",   |c| c.recorder.queue_frames as f64,  0.0,  256.0,        COUNT),

    ("network.max_memory_mb",   |c| f64::from(c.network.max_memory_mb),  8.0, 4096.0,     "write it in MB (10^6 bytes)"),

    ("runtime.idle_latency_us", |c| c.runtime.idle_latency_us as f64, -1.0, 1e6, "write it in microseconds; 0 keeps processors awake, -1 leaves it to the system"),

    ("vehicle.imu_to_vehicle_deg[0]", |c| mounted(c)[0], -180.0, 180.0, DEGREES),
    ("vehicle.imu_to_vehicle_deg[1]", |c| mounted(c)[1], -180.0, 180.0, DEGREES),
    ("vehicle.imu_to_vehicle_deg[2]", |c| mounted(c)[2], -180.0, 180.0, DEGREES),

    ("autopilot.rate_hz",   |c| c.autopilot.rate_hz,               30.0, 50.0,   "write it in Hz; PX4 asks for 30 to 50"),
    ("autopilot.system_id", |c| f64::from(c.autopilot.system_id),  1.0,  255.0, "write the number of the vehicle, as its autopilot has it"),
];

#[rustfmt::skip]
const CAMERA_ROWS: &[Row<CameraConfig>] = &[
    ("width_px",    |c| c.width_px as f64,  64.0, 4096.0, PX),
    ("height_px",   |c| c.height_px as f64, 64.0, 4096.0, PX),
    ("rate_hz",     |c| c.rate_hz,          1.0,  500.0,  "write it in frames per second (is this a period?)"),
    ("readout_s",   |c| c.readout_s,        0.0,  0.1,    "write it in seconds (is this in ms?); 0 for a global shutter"),
    ("exposure_s",  |c| c.exposure_s,       0.0,  0.2,    "write it in seconds (is this in ms?); 0 where it is unknown"),
    ("focal_px[0]", |c| c.focal_px[0],      10.0, 2e4,    "write it in pixels (is this in mm?)"),
    ("focal_px[1]", |c| c.focal_px[1],      10.0, 2e4,    "write it in pixels (is this in mm?)"),
];

/// Angles of the mounting; zeros where it is unknown.
fn mounted(config: &Config) -> [f64; 3] {
    config.vehicle.imu_to_vehicle_deg.degrees().unwrap_or_default()
}

/// Every number of the whole configuration out of its range, but for those of the estimator's setup.
pub(super) fn check_config(config: &Config, found: &mut Vec<Violation>) {
    found.extend(CONFIG_ROWS.iter().filter_map(|row| violation(row, config, "")));
}

/// Every number of the estimator's setup out of its range.
pub(super) fn check_setup(setup: &EstimatorSetup, found: &mut Vec<Violation>) {
    found.extend(SETUP_ROWS.iter().filter_map(|row| violation(row, setup, "")));
    for (i, camera) in setup.camera.iter().enumerate() {
        let prefix = format!("camera[{i}].");
        found.extend(CAMERA_ROWS.iter().filter_map(|row| violation(row, camera, &prefix)));
    }
}

fn violation<T>((key, get, min, max, hint): &Row<T>, of: &T, prefix: &str) -> Option<Violation> {
    let value = get(of);
    // NaN lies in no range.
    (!(*min..=*max).contains(&value)).then(|| {
        let reason = format!("{value} is outside {min} to {max}");
        Violation::new(format!("{prefix}{key}"), reason, *hint)
    })
}
