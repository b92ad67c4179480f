//! Validation: which values are refused. Ranges of single numbers stand beside their fields ([`crate::keys`]); here is what
//! concerns several values at a time, and [`extrinsics`], [`network`], [`autopilot`],
//! [`imu_driver`], [`ros`], [`sockets`] and [`v4l2`].

mod autopilot;
mod extrinsics;
mod imu_driver;
mod network;
mod ros;
mod sockets;
mod v4l2;

#[cfg(feature = "yaml")]
pub(crate) use extrinsics::pose_problem;
#[cfg(not(feature = "yaml"))]
use extrinsics::pose_problem;
#[cfg(any(all(test, feature = "toml", feature = "yaml"), feature = "fuzzing"))]
pub(crate) use network::is_endpoint;

use crate::camera::Distortion;
use crate::error::Violation;
use crate::keys::{self, Table as _};
use crate::options::{CameraConfig, Config, EstimatorSetup, Mask};
use nalgebra::Vector2;

/// Frames that the window holds at most, keyframes and recent ones: its matrices are sized for these and
/// one more while a frame is exchanged.
pub const MAX_WINDOW_FRAMES: usize = 15;
/// Least share of an image that a mask must leave.
const MIN_SEEN_SHARE: f64 = 0.05;
/// Angle from the optical axis, rad (85 degrees), beyond which the fold of a lens may lie within the edges of the image: of a
/// fisheye of more than 170 degrees little is lost, and fits end about there.
const WIDE_FOLD_RAD: f64 = 1.48;
/// Side of the smallest pyramid level, px: below it a patch covers the whole image.
const MIN_LEVEL_PX: usize = 16;

impl EstimatorSetup {
    /// Violations by the values, ordered by part; empty when the setup is good.
    pub fn violations(&self) -> Vec<Violation> {
        let mut found = Vec::new();
        if !(1..=2).contains(&self.camera.len()) {
            let reason = format!("there are {} cameras", self.camera.len());
            found.push(Violation::new("camera", reason, "give one `[[camera]]` or two, left and right"));
        }
        keys::check(self, "", &mut found);
        for (i, camera) in self.camera.iter().enumerate() {
            check_camera(camera, &format!("camera[{i}]"), &mut found);
        }
        extrinsics::check_pair(&self.camera, &mut found);
        check_rates(self, &mut found);
        check_orders(self, &mut found);
        check_frames(self, &mut found);
        check_image_fits(self, &mut found);
        found
    }
}

impl Config {
    /// Violations by the values, ordered by part; empty when the configuration is good.
    pub fn violations(&self) -> Vec<Violation> {
        let mut found = self.setup().violations();
        // The first four are those of the setup.
        for (key, value) in Self::keys().iter().zip(self.values()).skip(4) {
            value.check(key, key.name, &mut found);
        }
        check_pairing(self, &mut found);
        let recorder = [self.recorder.max_file_mb as f64, self.recorder.max_total_mb as f64];
        check_order(&mut found, ["recorder.max_file_mb", "recorder.max_total_mb"], recorder, true);
        sockets::check(self, &mut found);
        network::check(&self.network, &mut found);
        autopilot::check(self, &mut found);
        imu_driver::check(self, &mut found);
        ros::check(self, &mut found);
        v4l2::check(self, &mut found);
        found
    }
}

fn check_camera(camera: &CameraConfig, key: &str, found: &mut Vec<Violation>) {
    let size = [camera.width_px as f64, camera.height_px as f64];
    for (i, (centre, size)) in camera.centre_px.iter().zip(size).enumerate() {
        if !(0.0..size).contains(centre) {
            let reason = format!("{centre} is outside the image (0 to {size})");
            let cure = "give [cx, cy] in pixels, of the same resolution as width_px and height_px";
            found.push(Violation::new(format!("{key}.centre_px[{i}]"), reason, cure));
        }
    }
    check_mask(camera, key, found);
    if let Some((reason, cure)) = pose_problem(&camera.pose_b_c) {
        found.push(Violation::new(format!("{key}.pose_b_c"), reason, cure));
    }
    check_distortion(camera, key, found);
}

