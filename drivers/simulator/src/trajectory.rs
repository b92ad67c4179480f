//! A smooth flight: pose, velocity, acceleration and angular rate of the body at any time.
//!
//! Position is a quintic B-spline in R³; attitude is the normalized value of a quintic B-spline of
//! quaternions in R⁴ (signs made continuous). Both have four continuous derivatives, and
//! `omega_b = 2 vec(q* q') / |q|²` is the exact rate of the normalized quaternion, so inertial samples
//! made from it belong to the poses to machine precision.

use super::spline::Spline;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use plumbline_config::{Portable, Timestamp, median};
use plumbline_drivers::StampedPose;

/// Distance of the knots: passes a drone's motion (up to about 8 Hz) and little of a tracker's noise.
const KNOT_STEP_S: f64 = 0.06;
/// Distance of the knots where every sample counts: passes motion up to about 30 Hz.
const CLOSE_KNOT_STEP_S: f64 = 0.015;
/// At least this many samples for each knot interval.
const SAMPLES_PER_KNOT: f64 = 1.5;
/// Half width of the median that says what the velocity between two samples should have been.
const MEDIAN_HALF_WIDTH: usize = 6;
/// A step of the recorded position this far from the median velocity is a correction of the tracker and
/// not a motion: 2 mm within 5 ms.
const JUMP_M_S: f64 = 0.4;
/// Samples further apart than this are not searched for jumps.
const JUMP_MAX_INTERVAL_S: f64 = 0.02;

/// State of motion at one time. `W` is the world (z up), `B` the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionState {
    /// Pose of the body in the world, metres.
    pub pose_w_b: Isometry3<f64>,
    /// Velocity in the world, m/s.
    pub v_w_b: Vector3<f64>,
    /// Acceleration in the world, m/s².
    pub a_w_b: Vector3<f64>,
    /// Angular rate of the body, in the body frame, rad/s.
    pub omega_b: Vector3<f64>,
}

/// A flight as a function of time.
#[derive(Clone, Debug)]
pub struct Trajectory {
    begin: Timestamp,
    end: Timestamp,
    position: Spline<3>,
    attitude: Spline<4>,
}

impl Trajectory {
    /// The smooth flight near `poses` (body in world, in order of time); `None` for fewer than eight or
    /// when their stamps do not rise.
    ///
    /// Jumps of the recorded position, where the tracker corrected itself, are taken out, so the flight
    /// may end elsewhere than the record does.
    pub fn from_poses(poses: &[StampedPose]) -> Option<Self> {
        let times = times(poses)?;
        Some(Self::fitted(poses, &times, &without_jumps(&times, poses), KNOT_STEP_S))
    }

    /// The flight close to `poses`, which have neither noise nor jumps; `None` as [`Self::from_poses`] has it.
    pub(super) fn through(poses: &[StampedPose]) -> Option<Self> {
        let positions: Vec<[f64; 3]> = poses.iter().map(|p| p.pose.translation.vector.into()).collect();
        Some(Self::fitted(poses, &times(poses)?, &positions, CLOSE_KNOT_STEP_S))
    }

    fn fitted(poses: &[StampedPose], times: &[f64], positions: &[[f64; 3]], step_s: f64) -> Self {
        let end_s = times[times.len() - 1];
        let step_s = step_s.at_least(SAMPLES_PER_KNOT * median_interval(times));
        Self {
            begin: poses[0].stamp,
            end: poses[poses.len() - 1].stamp,
            position: Spline::fit(&zip(times, positions), end_s, step_s),
            attitude: Spline::fit(&zip(times, &continuous_quaternions(poses)), end_s, step_s),
        }
    }

    /// First time of the flight.
    pub fn begin(&self) -> Timestamp {
        self.begin
    }

    /// Last time of the flight.
    pub fn end(&self) -> Timestamp {
        self.end
    }

    /// Motion at `stamp`; before and after the flight, that of its ends.
    pub fn motion(&self, stamp: Timestamp) -> MotionState {
        self.motion_at(stamp.seconds_since(self.begin))
    }

    /// Motion `t_s` seconds after the beginning.
    pub fn motion_at(&self, t_s: f64) -> MotionState {
        let (position, attitude) = (self.position.jet(t_s), self.attitude.jet(t_s));
        let q = Quaternion::from(nalgebra::Vector4::from(attitude.value));
        let rate = Quaternion::from(nalgebra::Vector4::from(attitude.first));
        let translation = Translation3::from(Vector3::from(position.value));
        MotionState {
            pose_w_b: Isometry3::from_parts(translation, UnitQuaternion::new_normalize(q)),
            v_w_b: position.first.into(),
            a_w_b: position.second.into(),
            omega_b: 2.0 * (q.conjugate() * rate).vector() / q.norm_squared(),
        }
    }

    /// Positions of the whole flight, `interval_s` apart.
    pub fn positions(&self, interval_s: f64) -> impl Iterator<Item = Vector3<f64>> + '_ {
        let count = (self.end.seconds_since(self.begin) / interval_s) as usize;
        (0..=count).map(move |i| self.position.jet(i as f64 * interval_s).value.into())
    }
}

/// Times of the poses since the first, s; `None` for fewer than eight or when they do not rise.
fn times(poses: &[StampedPose]) -> Option<Vec<f64>> {
    if poses.len() < 8 || poses.windows(2).any(|pair| pair[0].stamp >= pair[1].stamp) {
        return None;
    }
    Some(poses.iter().map(|p| p.stamp.seconds_since(poses[0].stamp)).collect())
}

