//! Judgement of what images and gyroscope agree on: time offset, rotation, focal lengths.

use super::{Agreement, MIN_TURNS, REACH_S, STEP_S, Turn, agreement};
use crate::verdict::{Fitness, Measure};
use plumbline_config::{Config, ImuSample};

/// Known to this standard deviation they are judged: s, rad.
const KNOWN: (f64, f64) = (0.002, 0.006);
/// Deviation that is judged, in standard deviations, however large these are.
const SIGNIFICANT: f64 = 5.0;
/// A rotation beyond its limit is minded from this many standard deviations on.
const GROSS: f64 = 3.0;
/// No mounting is off by more, rad.
const MAX_MOUNTING_RAD: f64 = 0.35;
/// Scatter of the rates about the axis of least turning from which a recording turns about all axes, rad/s.
const ALL_AXES_RAD_S: f64 = 0.1;
/// Limits of the time offset, as multiples of its configured `sigma`: doubtful beyond the first, bad beyond the second.
/// The third is the least `sigma`, s.
const OFFSET: (f64, f64, f64) = (1.0, 2.0, 0.002);
/// Limits of the rotation, in the order of [`OFFSET`]; the third in rad.
const ROTATION: (f64, f64, f64) = (1.0, 3.0, 0.006);
/// Limits of the focal lengths' error: doubtful beyond the first, bad beyond the second. Gyroscopes have scales that are up to
/// 3 % off.
const FOCAL: (f64, f64) = (0.03, 0.06);
/// Known to this standard deviation the focal lengths are judged.
const KNOWN_FOCAL: f64 = 0.015;
/// Name of the measure of the focal lengths.
pub(crate) const FOCAL_NAME: &str = "focal length";
/// A time offset is one where images and gyroscope disagree by this factor more without it.
const EXPLAINS: f64 = 1.2;
/// Where this share of the scatter is left by the configured extrinsics, they are not those of the rig.
const UNEXPLAINED: f64 = 0.5;

/// Judges all three.
#[must_use]
pub fn judge(turns: &[Turn], samples: &[ImuSample], config: &Config) -> Vec<Measure> {
    const NAMES: [&str; 3] = ["time offset", "camera-IMU rotation", FOCAL_NAME];
    const CURE: &str =
        "turn the vehicle by hand about all three axes for ten seconds, in front of something with texture";
    let Some(found) = agreement(turns, samples, config) else {
        let seen = turns.len();
        let why = match seen < MIN_TURNS {
            true => {
                format!("images show the rotation between {seen} pairs of frames, and {MIN_TURNS} are needed")
            }
            false => {
                format!("the vehicle hardly turned in the {seen} pairs of frames whose rotation images show")
            }
        };
        return NAMES.map(|name| Measure::missing(name, &why, CURE)).to_vec();
    };
    // Of axes that are another's, or of images that show another motion, nothing is explained.
    let is_beyond = (found.offset_s.0 - config.rig.time_offset_s).abs() > REACH_S + STEP_S;
    if found.residual_rad_s > UNEXPLAINED * found.scatter_rad_s || is_beyond {
        let value = format!(
            "images and gyroscope turn differently: {:.3} of {:.3} rad/s remain",
            found.residual_rad_s, found.scatter_rad_s
        );
        let cure = "look at `camera.pose_b_c` (axes, or its inverse), at the order of the cameras, at units of the gyroscope, at lens \
                    model and focal lengths, and at stamps that are late by more than 0.1 s";
        let figures = [("residual_rad_s", found.residual_rad_s), ("scatter_rad_s", found.scatter_rad_s)];
        return NAMES.map(|name| Measure::new(name, Fitness::NotFit, value.clone(), cure, &figures)).to_vec();
    }
    let (mut offset, rotation, mut focal) = (
        offset(NAMES[0], &found, config, CURE),
        rotation(NAMES[1], &found, config, CURE),
        focal(NAMES[2], &found, CURE),
    );
    // Delay, rotation and focal length are traded against each other: none is advised while another is not known.
    if offset.verdict > Fitness::Good && (focal.verdict != Fitness::Good || found.offset_gain < EXPLAINS) {
        let cure = "look at focal lengths and lens model first, then measure again: lenses that are off look like a delay";
        offset = Measure { verdict: Fitness::Uncertain, cure: cure.to_owned(), ..offset };
    }
    let is_rotation_known = found.rotation_b.1 <= KNOWN.1 && rotation.verdict != Fitness::NotFit;
    if focal.verdict == Fitness::Good && (!is_rotation_known || offset.verdict == Fitness::Uncertain) {
        let cure =
            format!("{CURE}: while time offset or rotation is not known, the focal length is not either");
        focal = Measure { verdict: Fitness::Uncertain, cure, ..focal };
    }
    vec![offset, rotation, focal]
}

