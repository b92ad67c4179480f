//! Paths around one place: a hover, a drift too slow to be seen far from everything, a vehicle that is carried from one place of
//! rest to another, a hover with fast yaws, and fast sweeps to the side. The cameras look along the x axis of the world, but while
//! the vehicle is carried, yaws or banks.

use super::path::{BEGIN, REST_S, SAMPLE_STEP_S, level_camera, smooth_step};
use super::trajectory::Trajectory;
use crate::StampedPose;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use plumbline_config::Portable;
use std::f64::consts::TAU;

/// Time of the rise, s.
const RISE_S: f64 = 2.5;
/// Height on the ground and in hover, m.
const HEIGHT_M: [f64; 2] = [0.15, 1.4];
/// Residual motion under a good controller: amplitude, m, and frequency, Hz, of each axis.
const SWAY: [(f64, f64); 3] = [(0.03, 0.21), (0.025, 0.17), (0.015, 0.29)];
/// Sway of the attitude about each axis: amplitude, rad, and frequency, Hz.
const WOBBLE: [(f64, f64); 3] = [(0.008, 0.53), (0.01, 0.37), (0.012, 0.11)];
/// Velocity of the drift, m/s, and how long it takes to set in, s.
const DRIFT_M_S: Vector3<f64> = Vector3::new(0.0, 0.1, 0.0);
const DRIFT_RAMP_S: f64 = 3.0;
/// Times at which the vehicle is picked up and put down again, s after the beginning; displacement, m, and turn, rad.
const CARRIED_S: [f64; 2] = [6.5, 9.5];
const CARRIED_M: Vector3<f64> = Vector3::new(1.2, -0.9, 0.0);
const CARRIED_RAD: f64 = 0.7;
/// Height to which it is lifted on the way, m.
const LIFT_M: f64 = 0.8;

/// Largest rate of a yaw, rad/s (500 degrees/s), its angle, rad (170 degrees), the first one, s after the beginning, and the pause
/// after each, s. They go there and back.
const YAW_RAD_S: f64 = 8.726_646_26;
const YAW_RAD: f64 = 2.967_059_73;
const YAWS_FROM_S: f64 = 4.0;
const YAW_PAUSE_S: f64 = 0.8;
/// Height of the hover with yaws, m; it is in the air from the beginning. Its sway: amplitude, m, and rate, rad/s.
const YAWS_HEIGHT_M: f64 = 1.2;
const YAWS_SWAY: [(f64, f64); 3] = [(0.12, 0.9), (0.1, 0.7), (0.08, 1.1)];
/// Sway of the attitude: amplitude, rad, and rates about the x and the y axis, rad/s.
const YAWS_WOBBLE_RAD: f64 = 0.026;
const YAWS_WOBBLE_RAD_S: [f64; 2] = [1.3, 1.7];
/// Time in which that sway sets in, s.
const YAWS_RAMP_S: f64 = 2.0;
/// Width of a sweep, m, its largest speed, m/s, and the pause after each, s. The first begins when the vehicle has risen.
const SWEEP_M: f64 = 2.0;
const SWEEP_M_S: f64 = 3.0;
const SWEEP_PAUSE_S: f64 = 0.4;
/// Largest rate of [`smooth_step`] over its mean.
const SMOOTH_PEAK: f64 = 1.875;
/// Step of the numeric derivative of positions, s.
const DIFFERENCE_S: f64 = 0.01;

/// Kind of the stationary flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Station {
    Hover,
    Drift,
    Carried,
    Yaws,
    Sweeps,
}

/// Way there and back again and again, from 0 to 1 and to 0, each in `move_s` with a pause of `pause_s` after it.
fn there_and_back(t: f64, move_s: f64, pause_s: f64) -> f64 {
    let (period_s, t) = (move_s + pause_s, t.at_least(0.0));
    let count = (t / period_s).floor();
    let moved = smooth_step((t - count * period_s) / move_s);
    if count % 2.0 == 0.0 { moved } else { 1.0 - moved }
}

