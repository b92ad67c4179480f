//! The built-in paths: figures of eight, a rig in a hand, and flights around one place.
//!
//! Each is a function of the time since the beginning: the position of the body and the attitude of its left camera. The cameras
//! look along the x axis of the world, but where a path says otherwise.

use super::trajectory::Trajectory;
use crate::random::{Draws, Purpose};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp};
use plumbline_drivers::StampedPose;
use std::f64::consts::TAU;

/// Stamp of the first pose: far from zero, so that a confusion of stamp and duration shows.
const BEGIN: Timestamp = Timestamp::from_nanos(10_000_000_000);
/// Samples of the path that the spline is drawn through.
const SAMPLE_STEP_S: f64 = 0.01;
/// Time on the ground, and of the rise, s.
const REST_S: f64 = 1.0;
const RISE_S: f64 = 2.5;
/// Height of the body on the ground and in cruise, m.
const HEIGHT_M: [f64; 2] = [0.15, 1.4];
/// Step of the numeric derivative of positions, s.
const DIFFERENCE_S: f64 = 0.01;
/// Largest rate of [`smooth_step`] over its mean.
const SMOOTH_PEAK: f64 = 1.875;

/// Time from hovering to cruising in figures of eight, s.
const RAMP_S: f64 = 3.0;
/// Phase of the figure of eight per second: 1.45 m/s at its centre, 0.65 m/s at its tips.
const PHASE_RATE: f64 = 0.4;

/// Height of the hand, m.
const HAND_M: f64 = 1.25;
/// Swing of the hand, m, to both sides, of each of its two sines.
const SWING_M: [f64; 2] = [0.14, 0.08];
/// Swing of the attitude, rad, likewise, about camera x (pitch), y (yaw) and z (roll).
const SWING_RAD: [[f64; 2]; 3] = [[0.2, 0.1], [0.35, 0.15], [0.3, 0.12]];
/// Frequencies of the slow and of the fast sine, Hz.
const FREQUENCIES_HZ: [[f64; 2]; 2] = [[0.25, 0.45], [0.5, 0.8]];

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

/// Position of the body, and attitude of the camera.
pub(super) type Place = (Vector3<f64>, UnitQuaternion<f64>);

