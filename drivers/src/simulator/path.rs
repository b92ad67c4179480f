//! The built-in flight: it stands for a second, rises, and flies figures of eight while looking around.
//!
//! After a start-up of about five seconds the path repeats itself every two figures (31 s), heading
//! included, so places are seen again from where they were seen before.

use super::trajectory::Trajectory;
use crate::StampedPose;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};

/// Stamp of the first pose: far from zero, so that a confusion of stamp and duration shows.
pub(super) const BEGIN: Timestamp = Timestamp::from_nanos(10_000_000_000);
/// Samples of the path that the spline is drawn through.
pub(super) const SAMPLE_STEP_S: f64 = 0.01;
/// Time on the ground, s.
pub(super) const REST_S: f64 = 1.0;
/// Time of the rise, s.
const RISE_S: f64 = 2.5;
/// Time from hovering to cruising, s.
const RAMP_S: f64 = 3.0;
/// Phase of the figure of eight per second: 1.45 m/s at its centre, 0.65 m/s at its tips.
const PHASE_RATE: f64 = 0.4;
/// Height of the body on the ground and in cruise, m.
const HEIGHT_M: [f64; 2] = [0.15, 1.4];

/// The flight over `duration_s`, for a body whose left camera is mounted by `pose_b_c` (it is that camera
/// which looks along the heading).
pub(super) fn demo(duration_s: f64, pose_b_c: &Isometry3<f64>) -> Option<Trajectory> {
    let count = (duration_s / SAMPLE_STEP_S).ceil() as usize;
    let poses: Vec<_> = (0..=count).map(|i| sample(i, pose_b_c)).collect();
    Trajectory::from_poses(&poses)
}

fn sample(i: usize, pose_b_c: &Isometry3<f64>) -> StampedPose {
    let t = i as f64 * SAMPLE_STEP_S;
    let h = 0.01;
    let acceleration = (position(t + h) - 2.0 * position(t) + position(t - h)) / (h * h);
    let thrust = acceleration + Vector3::new(0.0, 0.0, 9.81);
    let tilt = UnitQuaternion::rotation_between(&Vector3::z(), &thrust).unwrap_or_default();
    let rotation = tilt * level_camera(heading(t)) * pose_b_c.rotation.inverse();
    let pose = Isometry3::from_parts(Translation3::from(position(t)), rotation);
    StampedPose { stamp: BEGIN.plus_seconds(t), pose }
}

/// Attitude of a camera that looks along `heading_rad`, a little downwards.
pub(super) fn level_camera(heading_rad: f64) -> UnitQuaternion<f64> {
    // Camera axes in the world for heading 0: x right, y down, z forward.
    let level = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    let down = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.08);
    let level = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(level));
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad) * down * level
}

/// From 0 to 1 with two derivatives zero at both ends.
pub(super) fn smooth_step(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 + x * (6.0 * x - 15.0))
}

/// Phase along the figure: the integral of a smooth start.
fn phase(t: f64) -> f64 {
    let x = (t - REST_S - 0.8 * RISE_S) / RAMP_S;
    let held = x.clamp(0.0, 1.0);
    let ramp = held.squared().squared() * (2.5 + held * (held - 3.0));
    PHASE_RATE * RAMP_S * (ramp + (x - 1.0).at_least(0.0))
}

fn heading(t: f64) -> f64 {
    let p = phase(t);
    0.5 * p + 1.2 * libm::sin(1.5 * p)
}

fn position(t: f64) -> Vector3<f64> {
    let p = phase(t);
    let rise = smooth_step((t - REST_S) / RISE_S);
    let height = HEIGHT_M[0] + (HEIGHT_M[1] - HEIGHT_M[0]) * rise + 0.35 * libm::sin(0.5 * p);
    let (sin, cos) = libm::sincos(p);
    Vector3::new(2.5 * sin, 2.6 * sin * cos, height)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_rests_then_flies_at_the_promised_speeds() {
        let flight = demo(60.0, &Isometry3::identity()).unwrap();
        let rest = flight.motion_at(0.5);
        assert!(rest.v_w_b.norm() < 1e-4 && rest.a_w_b.norm() < 1e-2 && rest.omega_b.norm() < 1e-4);
        let (mut speed, mut rate, mut force) = (0.0_f64, 0.0_f64, 0.0_f64);
        for i in 0..6000 {
            let motion = flight.motion_at(f64::from(i) * 0.01);
            speed = speed.max(motion.v_w_b.norm());
            rate = rate.max(motion.omega_b.norm());
            force = force.max(motion.a_w_b.norm());
        }
        println!("speed {speed} rate {rate} acceleration {force}");
        assert!((1.2..1.7).contains(&speed) && (0.6..1.4).contains(&rate) && force < 3.0);
    }

    #[test]
    fn it_comes_back_to_where_it_was() {
        let flight = demo(80.0, &Isometry3::identity()).unwrap();
        let period = 4.0 * std::f64::consts::PI / PHASE_RATE;
        let (a, b) = (flight.motion_at(15.0).pose_w_b, flight.motion_at(15.0 + period).pose_w_b);
        assert!((a.translation.vector - b.translation.vector).norm() < 1e-3);
        assert!(a.rotation.angle_to(&b.rotation) < 1e-3);
    }
}