/// Position of the body in sweeps.
fn swept(t: f64) -> Vector3<f64> {
    let height = HEIGHT_M[0] + (HEIGHT_M[1] - HEIGHT_M[0]) * smooth_step((t - REST_S) / RISE_S);
    let move_s = SMOOTH_PEAK * SWEEP_M / SWEEP_M_S;
    Vector3::new(0.0, SWEEP_M * there_and_back(t - REST_S - RISE_S, move_s, SWEEP_PAUSE_S), height)
}

impl Station {
    /// The motion over `duration_s`, for a body whose left camera is mounted by `pose_b_c`.
    pub(super) fn flight(self, duration_s: f64, pose_b_c: &Isometry3<f64>) -> Option<Trajectory> {
        let count = (duration_s / SAMPLE_STEP_S).ceil() as usize;
        let sample = |i: usize| {
            let t = i as f64 * SAMPLE_STEP_S;
            let (p, turn) = self.at(t);
            let pose = Isometry3::from_parts(Translation3::from(p), turn * pose_b_c.rotation.inverse());
            StampedPose { stamp: BEGIN.plus_seconds(t), pose }
        };
        Trajectory::from_poses(&(0..=count).map(sample).collect::<Vec<_>>())
    }

    /// Position of the body, and attitude of the camera.
    fn at(self, t: f64) -> (Vector3<f64>, UnitQuaternion<f64>) {
        let risen = smooth_step((t - REST_S) / RISE_S);
        let up = Vector3::z() * (HEIGHT_M[0] + (HEIGHT_M[1] - HEIGHT_M[0]) * risen);
        let swing = |of: [(f64, f64); 3]| {
            Vector3::from_fn(|axis, _| risen * of[axis].0 * libm::sin(TAU * of[axis].1 * t + axis as f64))
        };
        match self {
            Self::Hover => {
                let turn = level_camera(0.0) * UnitQuaternion::from_scaled_axis(swing(WOBBLE));
                (up + swing(SWAY), turn)
            }
            Self::Drift => (up + DRIFT_M_S * drifted_s(t), level_camera(0.0)),
            Self::Carried => {
                let x = (t - CARRIED_S[0]) / (CARRIED_S[1] - CARRIED_S[0]);
                let moved = smooth_step(x);
                let lift = 4.0 * LIFT_M * moved * (1.0 - moved);
                let p = Vector3::z() * (HEIGHT_M[1] + lift) + CARRIED_M * moved;
                (p, level_camera(CARRIED_RAD * moved))
            }
            Self::Yaws => {
                let ramp = (t / YAWS_RAMP_S).clamp(0.0, 1.0).squared();
                let sway = |axis: usize, _| {
                    let (amplitude, rate) = YAWS_SWAY[axis];
                    ramp * amplitude * libm::sin(rate * t)
                };
                let [x, y] = YAWS_WOBBLE_RAD_S.map(|rate| ramp * YAWS_WOBBLE_RAD * libm::sin(rate * t));
                let yaw =
                    YAW_RAD * there_and_back(t - YAWS_FROM_S, SMOOTH_PEAK * YAW_RAD / YAW_RAD_S, YAW_PAUSE_S);
                let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
                let wobble = UnitQuaternion::from_scaled_axis(Vector3::new(x, y, 0.0));
                (Vector3::z() * YAWS_HEIGHT_M + Vector3::from_fn(sway), heading * wobble * level_camera(0.0))
            }
            Self::Sweeps => {
                let (p, h) = (swept(t), DIFFERENCE_S);
                let thrust = (swept(t + h) - 2.0 * p + swept(t - h)) / (h * h) + Vector3::new(0.0, 0.0, 9.81);
                let bank = UnitQuaternion::rotation_between(&Vector3::z(), &thrust).unwrap_or_default();
                (p, bank * level_camera(0.0))
            }
        }
    }
}

