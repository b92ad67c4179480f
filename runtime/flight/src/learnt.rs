//! The calibration that a flight has learnt, as a configuration for the next one.

use crate::flight::Flown;
use nalgebra::{SVector, Vector3};
use plumbline_config::options::rows_from_isometry;
use plumbline_config::{ConfigError, Portable, ValidConfig};
use plumbline_estimator::RigEstimate;
use plumbline_estimator::window::state::{INTRINSICS_DIM, RIG_DIM, Rig};
use std::fmt::Write as _;
use std::ops::Range;

/// Shortest flight that is learnt from, s.
const LEAST_S: f64 = 10.0;
/// Something has been learnt where a standard deviation is below this share of the configured one.
const LEARNT_SHARE: f64 = 0.7;

/// Parameters with one standard deviation in the configuration: unknowns, name, and unit with its scale.
const GROUPS: [(Range<usize>, &str, &str, f64); 5] = [
    (Rig::ROT_B_C0..Rig::ROT_B_C0 + 3, "camera-IMU rotation", "mrad", 1e3),
    (Rig::P_B_C0..Rig::P_B_C0 + 3, "camera-IMU translation", "mm", 1e3),
    (Rig::ROT_C0_C1..Rig::ROT_C0_C1 + 3, "camera-camera rotation", "mrad", 1e3),
    (Rig::P_C0_C1..Rig::P_C0_C1 + 3, "camera-camera translation", "mm", 1e3),
    (Rig::TIME_OFFSET..Rig::TIME_OFFSET + 1, "time offset", "ms", 1e3),
];

