//! Localisation as a whole, in worlds of points whose truth is known.

use super::refine::Gravity;
use super::*;
use crate::geometry::exp_so3;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector2, Vector3, Vector6};
use plumbline_config::Random;
use plumbline_config::Timestamp;

const FEATURES: usize = 200;
/// A pixel, at a focal length of 460 px.
const PIXEL: f64 = 1.0 / 460.0;
/// Standard deviation of an inverse depth, 1/m: a third of a pixel over 0.11 m.
const SIGMA_DEPTH: f64 = 0.35 * PIXEL / 0.11;

/// Points on the walls of a room, each with a descriptor.
struct World {
    points: Vec<(Vector3<f64>, Descriptor)>,
}

impl World {
    fn new(seed: u64, count: usize) -> Self {
        let mut random = Random::new(seed);
        let points = (0..count).map(|_| {
            let mut coordinate = || 6.0 * random.unit() - 3.0;
            let mut p = Vector3::new(coordinate(), coordinate(), 0.4 * coordinate());
            let wall = random.below(2);
            p[wall] = if random.below(2) == 0 { 3.0 } else { -3.0 };
            (p, Descriptor(std::array::from_fn(|_| random.next_bits())))
        });
        Self { points: points.collect() }
    }

    /// Features that a camera sees from `pose_m_c`: noise of a pixel, descriptors with a tenth of the bits
    /// changed, and a share of `clutter` that belongs to no point.
    fn seen(&self, pose_m_c: &Isometry3<f64>, clutter: f64, random: &mut Random) -> Vec<Feature> {
        let mut features = Vec::new();
        for (p, descriptor) in &self.points {
            let q = pose_m_c.inverse() * Point3::from(*p);
            let xy = Vector2::new(q.x / q.z, q.y / q.z);
            if q.z < 0.3 || xy.x.abs() > 0.8 || xy.y.abs() > 0.5 || features.len() == FEATURES {
                continue;
            }
            let mut noisy = |bits: u64| (0..64).fold(bits, |b, i| b ^ (u64::from(random.unit() < 0.1) << i));
            let mut descriptor = Descriptor(descriptor.0.map(&mut noisy));
            if random.unit() < clutter {
                descriptor = Descriptor(std::array::from_fn(|_| random.next_bits()));
            }
            // Both the map's view and the query's have the noise of a corner.
            let sigma = PIXEL / std::f64::consts::SQRT_2;
            let noise = Vector2::new(random.gaussian(), random.gaussian()) * sigma;
            let depth = 1.0 / q.z + SIGMA_DEPTH * random.gaussian();
            features.push(Feature {
                descriptor,
                xy: (xy + noise).cast(),
                sigma_xy: sigma as f32,
                inverse_depth: depth.max(0.0) as f32,
                sigma_inverse_depth: SIGMA_DEPTH as f32,
            });
        }
        features
    }
}

/// A camera that looks forward, x right and y down, held by a body with z up.
fn pose_b_c() -> Isometry3<f64> {
    let rot = nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(
        0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0,
    ));
    Isometry3::from_parts(Vector3::new(0.1, 0.02, 0.0).into(), UnitQuaternion::from_rotation_matrix(&rot))
}

/// A pose in the middle of the room with some yaw, and a little tilt.
fn some_pose(random: &mut Random, yaw: f64) -> Isometry3<f64> {
    let mut small = |scale: f64| scale * (2.0 * random.unit() - 1.0);
    let p = Vector3::new(small(0.8), small(0.8), small(0.4));
    Isometry3::from_parts(
        p.into(),
        exp_so3(&Vector3::new(0.0, 0.0, yaw)) * exp_so3(&Vector3::new(small(0.1), small(0.1), 0.0)),
    )
}

/// A map of a world: views in all directions.
fn map_of(world: &World, keyframes: usize, random: &mut Random) -> PlaceMap {
    let mut map = PlaceMap::new(MapLimits { keyframes, features: FEATURES });
    for k in 0..keyframes {
        let pose = some_pose(random, k as f64 * std::f64::consts::TAU / keyframes as f64);
        let features = world.seen(&(pose * pose_b_c()), 0.0, random);
        let stamp = Timestamp::from_nanos(k as i64 * 1_000_000_000);
        map.add(Keyframe::new(0, stamp, pose, pose_b_c()), &features);
    }
    map
}

/// The options without the errors of keyframes, which are exact here, and those that inliers have in common.
fn options() -> LocatorOptions {
    let max_independent = f64::INFINITY;
    LocatorOptions { map_sigma_m: 0.0, map_sigma_rad: 0.0, max_independent, ..LocatorOptions::default() }
}

fn query<'a>(features: &'a [Feature], truth: &Isometry3<f64>, seed: u64) -> Query<'a> {
    let up_b = truth.rotation.inverse() * Vector3::z();
    Query { features, pose_b_c: pose_b_c(), gravity: Gravity { up_b, sigma_rad: 0.005 }, seed }
}