/// The motion over `duration_s`, for a body whose left camera is mounted by `pose_b_c`; `None` if it is too short.
pub(super) fn flown(
    duration_s: f64,
    pose_b_c: &Isometry3<f64>,
    at: impl Fn(f64) -> Place,
) -> Option<Trajectory> {
    let count = (duration_s / SAMPLE_STEP_S).ceil() as usize;
    let sample = |i: usize| {
        let t = i as f64 * SAMPLE_STEP_S;
        let (p, attitude) = at(t);
        let pose = Isometry3::from_parts(p.into(), attitude * pose_b_c.rotation.inverse());
        StampedPose { stamp: BEGIN.plus_seconds(t), pose }
    };
    Trajectory::from_poses(&(0..=count).map(sample).collect::<Vec<_>>())
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

/// Integral of [`smooth_step`] from 0 to `x`, at most 1.
fn smooth_ramp(x: f64) -> f64 {
    x.squared().squared() * (2.5 + x * (x - 3.0))
}

fn risen(t: f64) -> f64 {
    smooth_step((t - REST_S) / RISE_S)
}

/// Height of a vehicle that takes off.
fn height(t: f64) -> f64 {
    HEIGHT_M[0] + (HEIGHT_M[1] - HEIGHT_M[0]) * risen(t)
}

/// Tilt of a vehicle that follows `position`.
fn tilt(position: impl Fn(f64) -> Vector3<f64>, t: f64) -> UnitQuaternion<f64> {
    let h = DIFFERENCE_S;
    let acceleration = (position(t + h) - 2.0 * position(t) + position(t - h)) / (h * h);
    let thrust = acceleration + Vector3::new(0.0, 0.0, 9.81);
    UnitQuaternion::rotation_between(&Vector3::z(), &thrust).unwrap_or_default()
}

/// Stands for a second, rises, and flies figures of eight while looking around. After a start-up of about five seconds the path
/// repeats itself every two figures (31 s), heading included, so places are seen again from where they were seen before.
pub(super) fn demo(t: f64) -> Place {
    // Phase along the figure: the integral of a smooth start.
    let phase = |t: f64| {
        let x = (t - REST_S - 0.8 * RISE_S) / RAMP_S;
        PHASE_RATE * RAMP_S * (smooth_ramp(x.clamp(0.0, 1.0)) + (x - 1.0).at_least(0.0))
    };
    let position = |t: f64| {
        let p = phase(t);
        let (sin, cos) = libm::sincos(p);
        Vector3::new(2.5 * sin, 2.6 * sin * cos, height(t) + 0.35 * libm::sin(0.5 * p))
    };
    let heading = 0.5 * phase(t) + 1.2 * libm::sin(1.5 * phase(t));
    (position(t), tilt(position, t) * level_camera(heading))
}

/// Two sines.
#[derive(Clone, Copy, Debug)]
struct Swing([(f64, f64, f64); 2]);

impl Swing {
    fn draw(draws: &mut Draws, amplitudes: [f64; 2]) -> Self {
        Self([0, 1].map(|k| {
            let [low, high] = FREQUENCIES_HZ[k];
            (amplitudes[k], draws.range(low, high), draws.range(0.0, TAU))
        }))
    }

    fn at(&self, t_s: f64) -> f64 {
        self.0.iter().map(|(amplitude, hz, phase)| amplitude * libm::sin(TAU * hz * t_s + phase)).sum()
    }
}

/// Rests for a second, is picked up, and is moved and turned about all axes at once, as one does it to calibrate a camera against
/// an IMU. Frequencies and phases are drawn from the seed, so that no two axes move together for long.
pub(super) fn hand_held(seed: u64) -> impl Fn(f64) -> Place {
    let mut draws = Draws::new(seed, Purpose::Hand, 0);
    let position = [(); 3].map(|()| Swing::draw(&mut draws, SWING_M));
    let attitude = SWING_RAD.map(|amplitudes| Swing::draw(&mut draws, amplitudes));
    move |t| {
        let part = risen(t);
        let swung = |swings: &[Swing; 3]| Vector3::from_fn(|axis, _| part * swings[axis].at(t));
        let height = HEIGHT_M[0] + (HAND_M - HEIGHT_M[0]) * part;
        let p = swung(&position) + Vector3::new(0.0, 0.0, height);
        (p, level_camera(0.0) * UnitQuaternion::from_scaled_axis(swung(&attitude)))
    }
}

/// Takes off and hovers.
pub(super) fn hover(t: f64) -> Place {
    let swing = |of: [(f64, f64); 3]| {
        Vector3::from_fn(|axis, _| risen(t) * of[axis].0 * libm::sin(TAU * of[axis].1 * t + axis as f64))
    };
    let turn = level_camera(0.0) * UnitQuaternion::from_scaled_axis(swing(WOBBLE));
    (Vector3::z() * height(t) + swing(SWAY), turn)
}

/// Takes off and drifts, too slowly to be seen far from everything.
pub(super) fn drift(t: f64) -> Place {
    let since = t - REST_S - RISE_S;
    let ramp = smooth_ramp((since / DRIFT_RAMP_S).clamp(0.0, 1.0));
    let drifted_s = DRIFT_RAMP_S * ramp + (since - DRIFT_RAMP_S).at_least(0.0);
    (Vector3::z() * height(t) + DRIFT_M_S * drifted_s, level_camera(0.0))
}

/// Is carried from one place of rest to another.
pub(super) fn carried(t: f64) -> Place {
    let moved = smooth_step((t - CARRIED_S[0]) / (CARRIED_S[1] - CARRIED_S[0]));
    let lift = 4.0 * LIFT_M * moved * (1.0 - moved);
    (Vector3::z() * (HEIGHT_M[1] + lift) + CARRIED_M * moved, level_camera(CARRIED_RAD * moved))
}

/// Hovers with fast yaws.
pub(super) fn yaws(t: f64) -> Place {
    let ramp = (t / YAWS_RAMP_S).clamp(0.0, 1.0).squared();
    let sway = |axis: usize, _| {
        let (amplitude, rate) = YAWS_SWAY[axis];
        ramp * amplitude * libm::sin(rate * t)
    };
    let [x, y] = YAWS_WOBBLE_RAD_S.map(|rate| ramp * YAWS_WOBBLE_RAD * libm::sin(rate * t));
    let yaw = YAW_RAD * there_and_back(t - YAWS_FROM_S, SMOOTH_PEAK * YAW_RAD / YAW_RAD_S, YAW_PAUSE_S);
    let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    let wobble = UnitQuaternion::from_scaled_axis(Vector3::new(x, y, 0.0));
    (Vector3::z() * YAWS_HEIGHT_M + Vector3::from_fn(sway), heading * wobble * level_camera(0.0))
}

/// Takes off and sweeps to the side, fast and banked.
pub(super) fn sweeps(t: f64) -> Place {
    let swept = |t: f64| {
        let move_s = SMOOTH_PEAK * SWEEP_M / SWEEP_M_S;
        Vector3::new(0.0, SWEEP_M * there_and_back(t - REST_S - RISE_S, move_s, SWEEP_PAUSE_S), height(t))
    };
    (swept(t), tilt(swept, t) * level_camera(0.0))
}

/// Way there and back again and again, from 0 to 1 and to 0, each in `move_s` with a pause of `pause_s` after it.
fn there_and_back(t: f64, move_s: f64, pause_s: f64) -> f64 {
    let (period_s, t) = (move_s + pause_s, t.at_least(0.0));
    let count = (t / period_s).floor();
    let moved = smooth_step((t - count * period_s) / move_s);
    if count % 2.0 == 0.0 { moved } else { 1.0 - moved }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Flight of a body that is its camera.
    fn flight(duration_s: f64, at: impl Fn(f64) -> Place) -> Trajectory {
        flown(duration_s, &Isometry3::identity(), at).unwrap()
    }

    #[test]
    fn it_rests_then_flies_at_the_promised_speeds() {
        let flight = flight(60.0, demo);
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
    fn it_rests_and_then_turns_and_moves_about_all_axes_as_a_hand_does() {
        for seed in 1..6 {
            let flight = flight(30.0, hand_held(seed));
            assert!(flight.motion_at(0.5).v_w_b.norm() < 1e-3);
            let motions: Vec<_> = (500..3000).map(|k| flight.motion_at(f64::from(k) * 0.01)).collect();
            let rms = |of: &dyn Fn(usize) -> f64| {
                ((0..motions.len()).map(|k| of(k).powi(2)).sum::<f64>() / motions.len() as f64).sqrt()
            };
            for axis in 0..3 {
                let rate = rms(&|k| motions[k].omega_b[axis]);
                let force = rms(&|k| motions[k].a_w_b[axis]);
                assert!((0.3..2.0).contains(&rate) && (0.5..4.0).contains(&force), "{seed} {rate} {force}");
            }
            assert!(motions.iter().all(|m| m.omega_b.norm() < 5.0 && m.v_w_b.norm() < 2.5));
        }
    }

    fn speeds(at: fn(f64) -> Place, from_s: f64, to_s: f64) -> Vec<f64> {
        let flight = flight(20.0, at);
        let speed = |k: usize| flight.motion_at(from_s + k as f64 * 0.05).v_w_b.norm();
        (0..((to_s - from_s) / 0.05) as usize).map(speed).collect()
    }

    #[test]
    fn a_hover_stays_within_centimetres_and_is_never_quite_still() {
        let flight = flight(20.0, hover);
        let home = Vector3::new(0.0, 0.0, HEIGHT_M[1]);
        for k in 400..1900 {
            let motion = flight.motion_at(f64::from(k) * 0.01);
            assert!((motion.pose_w_b.translation.vector - home).norm() < 0.06);
        }
        let speeds = speeds(hover, 4.0, 19.0);
        assert!(speeds.iter().all(|v| *v < 0.09) && speeds.iter().sum::<f64>() > 0.03 * speeds.len() as f64);
    }

    #[test]
    fn a_drift_is_slow_and_steady() {
        assert!(speeds(drift, 8.0, 19.0).iter().all(|v| (v - 0.1).abs() < 1e-3));
        let flight = flight(20.0, drift);
        assert!((350..1900).all(|k| flight.motion_at(f64::from(k) * 0.01).a_w_b.norm() < 0.1));
    }

    #[test]
    fn yaws_are_as_fast_as_stated_and_go_there_and_back() {
        let flight = flight(22.0, yaws);
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
        let flight = flight(20.0, sweeps);
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
            assert!(speeds(carried, from_s, to_s).iter().all(|v| *v < 0.01));
        }
        let flight = flight(20.0, carried);
        let [before, after] = [3.0, 15.0].map(|t| flight.motion_at(t).pose_w_b);
        assert!((after.translation.vector - before.translation.vector - CARRIED_M).norm() < 0.01);
        assert!((after.rotation.angle_to(&before.rotation) - CARRIED_RAD).abs() < 0.01);
    }
}
