//! People who walk through the view, among points that stand still.

use super::Odometer;
use super::synthetic::{World, config, stamp};
use crate::exchange::{Feedback, Tracked};
use crate::window::state::FrameTime;
use nalgebra::{Point3, Vector3};

/// Points that cross the view of the left camera, and how fast, m/s.
const MOVING: usize = 30;
const WALK_M_S: f64 = 1.2;
const FRAMES: u32 = 120;

/// Largest error of the velocity in the body, m/s, over six seconds in which people walk by from the second on. From `hidden_s` on they
/// hide all else for a quarter of a second.
fn worst_velocity_m_s(max_moving_share: f64, hidden_s: f64) -> f64 {
    let mut setup = config(2).into_inner();
    setup.estimator.window.max_moving_share = max_moving_share;
    let mut world = World::new(&setup.validate().unwrap(), 3, 500);
    let standing = world.points_o.clone();
    let mut odometer = Odometer::new(&world.config);
    let (mut tracked, mut feedback) = (Tracked::new(&world.config), Feedback::new(&world.config));
    let (mut worst_m_s, mut next_imu) = (0.0_f64, 0u32);
    for k in 0..FRAMES {
        let t = 0.2 + f64::from(k) * 0.05;
        while f64::from(next_imu) * 0.005 <= t + 0.0051 {
            tracked.samples.push(world.imu(f64::from(next_imu) * 0.005, true));
            next_imu += 1;
        }
        world.points_o.clone_from(&standing);
        if (hidden_s..hidden_s + 0.25).contains(&t) {
            let behind = world.pose_o_b(t) * Point3::new(-100.0, 0.0, 0.0);
            world.points_o.fill(behind.coords);
        }
        if t > 1.0 {
            let pose_o_b = world.pose_o_b(t);
            world.points_o.extend((0..MOVING).map(|i| {
                let (column, row) = ((i % 6) as f64, (i / 6) as f64);
                let across = (0.3 * column + WALK_M_S * t).rem_euclid(1.8) - 0.9;
                (pose_o_b * Point3::new(1.5, across, 0.2 * row - 0.4)).coords
            }));
        }
        tracked.points = world.observe(t, [true; 2]);
        tracked.sequence = u64::from(k);
        tracked.time = FrameTime { stamp: stamp(t), time_offset_s: 0.0 };
        let estimate = odometer.process(&tracked, &mut (), &mut feedback);
        tracked.samples.clear();
        if !estimate.has_pose() || t < 1.0 {
            continue;
        }
        let way = world.pose_o_b(t + 1e-3).translation.vector - world.pose_o_b(t - 1e-3).translation.vector;
        let v_b: Vector3<f64> = world.pose_o_b(t).rotation.inverse() * (way / 2e-3);
        worst_m_s = worst_m_s.max((v_b - estimate.pose_o_b.rotation.inverse() * estimate.v_o_b).norm());
    }
    worst_m_s
}

#[test]
fn people_who_walk_by_do_not_take_the_estimate_along() {
    let [kept, dropped] = [0.0, 0.85].map(|share| worst_velocity_m_s(share, f64::INFINITY));
    assert!(
        dropped < 0.1 && dropped < 0.3 * kept,
        "{dropped:.3} m/s, and {kept:.3} where nothing is dropped"
    );
}

#[test]
fn people_who_hide_all_else_for_a_moment_do_not_either() {
    let [kept, dropped] = [0.0, 0.85].map(|share| worst_velocity_m_s(share, 3.0));
    // Meanwhile the samples alone tell the velocity.
    assert!(
        dropped < 0.15 && dropped < 0.3 * kept,
        "{dropped:.3} m/s, and {kept:.3} where nothing is dropped"
    );
}