fn check_mask(camera: &CameraConfig, key: &str, found: &mut Vec<Violation>) {
    let mut refuse =
        |reason: String, cure: &str| found.push(Violation::new(format!("{key}.mask"), reason, cure));
    match &camera.mask {
        None => {}
        Some(Mask::Picture(file)) => refuse(
            format!("the picture {} is not read here", file.display()),
            "load the configuration from a file: its folder is where pictures are looked for",
        ),
        Some(Mask::Pixels(mask)) if mask.size_px() != (camera.width_px, camera.height_px) => {
            let ((a, b), (c, d)) = (mask.size_px(), (camera.width_px, camera.height_px));
            refuse(
                format!("the mask has {a}x{b} px, the images have {c}x{d}"),
                "draw it over an image of this camera, pixel by pixel",
            );
        }
        Some(Mask::Pixels(mask)) if mask.seen_share() < MIN_SEEN_SHARE => refuse(
            format!("the mask leaves {:.1} % of the image", 100.0 * mask.seen_share()),
            "black is what is ignored, white what is looked at; are they exchanged?",
        ),
        Some(Mask::Pixels(_)) => {}
    }
}

fn check_distortion(camera: &CameraConfig, key: &str, found: &mut Vec<Violation>) {
    for (name, value) in camera.distortion.coefficients() {
        let (low, high) = range_of_coefficient(&camera.distortion, name);
        if !(low..=high).contains(&value) {
            let reason = format!("{value} is outside {low} to {high}");
            let model = camera.distortion.model();
            let cure =
                format!("check the model ({model}) and the order of the coefficients, or calibrate again");
            found.push(Violation::new(format!("{key}.distortion.{name}"), reason, cure));
        }
    }
    if found.iter().any(|violation| violation.key.starts_with(key)) {
        return;
    }
    // The middles of the four edges, not the corners: a good fit may miss those, of which `Config::doubts` tells.
    let model = camera.model();
    let (right, bottom) = (camera.width_px as f64 - 1.0, camera.height_px as f64 - 1.0);
    let [cx, cy] = camera.centre_px;
    let edges = [(0.0, cy), (right, cy), (cx, 0.0), (cx, bottom)];
    let fold_rad = camera.distortion.fold_rad();
    let is_wide = fold_rad.is_some_and(|fold_rad| fold_rad > WIDE_FOLD_RAD);
    if !is_wide && edges.iter().any(|(x, y)| !model.has_direction(&Vector2::new(*x, *y))) {
        let at = fold_rad.map_or_else(String::new, |fold_rad| {
            format!(" {:.0} degrees from the optical axis", fold_rad.to_degrees())
        });
        let reason =
            format!("the lens model folds back within the image{at}, so pixels there have no direction");
        let cure = format!(
            "check the model (known: {}) and the signs and order of the coefficients",
            Distortion::MODELS.join(", ")
        );
        found.push(Violation::new(format!("{key}.distortion"), reason, cure));
    }
}

/// Range of a lens coefficient. Those of a rational model nearly cancel each other, so they may be large.
fn range_of_coefficient(lens: &Distortion, name: &str) -> (f64, f64) {
    match (lens, name) {
        (Distortion::Rational { .. }, name) if name.starts_with('k') => (-1e5, 1e5),
        (Distortion::Omni { .. }, "xi") => (-0.99, 100.0),
        (Distortion::DoubleSphere { .. }, "xi") => (-0.99, 1.0),
        (_, "alpha") => (0.0, 1.0),
        (_, "beta") => (0.01, 100.0),
        _ => (-100.0, 100.0),
    }
}

fn check_rates(config: &EstimatorSetup, found: &mut Vec<Violation>) {
    let Some(first) = config.camera.first() else { return };
    if config.imu.rate_hz < 2.0 * first.rate_hz {
        let reason =
            format!("{} Hz is less than twice the {} Hz of the camera", config.imu.rate_hz, first.rate_hz);
        found.push(Violation::new("imu.rate_hz", reason, "use a faster IMU or a slower camera"));
    }
    if let Some(second) = config.camera.get(1).filter(|second| second.rate_hz != first.rate_hz) {
        let reason = format!("{} Hz differs from the {} Hz of camera[0]", second.rate_hz, first.rate_hz);
        found.push(Violation::new("camera[1].rate_hz", reason, "trigger both cameras together"));
    }
}

