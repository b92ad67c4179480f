//! The window's options in the units of its computations.

use super::OUTLIER_SIGMAS;
use super::lens::Lenses;
use super::state::{RIG_DIM, Rig};
use nalgebra::{SVector, Vector3};
use plumbline_config::{Portable, ValidSetup};

/// A point this close to where it is expected is no outlier however sharp its texture: after a gap in the samples the
/// expectation is off by more than texture tells.
const OUTLIER_PX: f64 = 2.4;

/// Options of the window.
#[derive(Clone, Debug)]
pub struct Options {
    /// Keyframes held.
    pub keyframes: usize,
    /// Newest frames held beside the keyframes.
    pub recent_frames: usize,
    /// Smallest share of tracks linked to the window without a new keyframe.
    pub min_connected_ratio: f64,
    /// Longest time without a new keyframe, s.
    pub max_keyframe_interval_s: f64,
    /// Scale of the Cauchy kernel, in standard deviations.
    pub cauchy_scale: f64,
    /// Range of inverse depth for new landmarks, 1/m.
    pub min_rho: f64,
    /// See `min_rho`.
    pub max_rho: f64,
    /// See [`super::feature::Feature::outlier_sigmas`], for points.
    pub point_outlier_sigmas: f64,
    /// See [`super::feature::Feature::sigma`], for points: as the flight shows it.
    pub point_sigma: f64,
    /// See [`plumbline_config::options::WindowConfig::correct_stamps`].
    pub correct_stamps: bool,
    /// See [`plumbline_config::options::WindowConfig::max_moving_share`].
    pub max_moving_share: f64,
    /// Focal length of the left camera, px.
    pub focal_px: f64,
    /// Reprojection error from which a point of the stated `sigma_px` is an outlier, px.
    pub outlier_px: f64,
    /// Cameras of the rig.
    pub cameras: usize,
    /// A camera has a rolling shutter.
    pub is_rolling: bool,
    /// Jacobians of frames in the prior stay at their first estimates. Else, with one camera or a start with one, landmarks that
    /// are still seen get another host when theirs goes, since they would have to wait for parallax anew.
    pub first_estimates: bool,
    /// Gravity in the odometry frame, m/s².
    pub gravity_o: Vector3<f64>,
    /// Prior standard deviations of the rig.
    pub rig_sigmas: SVector<f64, RIG_DIM>,
    /// 1 for the rig's parameters that are refined, 0 for those held fixed.
    pub rig_mask: SVector<f64, RIG_DIM>,
    /// Refined intrinsics; `None` where all are held fixed.
    pub lenses: Option<Lenses>,
}

impl Options {
    /// The options that a configuration asks for.
    pub fn of(config: &ValidSetup) -> Self {
        let window = &config.estimator.window;
        let rig_sigmas = Rig::sigmas(&config.rig, &config.camera);
        Self {
            keyframes: window.keyframes,
            recent_frames: window.recent_frames,
            min_connected_ratio: window.min_connected_ratio,
            max_keyframe_interval_s: window.max_keyframe_interval_s,
            cauchy_scale: window.cauchy_scale,
            min_rho: 1.0 / window.max_depth_m,
            max_rho: 1.0 / window.min_depth_m,
            point_outlier_sigmas: point_outlier_sigmas(config),
            point_sigma: 1.0,
            correct_stamps: window.correct_stamps,
            max_moving_share: window.max_moving_share,
            focal_px: config.left().focal_px[0],
            outlier_px: point_outlier_sigmas(config) * config.estimator.points.sigma_px,
            cameras: config.camera.len(),
            is_rolling: config.camera.iter().any(|camera| camera.readout_s > 0.0),
            first_estimates: config.camera.len() > 1,
            gravity_o: Vector3::new(0.0, 0.0, -config.imu.gravity_m_s2),
            lenses: Lenses::of(config, &rig_sigmas),
            rig_sigmas,
            rig_mask: rig_sigmas.map(|sigma| if sigma > 0.0 { 1.0 } else { 0.0 }),
        }
    }

    /// Unknowns that never move: intrinsics, unless they are refined.
    pub fn held_unknowns(&self) -> std::ops::Range<usize> {
        if self.lenses.is_some() { 0..0 } else { Rig::INTRINSICS..RIG_DIM }
    }

    /// The estimate begins with depths from the baseline of so many cameras: from one camera's motion alone the scale of the
    /// first estimates is off by percents, and Jacobians must not stay there.
    pub fn begin_with(&mut self, cameras: usize) {
        self.first_estimates = cameras > 1;
    }
}

/// With one camera a false depth is seen by few other observations: there the gate is the texture's.
fn point_outlier_sigmas(config: &ValidSetup) -> f64 {
    match config.camera.len() {
        1 => OUTLIER_SIGMAS,
        _ => OUTLIER_SIGMAS.at_least(OUTLIER_PX / config.estimator.points.sigma_px),
    }
}