/// Reason why a flight has taught nothing about the calibration.
#[derive(Debug, thiserror::Error)]
pub enum NothingLearnt {
    /// The flight was short.
    #[error("the flight has {0:.1} s with poses; fly {LEAST_S} s or more")]
    TooShort(f64),
    /// The estimator was reset.
    #[error("the estimator was reset {0} times; fly again without a fault")]
    Reset(u32),
    /// There is no estimate of the rig.
    #[error("the estimator was not running at the end; end the flight while it is tracking")]
    NotRunning,
    /// The motion showed nothing.
    #[error("the motion has shown no parameter better than it was known; turn and move about all axes")]
    NotSeen,
    /// The configuration refuses the values.
    #[error(transparent)]
    Config(#[from] ConfigError),
}

/// Calibration that a flight has learnt.
#[derive(Clone, Debug)]
pub struct Learnt {
    /// Configuration of the flight with the refined calibration and its standard deviations.
    pub config: ValidConfig,
    /// Changes as comment lines.
    pub comment: String,
}

impl Learnt {
    /// Calibration that `flown` has learnt.
    ///
    /// # Errors
    /// When the flight was short or not healthy, or its motion showed nothing.
    pub fn of(flown: &Flown) -> Result<Self, NothingLearnt> {
        let ends = flown.poses.first().zip(flown.poses.last());
        let flown_s = ends.map_or(0.0, |(first, last)| last.stamp.seconds_since(first.stamp));
        if flown_s < LEAST_S {
            return Err(NothingLearnt::TooShort(flown_s));
        }
        match flown.outcome.figures.resets {
            0 => {}
            resets => return Err(NothingLearnt::Reset(resets)),
        }
        let estimate = flown.outcome.rig.as_ref().ok_or(NothingLearnt::NotRunning)?;
        let mut learnt = learnt(&flown.config, estimate)?;
        learnt.comment = format!("# Learnt in {flown_s:.0} s of {}.\n{}", flown.name, learnt.comment);
        Ok(learnt)
    }
}

fn learnt(config: &ValidConfig, estimate: &RigEstimate) -> Result<Learnt, NothingLearnt> {
    let configured = Rig::sigmas(&config.rig, &config.camera);
    let sigmas = SVector::<f64, RIG_DIM>::from_fn(|k, _| estimate.covariance[(k, k)].at_least(0.0).sqrt());
    if (0..RIG_DIM).all(|k| configured[k] == 0.0 || sigmas[k] > LEARNT_SHARE * configured[k]) {
        return Err(NothingLearnt::NotSeen);
    }
    // The rig of the next flight is this one within the repeatability of a calibration, and no less well known.
    let floors = plumbline_estimator::window::rig_repeatability();
    let next = SVector::<f64, RIG_DIM>::from_fn(|k, _| {
        (sigmas[k].squared() + floors[k].squared()).sqrt().at_most(configured[k])
    });
    let most = |range: Range<usize>| range.map(|k| next[k]).fold(0.0, |most: f64, x| most.at_least(x));
    let rig = &estimate.rig;
    let lens = |camera: usize| SVector::<f64, INTRINSICS_DIM>::from(rig.intrinsics[camera]);
    let changed = config.with("learnt", |config| {
        let is_pair = config.camera.len() > 1;
        let (mut focal_sigma, mut centre_sigma_px) = (0.0_f64, 0.0_f64);
        for (k, camera) in config.camera.iter_mut().enumerate().take(2) {
            let (step, at) = (lens(k), Rig::of_lens(k));
            camera.pose_b_c = rows_from_isometry(&rig.pose_b_c(k));
            for axis in 0..2 {
                camera.centre_px[axis] += step[1 + axis] * camera.focal_px[axis];
                centre_sigma_px = centre_sigma_px.at_least(next[at + 1 + axis] * camera.focal_px[axis]);
            }
            camera.focal_px = camera.focal_px.map(|focal_px| focal_px * (1.0 + step[0]));
            focal_sigma = focal_sigma.at_least(next[at]);
        }
        let sigmas = &mut config.rig;
        sigmas.time_offset_s = rig.time_offset_s;
        sigmas.camera_imu_rotation_sigma_rad = most(GROUPS[0].0.clone());
        sigmas.camera_imu_translation_sigma_m = most(GROUPS[1].0.clone());
        sigmas.time_offset_sigma_s = most(GROUPS[4].0.clone());
        // One camera keeps its intrinsics.
        if is_pair {
            sigmas.camera_camera_rotation_sigma_rad = most(GROUPS[2].0.clone());
            sigmas.camera_camera_translation_sigma_m = most(GROUPS[3].0.clone());
            (sigmas.camera_focal_sigma, sigmas.camera_centre_sigma_px) = (focal_sigma, centre_sigma_px);
        }
    })?;
    Ok(Learnt { comment: comment(config, rig, &sigmas), config: changed })
}

/// Changes against the configured calibration, and their standard deviations, of what is not held fixed.
fn comment(config: &ValidConfig, rig: &Rig, sigmas: &SVector<f64, RIG_DIM>) -> String {
    let step = rig.minus(&Rig::of(config.setup()));
    let mut lines = String::new();
    let configured = Rig::sigmas(&config.rig, &config.camera);
    let mut line = |name: &str, unit: &str, scale: &dyn Fn(usize) -> f64, range: Range<usize>| {
        if range.clone().all(|k| configured[k] == 0.0) {
            return;
        }
        let of = |values: &SVector<f64, RIG_DIM>| {
            let words: Vec<_> =
                range.clone().map(|k| format!("{:.3}", values[k] * scale(k - range.start))).collect();
            words.join(" ")
        };
        let _ = writeln!(lines, "# {name}: moved by {} {unit}, one sigma {}", of(&step), of(sigmas));
    };
    for (range, name, unit, scale) in GROUPS {
        line(name, unit, &|_| scale, range);
    }
    for (k, camera) in config.camera.iter().enumerate().take(2) {
        let scale = Vector3::new(1e2, camera.focal_px[0], camera.focal_px[1]);
        let at = Rig::of_lens(k);
        line(
            &format!("focal length and principal point of camera {k}"),
            "% px px",
            &|i| scale[i],
            at..at + INTRINSICS_DIM,
        );
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Config;
    use plumbline_estimator::RigCovariance;

    fn estimate(config: &ValidConfig, share: f64) -> RigEstimate {
        let sigmas = Rig::sigmas(&config.rig, &config.camera);
        let step = SVector::<f64, RIG_DIM>::from_fn(|k, _| sigmas[k] * (0.5 + 0.1 * k as f64));
        let covariance = RigCovariance::from_diagonal(&sigmas.map(|sigma| (share * sigma).powi(2)));
        RigEstimate { rig: Rig::of(config.setup()).plus(&step), covariance }
    }

    #[test]
    fn the_next_flight_begins_with_the_refined_rig() {
        let config = Config::preset("sim").expect("is good");
        let estimate = estimate(&config, 0.1);
        let found = learnt(&config, &estimate).expect("has learnt").config;
        let mut expected = estimate.rig.clone();
        expected.intrinsics = Default::default();
        assert!(Rig::of(found.setup()).minus(&expected).norm() < 1e-9);
        for (k, (before, after)) in config.camera.iter().zip(&found.camera).enumerate() {
            let step = estimate.rig.intrinsics[k];
            assert!((after.focal_px[0] / before.focal_px[0] - 1.0 - step.x).abs() < 1e-12);
            assert!((after.centre_px[1] - before.centre_px[1] - step.z * before.focal_px[1]).abs() < 1e-9);
        }
        let (before, after) = (&config.rig, &found.rig);
        assert!(after.camera_imu_rotation_sigma_rad < 0.2 * before.camera_imu_rotation_sigma_rad);
        assert!(after.camera_focal_sigma < before.camera_focal_sigma);
        assert!(after.camera_centre_sigma_px < before.camera_centre_sigma_px);
    }

    #[test]
    fn one_camera_keeps_its_intrinsics_and_how_well_they_are_known() {
        let pair = Config::preset("sim").expect("is good");
        let config = pair.with("one", |config| config.camera.truncate(1)).expect("is good");
        let found = learnt(&config, &estimate(&config, 0.1)).expect("has learnt");
        assert_eq!(found.config.camera[0].focal_px, config.camera[0].focal_px);
        assert_eq!(found.config.rig.camera_focal_sigma, config.rig.camera_focal_sigma);
        assert_eq!(found.config.rig.camera_centre_sigma_px, config.rig.camera_centre_sigma_px);
        assert!(
            !found.comment.contains("focal") && found.comment.contains("camera-IMU"),
            "{}",
            found.comment
        );
    }

    #[test]
    fn what_was_not_seen_stays_as_configured_or_is_refused() {
        let config = Config::preset("sim").expect("is good");
        assert!(matches!(learnt(&config, &estimate(&config, 0.99)), Err(NothingLearnt::NotSeen)));
        let mut estimate = estimate(&config, 0.99);
        estimate.covariance[(Rig::TIME_OFFSET, Rig::TIME_OFFSET)] *= 1e-4;
        let found = learnt(&config, &estimate).expect("has learnt the time offset").config;
        assert!(found.rig.time_offset_sigma_s < 0.1 * config.rig.time_offset_sigma_s);
        let (before, after) = (&config.rig, &found.rig);
        assert!(
            (after.camera_imu_rotation_sigma_rad / before.camera_imu_rotation_sigma_rad - 1.0).abs() < 0.02
        );
    }
}
