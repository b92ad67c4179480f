//! People who walk through the view, among points that stand still.

use super::Odometer;
use super::synthetic::{World, config, stamp};
use crate::estimate::HealthBits;
use crate::exchange::{Feedback, Tracked};
use crate::window::state::FrameTime;
use nalgebra::{Point3, Vector3};

/// Points on people who cross the view of the left camera, and how fast, m/s.
const PEOPLE: usize = 30;
const WALK_M_S: f64 = 1.2;
const COLUMNS: usize = 6;
const FRAMES: u32 = 120;

/// Six seconds in which people walk by from the first second on.
struct Walk {
    max_moving_share: f64,
    /// Number of points in the room, and on people.
    standing: usize,
    moving: usize,
    /// The most points that are tracked.
    max_points: usize,
    /// From here on they hide all else for a quarter of a second, s.
    hidden_s: f64,
}

/// Outcome of the test flight.
struct Outcome {
    /// Largest error of the velocity in the body, m/s.
    worst_m_s: f64,
    /// Frames in which images and gyroscope contradicted each other.
    contradicted: usize,
}

impl Walk {
    fn among_people(max_moving_share: f64) -> Self {
        Self { max_moving_share, standing: 500, moving: PEOPLE, max_points: 150, hidden_s: f64::INFINITY }
    }

    fn fly(&self) -> Outcome {
        let mut setup = config(2).into_inner();
        setup.estimator.window.max_moving_share = self.max_moving_share;
        setup.estimator.points.max_points = self.max_points;
        let mut world = World::new(&setup.validate().unwrap(), 3, self.standing);
        let standing = world.points_o.clone();
        let mut odometer = Odometer::new(&world.config);
        let (mut tracked, mut feedback) = (Tracked::new(&world.config), Feedback::new(&world.config));
        let mut outcome = Outcome { worst_m_s: 0.0, contradicted: 0 };
        for k in 0..FRAMES {
            let t = 0.2 + f64::from(k) * 0.05;
            tracked.samples.extend(world.samples_to(t));
            self.place(&standing, t, &mut world);
            tracked.points = world.observe(t, [true; 2]);
            tracked.sequence = u64::from(k);
            tracked.time = FrameTime { stamp: stamp(t), time_offset_s: 0.0 };
            let estimate = odometer.process(&tracked, &mut (), &mut feedback);
            tracked.samples.clear();
            if !estimate.has_pose() || t < 1.0 {
                continue;
            }
            let doubts = [HealthBits::IMU_CONTRADICTED, HealthBits::ROTATION_DISPUTED];
            outcome.contradicted += usize::from(doubts.iter().any(|&doubt| estimate.health.contains(doubt)));
            let error = (world.v_b(t) - estimate.pose_o_b.rotation.inverse() * estimate.v_o_b).norm();
            outcome.worst_m_s = outcome.worst_m_s.max(error);
        }
        outcome
    }

    /// Places what stands still, and the people in front of it.
    fn place(&self, standing: &[Vector3<f64>], t: f64, world: &mut World) {
        let pose_o_b = world.pose_o_b(t);
        world.points_o.clear();
        world.points_o.extend_from_slice(standing);
        if (self.hidden_s..self.hidden_s + 0.25).contains(&t) {
            world.points_o.fill((pose_o_b * Point3::new(-100.0, 0.0, 0.0)).coords);
        }
        if t <= 1.0 {
            return;
        }
        let rows = (self.moving / COLUMNS) as f64;
        world.points_o.extend((0..self.moving).map(|i| {
            let (column, row) = ((i % COLUMNS) as f64, (i / COLUMNS) as f64);
            let across = (0.3 * column + WALK_M_S * t).rem_euclid(1.8) - 0.9;
            (pose_o_b * Point3::new(1.5, across, row / rows - 0.4)).coords
        }));
    }
}

#[test]
fn people_who_walk_by_do_not_take_the_estimate_along() {
    // Where nothing is dropped the judgement of the forces alone bounds the error.
    let [kept, dropped] = [0.0, 0.85].map(|share| Walk::among_people(share).fly().worst_m_s);
    assert!(
        dropped < 0.03 && dropped < 0.7 * kept,
        "{dropped:.3} m/s, and {kept:.3} where nothing is dropped"
    );
}

#[test]
fn people_who_hide_all_else_for_a_moment_do_not_either() {
    let [kept, dropped] =
        [0.0, 0.85].map(|share| Walk { hidden_s: 3.0, ..Walk::among_people(share) }.fly().worst_m_s);
    // Meanwhile the samples alone tell the velocity.
    assert!(
        dropped < 0.04 && dropped < 0.5 * kept,
        "{dropped:.3} m/s, and {kept:.3} where nothing is dropped"
    );
}

#[test]
fn a_crowd_is_no_evidence_against_the_gyroscope() {
    let crowd = Walk { standing: 150, moving: 180, max_points: 400, ..Walk::among_people(0.85) };
    // Taken for evidence, it contradicts the gyroscope in all but the first frames.
    let Outcome { contradicted, .. } = crowd.fly();
    assert!(contradicted < 10, "{contradicted} of {FRAMES} frames");
}