#[test]
fn views_with_much_clutter_are_found_and_the_covariance_is_honest() {
    let mut random = Random::new(3);
    let world = World::new(1, 900);
    let map = map_of(&world, 16, &mut random);
    let mut locator = Locator::new(&options(), 16, FEATURES);
    let (mut found, mut nees, trials) = (0, 0.0, 200);
    for trial in 0..trials {
        let truth = some_pose(&mut random, std::f64::consts::TAU * trial as f64 / trials as f64);
        let features = world.seen(&(truth * pose_b_c()), 0.4, &mut random);
        let Some(located) = locator.locate(&map, &query(&features, &truth, trial), |_| true) else {
            continue;
        };
        found += 1;
        let moved = located.pose_m_b.translation.vector - truth.translation.vector;
        let turned = (truth.rotation.inverse() * located.pose_m_b.rotation).scaled_axis();
        assert!(moved.norm() < 0.15 && turned.norm() < 0.05, "{} m, {} rad", moved.norm(), turned.norm());
        let error = Vector6::from_iterator(moved.iter().chain(turned.iter()).copied());
        nees += error.dot(&located.covariance.cholesky().unwrap().solve(&error));
    }
    // Six unknowns. The errors that inverse depths have in common, which the covariance allows for, are none here,
    // so it is somewhat too large.
    let mean = nees / f64::from(found);
    println!("{found} of {trials} found, NEES {mean:.2}");
    assert!(found >= 160, "{found} found");
    assert!((2.0..9.0).contains(&mean), "NEES {mean}");
}

#[test]
fn another_world_is_not_found_in_the_map() {
    let mut random = Random::new(4);
    let map = map_of(&World::new(1, 900), 16, &mut random);
    let other = World::new(2, 900);
    let mut locator = Locator::new(&options(), 16, FEATURES);
    for trial in 0..120 {
        let truth = some_pose(&mut random, 0.1 * trial as f64);
        let features = other.seen(&(truth * pose_b_c()), 0.0, &mut random);
        assert!(locator.locate(&map, &query(&features, &truth, trial), |_| true).is_none());
    }
}

#[test]
fn keyframes_that_are_not_allowed_are_not_used() {
    let mut random = Random::new(6);
    let world = World::new(1, 900);
    let map = map_of(&world, 16, &mut random);
    let truth = map.keyframe(3).unwrap().pose_m_b;
    let features = world.seen(&(truth * pose_b_c()), 0.1, &mut random);
    let mut locator = Locator::new(&options(), 16, FEATURES);
    let query = query(&features, &truth, 1);
    assert_eq!(locator.locate(&map, &query, |_| true).unwrap().keyframe_id, 3);
    assert!(locator.locate(&map, &query, |k| k.id > 100).is_none());
}

#[test]
fn a_full_map_forgets_what_is_covered_and_keeps_what_is_not() {
    let limits = MapLimits { keyframes: 10, features: 8 };
    let mut map = PlaceMap::new(limits);
    let at = |x: f64| {
        Keyframe::new(0, Timestamp::from_nanos(0), Isometry3::translation(x, 0.0, 0.0), Isometry3::identity())
    };
    // A line of far places, and then much hovering at one of them.
    for k in 0..9 {
        map.add(at(5.0 * f64::from(k)), &[]);
    }
    for k in 0..200 {
        map.add(at(20.0 + 0.001 * f64::from(k)), &[]);
    }
    assert_eq!(map.len(), 10);
    for k in 0..9 {
        let x = 5.0 * f64::from(k);
        assert!(
            map.keyframes().any(|(_, f)| (f.pose_m_b.translation.x - x).abs() < 0.5),
            "nothing is left at {x} m"
        );
    }
}

#[test]
fn a_covisible_keyframe_is_a_neighbour_and_one_that_looks_away_is_not() {
    let mut random = Random::new(7);
    let world = World::new(1, 900);
    let mut map = PlaceMap::new(MapLimits { keyframes: 4, features: FEATURES });
    for (x, yaw) in [(0.0, 0.0), (0.2, 0.1), (0.0, 3.0)] {
        let pose =
            Isometry3::from_parts(Vector3::new(x, 0.0, 0.0).into(), exp_so3(&Vector3::new(0.0, 0.0, yaw)));
        let features = world.seen(&(pose * pose_b_c()), 0.0, &mut random);
        map.add(Keyframe::new(0, Timestamp::from_nanos(0), pose, pose_b_c()), &features);
    }
    assert_eq!(map.keyframe(0).unwrap().neighbours.as_slice(), &[1]);
    assert_eq!(map.keyframe(1).unwrap().neighbours.as_slice(), &[0]);
    assert!(map.keyframe(2).unwrap().neighbours.is_empty());
    map.remove(1);
    assert!(map.keyframe(0).unwrap().neighbours.is_empty());
}
