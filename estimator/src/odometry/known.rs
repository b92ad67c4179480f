//! What the front-end is told of the newest state, so that it can look for points where they must be.

use super::Odometer;
use super::Phase;
use super::judgement::Velocity;
use crate::estimate::{Estimate, HealthBits};
use crate::exchange::{Feedback, KnownState};
use crate::points::prediction::KnownPoint;
use crate::window::camera_poses::CameraPose;
use crate::window::landmark::PointLandmark;
use crate::window::state::{BodyPose, Mount, NavState};
use nalgebra::{Vector2, Vector3};
use plumbline_config::Portable;

/// Error of a landmark's direction by which its depth is judged, px: that of a few observations, not independent ones.
const DIRECTION_SIGMA_PX: f64 = 0.3;
/// Least distance between two views of a landmark, across its direction, m: below it nothing is known of the depth.
const LEAST_BASELINE_M: f64 = 0.02;

impl Odometer {
    /// Writes the state of the newest frame, and the landmarks that it sees, if the front-end asked and they can be relied on.
    pub(super) fn write_known(&self, is_asked: bool, estimate: &Estimate, feedback: &mut Feedback) {
        feedback.known_points.clear();
        feedback.known_state = if is_asked { self.known_state(estimate) } else { None };
        if feedback.known_state.is_some() {
            self.write_known_points(&mut feedback.known_points);
        }
    }

    /// The newest state while its velocity is known, and no inertial sensor is distrusted, contradicted or suspect.
    fn known_state(&self, estimate: &Estimate) -> Option<KnownState> {
        let spoilt = [
            HealthBits::IMU_GAP,
            HealthBits::IMU_SATURATED,
            HealthBits::IMU_CONTRADICTED,
            HealthBits::NOT_POSITIVE_DEFINITE,
        ];
        let is_reliable = self.phase == Phase::Running
            && self.velocity == Velocity::Known
            && !self.rotation.is_distrusting()
            && !self.forces.is_contradicted()
            && !spoilt.into_iter().any(|bit| estimate.health.contains(bit));
        let newest = self.window.frames.last().filter(|_| is_reliable)?;
        let variances = estimate.covariance.fixed_view::<3, 3>(NavState::V, NavState::V).diagonal();
        let velocity_sigma_m_s = variances.sum().sqrt();
        let is_known = newest.nav.is_finite() && velocity_sigma_m_s.is_finite();
        is_known.then(|| KnownState { stamp: newest.stamp, nav: self.nav_at_stamp(), velocity_sigma_m_s })
    }

    /// The landmarks that the newest frame sees, in its left camera, in order of their tracks.
    fn write_known_points(&self, points: &mut Vec<KnownPoint>) {
        let Some(newest) = self.window.frames.len().checked_sub(1) else { return };
        let mounts = [0, 1].map(|camera| Mount::of(&self.window.rig, camera));
        let pivot_o = self.window.frames[newest].nav.p_o_b;
        let camera = |frame: usize, camera: usize| {
            CameraPose::of(&BodyPose::of(&self.window.frames[frame].nav), &mounts[camera], &pivot_o)
        };
        let eyes: heapless::Vec<[CameraPose; 2], { crate::window::MAX_FRAMES }> =
            (0..=newest).map(|frame| [camera(frame, 0), camera(frame, 1)]).collect();
        let sigma_rad = DIRECTION_SIGMA_PX / self.focal_px;
        let is_seen = |l: &&PointLandmark| {
            l.is_triangulated && l.observations.last().is_some_and(|o| usize::from(o.frame) == newest)
        };
        for landmark in self.window.points.all().iter().filter(is_seen) {
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