/// Checks that the pair tolerance distinguishes a frame of both cameras from its neighbours.
fn check_pairing(config: &Config, found: &mut Vec<Violation>) {
    let Some(first) = config.camera.first() else { return };
    if config.driver.pair_tolerance_s * first.rate_hz >= 0.5 {
        let reason = format!("{} s is half a frame interval or more", config.driver.pair_tolerance_s);
        let cure = "choose less than half of 1 / camera[0].rate_hz, else frames pair with their neighbours";
        found.push(Violation::new("driver.pair_tolerance_s", reason, cure));
    }
}

/// Checks that `low` is less than `high`, or equal where the bound is inclusive.
fn check_order(
    found: &mut Vec<Violation>,
    [key, than]: [&str; 2],
    [low, high]: [f64; 2],
    is_inclusive: bool,
) {
    if low > high || low == high && !is_inclusive {
        let reason = format!("{low} is too large for `{than}` = {high}");
        found.push(Violation::new(key, reason, format!("lower it or raise `{than}`")));
    }
}

fn check_orders(EstimatorSetup { imu, estimator, .. }: &EstimatorSetup, found: &mut Vec<Violation>) {
    let (window, health) = (&estimator.window, &estimator.health);
    let keys = ["estimator.window.min_depth_m", "estimator.window.max_depth_m"];
    check_order(found, keys, [window.min_depth_m, window.max_depth_m], false);
    let keys = ["imu.gravity_m_s2", "imu.accel_range_m_s2"];
    check_order(found, keys, [imu.gravity_m_s2, imu.accel_range_m_s2], false);
    let keys = ["imu.gyro_bias_sigma_rad_s", "estimator.health.max_gyro_bias_rad_s"];
    check_order(found, keys, [imu.gyro_bias_sigma_rad_s, health.max_gyro_bias_rad_s], true);
    let keys = ["imu.accel_bias_sigma_m_s2", "estimator.health.max_accel_bias_m_s2"];
    check_order(found, keys, [imu.accel_bias_sigma_m_s2, health.max_accel_bias_m_s2], true);
    let keys = ["estimator.points.max_points", "estimator.window.max_landmarks"];
    check_order(found, keys, [estimator.points.max_points as f64, window.max_landmarks as f64], true);
}

/// Checks that the window's matrices have room for its frames.
fn check_frames(setup: &EstimatorSetup, found: &mut Vec<Violation>) {
    let window = &setup.estimator.window;
    let frames = window.keyframes.saturating_add(window.recent_frames);
    if frames > MAX_WINDOW_FRAMES {
        let reason =
            format!("with recent_frames the window has {frames} frames, more than {MAX_WINDOW_FRAMES}");
        found.push(Violation::new("estimator.window.keyframes", reason, "lower keyframes or recent_frames"));
    }
}

/// Checks that cells, border and pyramid fit the images.
fn check_image_fits(config: &EstimatorSetup, found: &mut Vec<Violation>) {
    let points = &config.estimator.points;
    let Some(side) = config.camera.iter().map(|c| c.width_px.min(c.height_px)).min() else { return };
    let mut refuse = |key: &str, reason: String, cure: &str| {
        found.push(Violation::new(format!("estimator.points.{key}"), reason, cure));
    };
    if points.border_px.saturating_mul(4) > side {
        refuse("border_px", format!("{} px leave too little of {side} px", points.border_px), "lower it");
    }
    if points.cell_px > side {
        refuse("cell_px", format!("{} px are more than the image's {side} px", points.cell_px), "lower it");
    }
    let shift = u32::try_from(points.pyramid_levels.saturating_sub(1)).unwrap_or(u32::MAX);
    if side.checked_shr(shift).unwrap_or(0) < MIN_LEVEL_PX {
        let reason =
            format!("{} levels shrink {side} px to less than {MIN_LEVEL_PX} px", points.pyramid_levels);
        refuse("pyramid_levels", reason, "use fewer levels");
    }
}
