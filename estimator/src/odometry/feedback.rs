//! Feedback to the front-end: outliers, calibration, and the newest state, so that it can look for points where they must be.

use super::{Odometer, Phase};
use crate::estimate::Estimate;
use crate::exchange::{Feedback, KeyframeStep, KnownState};
use crate::points::prediction::KnownPoint;
use crate::window::camera_poses::CameraPose;
use crate::window::landmark::PointLandmark;
use crate::window::snapshot::SnapshotKeyframe;
use crate::window::state::{BodyPose, Mount, NavState};
use nalgebra::{Vector2, Vector3};
use plumbline_config::Portable;

/// Error of a landmark's direction by which its depth is judged, px: that of a few observations, not independent ones.
const DIRECTION_SIGMA_PX: f64 = 0.3;
/// Least distance between two views of a landmark, across its direction, m: below it nothing is known of the depth.
const LEAST_BASELINE_M: f64 = 0.02;

impl Odometer {
    /// Writes what the front-end is to know of the newest frame, and of its landmarks if it asked for them (`is_asked`).
    pub(super) fn write_feedback(&mut self, is_asked: bool, estimate: &Estimate, feedback: &mut Feedback) {
        let outliers = self.estimation.window.outliers();
        feedback.wrong_points.clone_from(&outliers.points);
        feedback.wrong_lines.clone_from(&outliers.lines);
        let rig = &self.estimation.window.rig;
        feedback.pose_b_c = [rig.pose_b_c(0), rig.pose_b_c(1)];
        feedback.time_offset_s = rig.time_offset_s;
        feedback.readouts = self.estimation.measurer.readouts;
        feedback.bias_gyro = self.biases().0;
        feedback.turn_rate_b = self.estimation.turn_rate_b();
        feedback.distrusts_imu = self.judge.is_distrusting();
        feedback.untracked_camera = self.judge.untracked_camera(self.frames);
        feedback.reset_counter = self.start.reset_counter;
        self.solved.index = self.frames;
        self.solved.sequence = estimate.frame_sequence;
        self.solved.stamp = estimate.stamp;
        self.solved.pose_o_b = estimate.pose().copied();
        self.solved.is_keyframe = estimate.figures.is_keyframe;
        self.solved.reset_counter = estimate.reset_counter;
        feedback.solved.clone_from(&self.solved);
        self.write_known(is_asked, estimate, feedback);
    }

    /// Writes down the keyframes of the window, their last steps and their lines, before any of them makes room.
    pub(super) fn note_keyframes(&mut self) {
        let window = &mut self.estimation.window;
        let is_keyframe = |k: &usize| window.frames[*k].is_keyframe;
        let mut newest: heapless::Vec<usize, 3> =
            (0..window.frames.len()).rev().filter(is_keyframe).take(3).collect();
        newest.reverse();
        for frame in window.frames.iter().filter(|f| f.is_keyframe) {
            let keyframe = SnapshotKeyframe { stamp: frame.stamp, pose_o_b: frame.pose_at_stamp() };
            let _ = self.solved.keyframes.push(keyframe);
        }
        self.solved.lines.extend(window.snapshot_lines().take(self.solved.lines.capacity()));
        for pair in newest.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            let Some(covariance) = window.relative_covariance(from, to) else { continue };
            let (from, to) = (window.frames[from].stamp, window.frames[to].stamp);
            let _ = self.solved.steps.push(KeyframeStep { from, to, covariance });
        }
    }

    /// Writes the state of the newest frame, if it can be relied on, and the landmarks that it sees, if the front-end asked.
    fn write_known(&self, is_asked: bool, estimate: &Estimate, feedback: &mut Feedback) {
        feedback.known_points.clear();
        feedback.known_state = self.known_state(estimate);
        if is_asked && feedback.known_state.is_some() {
            self.write_known_points(&mut feedback.known_points);
        }
    }

    /// The newest state, if what comes can be predicted by it.
    fn known_state(&self, estimate: &Estimate) -> Option<KnownState> {
        let is_reliable = self.phase == Phase::Running && self.judge.is_predictable(estimate.health);
        let newest = self.estimation.window.frames.last().filter(|_| is_reliable)?;
        let variances = estimate.covariance.fixed_view::<3, 3>(NavState::V, NavState::V).diagonal();
        let velocity_sigma_m_s = variances.sum().sqrt();
        let is_known = newest.nav.is_finite() && velocity_sigma_m_s.is_finite();
        let nav = || self.estimation.nav_at_stamp();
        is_known.then(|| KnownState { stamp: newest.stamp, nav: nav(), velocity_sigma_m_s })
    }

    /// The landmarks that the newest frame sees, in its left camera, in order of their tracks.
    fn write_known_points(&self, points: &mut Vec<KnownPoint>) {
        let Some(newest) = self.estimation.window.frames.len().checked_sub(1) else { return };
        let mounts = [0, 1].map(|camera| Mount::of(&self.estimation.window.rig, camera));
        let pivot_o = self.estimation.window.frames[newest].nav.p_o_b;
        let camera = |frame: usize, camera: usize| {
            CameraPose::of(
                &BodyPose::of(&self.estimation.window.frames[frame].nav),
                &mounts[camera],
                &pivot_o,
            )
        };
        let eyes: heapless::Vec<[CameraPose; 2], { crate::window::MAX_FRAMES }> =
            (0..=newest).map(|frame| [camera(frame, 0), camera(frame, 1)]).collect();
        let sigma_rad = DIRECTION_SIGMA_PX / self.options.focal_px;
        let is_seen = |l: &&PointLandmark| {
            l.is_triangulated && l.observations.last().is_some_and(|o| usize::from(o.frame) == newest)
        };
        for landmark in self.estimation.window.points.all().iter().filter(is_seen) {
            let (Some(host), Some(now)) = (eyes.get(usize::from(landmark.host)), eyes.get(newest)) else {
                continue;
            };
            let (host, now) = (&host[usize::from(landmark.host_camera)], &now[0]);
            let feature = &landmark.feature;
            let q_o = host.rot_o_c * Vector3::new(feature.xy.x, feature.xy.y, 1.0)
                + (host.p_o_c - now.p_o_c) * feature.rho;
            let q_c = now.rot_o_c.tr_mul(&q_o);
            let baseline_m = |o: &crate::window::landmark::Observation<_>| {
                let arm = eyes
                    .get(usize::from(o.frame))
                    .map_or_else(Vector3::zeros, |eye| eye[usize::from(o.camera)].p_o_c - host.p_o_c);
                arm.cross(&q_o).norm() / q_o.norm()
            };
            let longest_m =
                landmark.observations.iter().map(baseline_m).fold(0.0, |most, m: f64| m.at_least(most));
            if q_c.z > 1e-3 && longest_m > LEAST_BASELINE_M && points.len() < points.capacity() {
                let xy = Vector2::new(q_c.x, q_c.y) / q_c.z;
                let known = KnownPoint {
                    track_id: landmark.track_id,
                    xy,
                    rho: feature.rho / q_c.z,
                    rho_sigma: sigma_rad / longest_m,
                };
                points.push(known);
            }
        }
        points.sort_unstable_by_key(|point| point.track_id);
    }
}
