//! The rig in a hand: it rests for a second, is picked up, and is moved and turned about all axes at once, as one does it to
//! calibrate a camera against an IMU.
//!
//! Every coordinate is a sum of two sines whose frequencies and phases are drawn from the seed, so that no two axes move
//! together for long.

use super::path::{BEGIN, REST_S, SAMPLE_STEP_S, level_camera, smooth_step};
use super::trajectory::Trajectory;
use crate::StampedPose;
use crate::random::{Draws, Purpose};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::TAU;

/// Time from the table to the hand's height, and to full swing, s.
const RISE_S: f64 = 2.5;
/// Height of the table and of the hand, m.
const HEIGHT_M: [f64; 2] = [0.15, 1.25];
/// Swing of the position, m, to both sides, of each of the two sines.
const SWING_M: [f64; 2] = [0.14, 0.08];
/// Swing of the attitude, rad, likewise, about camera x (pitch), y (yaw) and z (roll).
const SWING_RAD: [[f64; 2]; 3] = [[0.2, 0.1], [0.35, 0.15], [0.3, 0.12]];
/// Frequencies of the slow and of the fast sine, Hz.
const FREQUENCIES_HZ: [[f64; 2]; 2] = [[0.25, 0.45], [0.5, 0.8]];

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

/// The motion over `duration_s`, for a body whose left camera is mounted by `pose_b_c`.
pub(super) fn hand_held(duration_s: f64, pose_b_c: &Isometry3<f64>, seed: u64) -> Option<Trajectory> {
    let mut draws = Draws::new(seed, Purpose::Hand, 0);
    let position = [(); 3].map(|()| Swing::draw(&mut draws, SWING_M));
    let attitude = SWING_RAD.map(|amplitudes| Swing::draw(&mut draws, amplitudes));
    let count = (duration_s / SAMPLE_STEP_S).ceil() as usize;
    let sample = |i: usize| {
        let t = i as f64 * SAMPLE_STEP_S;
        let part = smooth_step((t - REST_S) / RISE_S);
        let swung = |swings: &[Swing; 3]| Vector3::from_fn(|axis, _| part * swings[axis].at(t));
        let height = HEIGHT_M[0] + (HEIGHT_M[1] - HEIGHT_M[0]) * part;
        let p = swung(&position) + Vector3::new(0.0, 0.0, height);
        let turn_c = UnitQuaternion::from_scaled_axis(swung(&attitude));
        let rotation = level_camera(0.0) * turn_c * pose_b_c.rotation.inverse();
        let pose = Isometry3::from_parts(Translation3::from(p), rotation);
        StampedPose { stamp: BEGIN.plus_seconds(t), pose }
    };
    Trajectory::from_poses(&(0..=count).map(sample).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_rests_and_then_turns_and_moves_about_all_axes_as_a_hand_does() {
        for seed in 1..6 {
            let flight = hand_held(30.0, &Isometry3::identity(), seed).unwrap();
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

    #[test]
    fn another_seed_moves_otherwise() {
        let [a, b] = [1, 2].map(|seed| hand_held(10.0, &Isometry3::identity(), seed).unwrap().motion_at(8.0));
        assert!((a.pose_w_b.translation.vector - b.pose_w_b.translation.vector).norm() > 1e-3);
    }
}