/// Time of full drift so far, s: it sets in smoothly once the vehicle has risen.
fn drifted_s(t: f64) -> f64 {
    let since = t - REST_S - RISE_S;
    let x = (since / DRIFT_RAMP_S).clamp(0.0, 1.0);
    // The integral of x³ (10 - 15 x + 6 x²).
    let ramp = x.squared().squared() * (2.5 + x * (x - 3.0));
    DRIFT_RAMP_S * ramp + (since - DRIFT_RAMP_S).at_least(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn speeds(station: Station, from_s: f64, to_s: f64) -> Vec<f64> {
        let flight = station.flight(20.0, &Isometry3::identity()).unwrap();
        let at = |k: usize| flight.motion_at(from_s + k as f64 * 0.05).v_w_b.norm();
        (0..((to_s - from_s) / 0.05) as usize).map(at).collect()
    }

    #[test]
    fn a_hover_stays_within_centimetres_and_is_never_quite_still() {
        let flight = Station::Hover.flight(20.0, &Isometry3::identity()).unwrap();
        let home = Vector3::new(0.0, 0.0, HEIGHT_M[1]);
        for k in 400..1900 {
            let motion = flight.motion_at(f64::from(k) * 0.01);
            assert!((motion.pose_w_b.translation.vector - home).norm() < 0.06);
        }
        let speeds = speeds(Station::Hover, 4.0, 19.0);
        assert!(speeds.iter().all(|v| *v < 0.09) && speeds.iter().sum::<f64>() > 0.03 * speeds.len() as f64);
    }

    #[test]
    fn a_drift_is_slow_and_steady() {
        assert!(speeds(Station::Drift, 8.0, 19.0).iter().all(|v| (v - 0.1).abs() < 1e-3));
        let flight = Station::Drift.flight(20.0, &Isometry3::identity()).unwrap();
        assert!((350..1900).all(|k| flight.motion_at(f64::from(k) * 0.01).a_w_b.norm() < 0.1));
    }

    #[test]
    fn yaws_are_as_fast_as_stated_and_go_there_and_back() {
        let flight = Station::Yaws.flight(22.0, &Isometry3::identity()).unwrap();
        let motions: Vec<_> = (0..2100).map(|k| flight.motion_at(f64::from(k) * 0.01)).collect();
        let rates: Vec<f64> = motions.iter().map(|motion| motion.omega_b.norm()).collect();
        let fastest = rates.iter().copied().fold(0.0, f64::max);
        assert!((fastest / YAW_RAD_S - 1.0).abs() < 0.03, "{fastest}");
        let starts = rates.windows(2).filter(|pair| pair[0] < 4.0 && pair[1] >= 4.0).count();
        assert_eq!(starts, 12, "yaws in 17 s");
        let turned = motions[390].pose_w_b.rotation.angle_to(&motions[480].pose_w_b.rotation);
        assert!((turned - YAW_RAD).abs() < 0.05, "{turned}");
        assert!(
            motions.iter().all(|motion| (motion.pose_w_b.translation.vector.z - YAWS_HEIGHT_M).abs() < 0.1)
        );
    }

    #[test]
    fn sweeps_are_fast_and_banked() {
        let flight = Station::Sweeps.flight(20.0, &Isometry3::identity()).unwrap();
        let motions: Vec<_> = (350..1900).map(|k| flight.motion_at(f64::from(k) * 0.01)).collect();
        let fastest = motions.iter().map(|motion| motion.v_w_b.norm()).fold(0.0, f64::max);
        assert!((fastest / SWEEP_M_S - 1.0).abs() < 0.05, "{fastest}");
        let level = level_camera(0.0);
        let bank = motions.iter().map(|motion| motion.pose_w_b.rotation.angle_to(&level)).fold(0.0, f64::max);
        assert!((0.4..0.8).contains(&bank), "{bank}");
        assert!(
            motions
                .iter()
                .all(|motion| (-0.05..SWEEP_M + 0.05).contains(&motion.pose_w_b.translation.vector.y))
        );
    }

    #[test]
    fn what_is_carried_rests_before_and_after_elsewhere() {
        for (from_s, to_s) in [(0.5, 6.3), (9.7, 19.0)] {
            assert!(speeds(Station::Carried, from_s, to_s).iter().all(|v| *v < 0.01));
        }
        let flight = Station::Carried.flight(20.0, &Isometry3::identity()).unwrap();
        let [before, after] = [3.0, 15.0].map(|t| flight.motion_at(t).pose_w_b);
        assert!((after.translation.vector - before.translation.vector - CARRIED_M).norm() < 0.01);
        assert!((after.rotation.angle_to(&before.rotation) - CARRIED_RAD).abs() < 0.01);
    }
}