fn zip<const D: usize>(times: &[f64], values: &[[f64; D]]) -> Vec<(f64, [f64; D])> {
    times.iter().copied().zip(values.iter().copied()).collect()
}

fn median_interval(times: &[f64]) -> f64 {
    median(times.windows(2).map(|t| t[1] - t[0])).unwrap_or(f64::NAN)
}

/// Quaternions x y z w, each on the side of its predecessor.
fn continuous_quaternions(poses: &[StampedPose]) -> Vec<[f64; 4]> {
    let mut previous = poses[0].pose.rotation.coords;
    poses
        .iter()
        .map(|p| {
            let q = p.pose.rotation.coords;
            previous = if q.dot(&previous) < 0.0 { -q } else { q };
            previous.into()
        })
        .collect()
}

/// Positions summed up again from their steps, with implausible steps replaced by the median of their
/// neighbours.
fn without_jumps(times: &[f64], poses: &[StampedPose]) -> Vec<[f64; 3]> {
    let positions: Vec<Vector3<f64>> = poses.iter().map(|p| p.pose.translation.vector).collect();
    let interval = |i: usize| times[i + 1] - times[i];
    let velocities: Vec<Vector3<f64>> =
        (0..times.len() - 1).map(|i| (positions[i + 1] - positions[i]) / interval(i)).collect();
    let mut at = positions[0];
    let mut out = vec![at.into()];
    for (i, velocity) in velocities.iter().enumerate() {
        let around = i.saturating_sub(MEDIAN_HALF_WIDTH)..(i + MEDIAN_HALF_WIDTH + 1).min(velocities.len());
        let expected = median_vector(&velocities[around]);
        let jump = interval(i) < JUMP_MAX_INTERVAL_S && (velocity - expected).norm() > JUMP_M_S;
        at += if jump { expected } else { *velocity } * interval(i);
        out.push(at.into());
    }
    out
}

/// Median of each component.
fn median_vector(values: &[Vector3<f64>]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| median(values.iter().map(|v| v[axis])).unwrap_or(f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn rates_are_those_of_the_poses() {
        let flight = fixture::wobble(6.0);
        let h = 1e-5;
        for i in 1..200 {
            let t = 0.02 * f64::from(i) + 0.5;
            let (a, m, b) = (flight.motion_at(t - h), flight.motion_at(t), flight.motion_at(t + h));
            let v = (b.pose_w_b.translation.vector - a.pose_w_b.translation.vector) / (2.0 * h);
            let acceleration = (b.v_w_b - a.v_w_b) / (2.0 * h);
            let omega = (a.pose_w_b.rotation.inverse() * b.pose_w_b.rotation).scaled_axis() / (2.0 * h);
            assert!((v - m.v_w_b).norm() < 1e-8);
            assert!((acceleration - m.a_w_b).norm() < 1e-6);
            assert!((omega - m.omega_b).norm() < 1e-6);
        }
    }

    #[test]
    fn flipped_signs_and_jumps_do_not_show() {
        let clean = fixture::wobble_poses(4.0);
        let mut spoiled = clean.clone();
        for (i, pose) in spoiled.iter_mut().enumerate() {
            if i % 3 == 0 {
                pose.pose.rotation = UnitQuaternion::new_unchecked(-pose.pose.rotation.into_inner());
            }
            if i >= 400 {
                pose.pose.translation.vector.x += 0.14;
            }
        }
        let clean = Trajectory::from_poses(&clean).unwrap();
        let spoiled = Trajectory::from_poses(&spoiled).unwrap();
        for i in 0..40 {
            let (a, b) = (clean.motion_at(f64::from(i) * 0.1), spoiled.motion_at(f64::from(i) * 0.1));
            assert!((a.pose_w_b.translation.vector - b.pose_w_b.translation.vector).norm() < 0.002);
            assert!((a.omega_b - b.omega_b).norm() < 1e-9);
        }
    }

    #[test]
    fn what_is_no_flight_is_refused() {
        let poses = fixture::wobble_poses(1.0);
        assert!(Trajectory::from_poses(&poses[..5]).is_none());
        let mut swapped = poses.clone();
        swapped.swap(3, 4);
        assert!(Trajectory::from_poses(&swapped).is_none());
    }

    #[test]
    fn recorded_flights_are_real_flights() {
        let Some(folder) = plumbline_test_support::shared("euroc/trajectories") else { return };
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let poses = plumbline_drivers::tum::read_tum(&path).unwrap();
            let flight = Trajectory::from_poses(&poses).unwrap();
            let (mut speed, mut force, mut rate, mut off) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
            for pose in &poses {
                let motion = flight.motion(pose.stamp);
                speed = speed.max(motion.v_w_b.norm());
                force = force.max(motion.a_w_b.norm());
                rate = rate.max(motion.omega_b.norm());
                off = off.max(motion.pose_w_b.rotation.angle_to(&pose.pose.rotation));
            }
            println!(
                "{}: speed {speed:.2} acceleration {force:.1} rate {rate:.2} attitude {off:.4}",
                path.display()
            );
            assert!(speed < 4.0 && force < 25.0 && rate < 3.0 && off < 0.02, "{}", path.display());
        }
    }
}
