//! Repeats a path several times: at its end the flight returns smoothly to its beginning.

use super::Trajectory;
use super::path::smooth_step;
use nalgebra::{Isometry3, UnitQuaternion};
use plumbline_config::Portable;
use plumbline_drivers::StampedPose;

/// Samples of the path that the spline is drawn through.
const SAMPLE_STEP_S: f64 = 0.01;
/// In this time the motion at the end of a lap dies away, and that at the beginning of the next sets in, s.
const FADE_S: f64 = 0.6;
/// Shortest way back, s.
const SHORTEST_WAY_S: f64 = 4.0;
/// Speeds on the way back, m/s and rad/s.
const SPEED: (f64, f64) = (0.8, 0.6);

/// `laps` times the part of `flight` from `from_s` on, `lap_s` long; `None` when that is too short to fly.
pub(super) fn laps(flight: &Trajectory, (from_s, lap_s): (f64, f64), laps: u32) -> Option<Trajectory> {
    let (first, last) = (flight.motion_at(from_s).pose_w_b, flight.motion_at(from_s + lap_s).pose_w_b);
    let distance = (last.translation.vector - first.translation.vector).norm();
    let angle = last.rotation.angle_to(&first.rotation);
    let way_s = SHORTEST_WAY_S.at_least(distance / SPEED.0).at_least(angle / SPEED.1) + 2.0 * FADE_S;
    // Whole samples, so that every lap is sampled at the same places.
    let round_s = ((lap_s + way_s) / SAMPLE_STEP_S).ceil() * SAMPLE_STEP_S;
    let way_s = round_s - lap_s;
    let end_s = f64::from(laps) * round_s - way_s;
    let count = (end_s / SAMPLE_STEP_S + 1e-6).floor() as usize;
    let begin = flight.begin().plus_seconds(from_s);
    let sample = |k: usize| {
        let t = k as f64 * SAMPLE_STEP_S;
        let in_round = t % round_s;
        let pose = match in_round <= lap_s {
            true => flight.motion_at(from_s + in_round).pose_w_b,
            false => way_back(flight, (from_s, from_s + lap_s), (in_round - lap_s, way_s)),
        };
        StampedPose { stamp: begin.plus_seconds(t), pose }
    };
    Trajectory::from_poses(&(0..=count).map(sample).collect::<Vec<_>>())
}

/// On the way from the end of a lap to its beginning; `t` seconds after the first and of `way_s`.
fn way_back(flight: &Trajectory, (from_s, to_s): (f64, f64), (t, way_s): (f64, f64)) -> Isometry3<f64> {
    let faded = |t: f64| FADE_S * (1.0 - libm::exp(-t / FADE_S));
    let carried = |at_s: f64, by_s: f64| {
        let motion = flight.motion_at(at_s);
        let p = motion.pose_w_b.translation.vector + motion.v_w_b * by_s;
        let turn = UnitQuaternion::from_scaled_axis(motion.omega_b * by_s);
        Isometry3::from_parts(p.into(), motion.pose_w_b.rotation * turn)
    };
    let (leaving, arriving) = (carried(to_s, faded(t)), carried(from_s, -faded(way_s - t)));
    let share = smooth_step(t / way_s);
    let p = leaving.translation.vector.lerp(&arriving.translation.vector, share);
    let rotation = leaving
        .rotation
        .try_slerp(&arriving.rotation, share, 1e-9)
        // Half a turn: any way round will do.
        .unwrap_or(if share < 0.5 { leaving.rotation } else { arriving.rotation });
    Isometry3::from_parts(p.into(), rotation)
}

#[cfg(test)]
mod tests {
    use super::super::path;
    use super::*;

    #[test]
    fn the_second_lap_is_the_first_again_and_the_way_between_is_smooth() {
        let flight = path::flown(60.0, &Isometry3::identity(), path::demo).unwrap();
        let twice = laps(&flight, (8.0, 20.0), 2).unwrap();
        let whole_s = twice.end().seconds_since(twice.begin());
        let round_s = whole_s - 20.0;
        for t in [1.0, 7.0, 19.0] {
            let (a, b) = (twice.motion_at(t), twice.motion_at(t + round_s));
            assert!((a.pose_w_b.translation.vector - b.pose_w_b.translation.vector).norm() < 1e-3);
            assert!(a.pose_w_b.rotation.angle_to(&b.pose_w_b.rotation) < 1e-3);
        }
        for k in 0..(whole_s * 100.0) as usize {
            let motion = twice.motion_at(k as f64 * 0.01);
            assert!(motion.v_w_b.norm() < 3.0 && motion.omega_b.norm() < 3.0, "{k}: {motion:?}");
            assert!(motion.a_w_b.norm() < 12.0, "{k}: {motion:?}");
        }
    }
}