fn focal(name: &'static str, found: &Agreement, more: &str) -> Measure {
    let (share, sigma) = found.focal;
    let (size, direction) = (100.0 * share.abs(), if share > 0.0 { "less" } else { "more" });
    let value =
        format!("images turn by {size:.1} % {direction} than the gyroscope, within {:.1}", 100.0 * sigma);
    let figures = [("too_long_percent", 100.0 * share), ("sigma_percent", 100.0 * sigma)];
    let noise = 2.0 * sigma;
    let verdict = Fitness::within(share.abs(), FOCAL.0 + noise, FOCAL.1 + noise);
    let is_known = sigma <= KNOWN_FOCAL || verdict > Fitness::Good && share.abs() > SIGNIFICANT * sigma;
    if !is_known {
        return Measure::new(name, Fitness::Uncertain, value, more, &figures);
    }
    let length = if share > 0.0 { "long" } else { "short" };
    let cure = format!(
        "calibrate the cameras again (`plumbline calibrate rig`): the focal lengths of `camera` are {size:.0} % too {length}, or its lens \
         model is another's; a gyroscope's scale that is so far off does the same"
    );
    Measure::new(name, verdict, value, cure, &figures)
}

fn offset(name: &'static str, found: &Agreement, config: &Config, more: &str) -> Measure {
    let (offset_s, sigma_s) = found.offset_s;
    let off_s = (offset_s - config.rig.time_offset_s).abs();
    let prior_s = config.rig.time_offset_sigma_s.max(OFFSET.2);
    let noise_s = 2.0 * sigma_s;
    let value = format!(
        "{:.1} ms within {:.1}, where `rig.time_offset_s` says {:.1} ms",
        1e3 * offset_s,
        1e3 * sigma_s,
        1e3 * config.rig.time_offset_s
    );
    let figures = [("offset_ms", 1e3 * offset_s), ("sigma_ms", 1e3 * sigma_s), ("off_ms", 1e3 * off_s)];
    let verdict = Fitness::within(off_s, OFFSET.0 * prior_s + noise_s, OFFSET.1 * prior_s + noise_s);
    let is_known = sigma_s <= KNOWN.0 || verdict > Fitness::Good && off_s > SIGNIFICANT * sigma_s;
    if !is_known {
        return Measure::new(name, Fitness::Uncertain, value, more, &figures);
    }
    if verdict > Fitness::Good && is_turned(found, config) {
        let cure = "correct the camera-IMU rotation first: while the vehicle turns about one axis, turned axes look like a delay";
        return Measure::new(name, Fitness::Uncertain, value, cure, &figures);
    }
    let cure = format!("set `rig.time_offset_s = {offset_s:.4}`, or find out which stamp is of the arrival");
    Measure::new(name, verdict, value, cure, &figures)
}

/// Verdict on the rotation by its size alone.
fn size_of_rotation(found: &Agreement, config: &Config) -> Fitness {
    let (phi, sigma) = found.rotation_b;
    let prior = config.rig.camera_imu_rotation_sigma_rad.max(ROTATION.2);
    Fitness::within(phi.norm(), ROTATION.0 * prior + sigma, ROTATION.1 * prior + sigma)
}

/// True if camera and gyroscope turn about different axes by an angle that is not known well.
fn is_turned(found: &Agreement, config: &Config) -> bool {
    let (phi, sigma) = found.rotation_b;
    sigma > KNOWN.1 && phi.norm() > GROSS * sigma && size_of_rotation(found, config) > Fitness::Good
}

fn rotation(name: &'static str, found: &Agreement, config: &Config, more: &str) -> Measure {
    let (phi, sigma) = found.rotation_b;
    let angle = phi.norm();
    let value = format!(
        "off by {:.2} degrees within {:.2} (about the body's axes {:.2} {:.2} {:.2})",
        angle.to_degrees(),
        sigma.to_degrees(),
        phi.x.to_degrees(),
        phi.y.to_degrees(),
        phi.z.to_degrees()
    );
    let figures = [("off_deg", angle.to_degrees()), ("sigma_deg", sigma.to_degrees())];
    let verdict = size_of_rotation(found, config);
    if verdict == Fitness::NotFit && angle > MAX_MOUNTING_RAD && angle > GROSS * sigma {
        let cure = "this is more than any mounting error: look at columns and signs of the gyroscope, and at the axes \
                    of `camera.pose_b_c`";
        return Measure::new(name, verdict, value, cure, &figures);
    }
    // What is off by far more than it is uncertain needs no better measurement.
    let is_known = sigma <= KNOWN.1 || verdict > Fitness::Good && angle > SIGNIFICANT * sigma;
    if !is_known && found.least_scatter_rad_s > ALL_AXES_RAD_S {
        let value = format!("{value}, though the vehicle turned about all axes");
        let cure = "more turning will not help: look at principal points (`camera.centre_px`), focal lengths and lens model, and \
                    calibrate again";
        let verdict = if verdict == Fitness::Good { Fitness::Uncertain } else { Fitness::Mind };
        return Measure::new(name, verdict, value, cure, &figures);
    }
    let focal_px = config.camera.first().map_or(0.0, |camera| camera.focal_px[0]);
    let cure = format!(
        "calibrate camera against IMU again (`plumbline calibrate rig`): `camera.pose_b_c` is turned, or the principal points \
         (`camera.centre_px`) are off by {:.0} px",
        focal_px * angle.tan()
    );
    if !is_known {
        let is_turned = is_turned(found, config);
        let (verdict, cure) =
            if is_turned { (Fitness::Mind, cure.as_str()) } else { (Fitness::Uncertain, more) };
        return Measure::new(name, verdict, value, cure, &figures);
    }
    Measure::new(name, verdict, value, cure, &figures)
}

#[cfg(test)]
mod tests;
