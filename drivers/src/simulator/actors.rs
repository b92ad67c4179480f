//! Things that move: people who cross the view, and parts of the vehicle in it.

use super::builder::Builder;
use super::pattern::Material;
use super::scenario::{People, Scenario};
use super::shot::MAX_MOVERS;
use super::solid::Solid;
use super::trajectory::Trajectory;
use super::world::{Finish, Surface, World};
use crate::random::{Draws, Purpose};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use plumbline_config::options::{CameraConfig, PixelMask};
use plumbline_config::{Portable, Timestamp};
use std::f64::consts::TAU;

/// Distance of people from the left camera, m.
const PEOPLE_M: f64 = 1.2;
/// Share of the view's width that a person fills, about.
const PERSON_SHARE: f64 = 0.3;
/// Height and depth of a person, m.
const PERSON_SIZE_M: [f64; 2] = [1.75, 0.3];
/// Light on what moves, grey levels of a white surface.
const BRIGHTNESS: f32 = 165.0;
/// Feet of the legs and hubs of the rotors in the left camera (x right, y down, z forward), m; those of the other side are mirrored.
const LEG_M: [f64; 3] = [0.28, 0.22, 0.35];
const HUB_M: [f64; 3] = [0.26, -0.17, 0.36];
/// Sizes of a leg and of a blade, m.
const LEG_SIZE_M: [f64; 3] = [0.02, 0.25, 0.02];
const BLADE_SIZE_M: [f64; 3] = [0.24, 0.006, 0.03];
/// Revolutions of the two rotors, 1/s.
const ROTORS_HZ: [f64; 2] = [95.0, 97.3];

/// Distance of the points by which parts are masked, m, and pixels around each that are masked.
const PART_STEP_M: f64 = 0.002;
const MARGIN_PX: f64 = 4.0;

/// What moves in a flight.
#[derive(Clone, Debug)]
pub(super) struct Actors {
    people: Vec<Person>,
    /// Pose of the left camera in the body, where parts of the vehicle are in view.
    parts: Option<Isometry3<f64>>,
}

/// A person who walks across the view again and again.
#[derive(Clone, Copy, Debug)]
struct Person {
    /// Takes coordinates of the left camera to the body.
    pose_b_c: Isometry3<f64>,
    /// Time of a crossing, and how much of the first one has passed when the flight begins, s.
    crossing_s: f64,
    phase_s: f64,
    /// Way of a crossing, m, to the right.
    way_m: f64,
}

impl Actors {
    /// Puts what moves by `scenario` into the world.
    pub(super) fn enter(scenario: &Scenario, camera: &CameraConfig, world: &mut World) -> Self {
        let people =
            scenario.people.map_or_else(Vec::new, |people| walkers(&people, camera, scenario.seed, world));
        let parts = scenario.vehicle_parts.then(|| camera.pose_b_c());
        if parts.is_some() {
            let dark = Finish::of(Material::Paint).toned(0.0, 0.12);
            for size in [LEG_SIZE_M, LEG_SIZE_M, BLADE_SIZE_M, BLADE_SIZE_M] {
                world.add_mover(faces(size, dark, 0), BRIGHTNESS);
            }
        }
        Self { people, parts }
    }

    /// Poses in the world at `time`, in the order in which they entered.
    pub(super) fn poses(&self, flight: &Trajectory, time: Timestamp) -> [Isometry3<f64>; MAX_MOVERS] {
        let mut poses = [Isometry3::identity(); MAX_MOVERS];
        for (pose, person) in poses.iter_mut().zip(&self.people) {
            *pose = person.pose(flight, time);
        }
        if let Some(pose_b_c) = &self.parts {
            let pose_w_c = flight.motion(time).pose_w_b * pose_b_c;
            let seconds = time.seconds_since(flight.begin());
            for (pose, part) in poses[self.people.len()..].iter_mut().zip(vehicle_parts(seconds)) {
                *pose = pose_w_c * part;
            }
        }
        poses
    }
}

/// Legs and blades in the left camera, `seconds` into the flight.
fn vehicle_parts(seconds: f64) -> [Isometry3<f64>; 4] {
    let at = |[x, y, z]: [f64; 3], side: f64| Translation3::new(side * x, y, z);
    let leg = |side| Isometry3::from_parts(at(LEG_M, side), UnitQuaternion::identity());
    let blade = |side: f64, hz: f64| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), side * TAU * (hz * seconds).fract());
        Isometry3::from_parts(at(HUB_M, side), turn)
    };
    [leg(-1.0), leg(1.0), blade(-1.0, ROTORS_HZ[0]), blade(1.0, ROTORS_HZ[1])]
}

/// Masks of what legs and rotors cover in the images of `cameras`, at any angle of the rotors, with a margin.
pub(super) fn vehicle_masks(cameras: &[CameraConfig]) -> Vec<PixelMask> {
    let Some(left) = cameras.first() else { return Vec::new() };
    let points_c0 = points_of_parts();
    let mask = |camera: &CameraConfig| {
        let (width, height) = (camera.width_px, camera.height_px);
        let (model, pose_c_c0) = (camera.model(), camera.pose_b_c().inverse() * left.pose_b_c());
        let mut is_covered = vec![false; width * height];
        for px in points_c0.iter().filter_map(|p| model.project(&(pose_c_c0 * p).coords)) {
            let around = |x: f64, size: usize| {
                // A cast saturates: what is beyond an edge has no pixels.
                let first = (x - MARGIN_PX).at_least(0.0).ceil() as usize;
                first..((x + MARGIN_PX + 1.0) as usize).min(size)
            };
            for v in around(px.y, height) {
                let columns = around(px.x, width);
                if columns.start < columns.end {
                    is_covered[v * width..][columns].fill(true);
                }
            }
        }
        PixelMask::of(width, height, |u, v| !is_covered[v * width + u])
    };
    cameras.iter().map(mask).collect()
}

/// Points of both legs and of the discs that the rotors sweep, in the left camera, so close that their margins have no gaps.
fn points_of_parts() -> Vec<Point3<f64>> {
    let steps = |size: f64| {
        let count = (size / PART_STEP_M).ceil() as i32;
        (-count..=count).map(move |k| 0.5 * size * f64::from(k) / f64::from(count))
    };
    let mut points = Vec::new();
    for side in [-1.0, 1.0] {
        let mut add = |[cx, cy, cz]: [f64; 3], x: f64, y: f64, z: f64| {
            points.push(Point3::new(side * (cx + x), cy + y, cz + z));
        };
        for y in steps(LEG_SIZE_M[1]) {
            steps(LEG_SIZE_M[0]).for_each(|x| steps(LEG_SIZE_M[2]).for_each(|z| add(LEG_M, x, y, z)));
        }
        let radius = 0.5 * BLADE_SIZE_M[0].hypot(BLADE_SIZE_M[2]);
        for y in [-0.5, 0.0, 0.5].map(|share| share * BLADE_SIZE_M[1]) {
            for x in steps(2.0 * radius) {
                steps(2.0 * radius).filter(|z| x.hypot(*z) <= radius).for_each(|z| add(HUB_M, x, y, z));
            }
        }
    }
    points
}

/// The faces of a box around the origin.
fn faces(size: [f64; 3], finish: Finish, seed: u64) -> Vec<Surface> {
    let mut builder = Builder::new(seed, &[]);
    let half = Vector3::from(size) * 0.5;
    builder.solid(&Solid { centre: Vector3::zeros(), half, yaw: 0.0 }, finish);
    builder.surfaces
}

/// People that fill the share, evenly spread.
fn walkers(people: &People, camera: &CameraConfig, seed: u64, world: &mut World) -> Vec<Person> {
    let view_m = PEOPLE_M * camera.width_px as f64 / camera.focal_px[0];
    let count = (people.share / PERSON_SHARE).round().clamp(1.0, (MAX_MOVERS - 4) as f64);
    let width_m = people.share * view_m / count;
    let way_m = view_m + width_m;
    let crossing_s = way_m / people.speed_m_s.at_least(0.05);
    let mut draws = Draws::new(seed, Purpose::People, 0);
    let first = draws.unit();
    let clothes = [Material::Labels, Material::Posters, Material::Stones, Material::Tiles];
    (0..count as usize)
        .map(|k| {
            let finish = Finish::of(clothes[draws.index(4)]).zoomed(0.6).toned(0.05, 0.9);
            let size = [width_m, PERSON_SIZE_M[1], PERSON_SIZE_M[0]];
            world.add_mover(faces(size, finish, seed.wrapping_add(k as u64)), BRIGHTNESS);
            let phase_s = (first + k as f64 / count) * crossing_s;
            Person { pose_b_c: camera.pose_b_c(), crossing_s, phase_s, way_m }
        })
        .collect()
}

impl Person {
    /// Upright, at a constant distance from the camera; the way leads straight through where the camera looks in the middle of
    /// the crossing, whatever it does meanwhile.
    fn pose(&self, flight: &Trajectory, time: Timestamp) -> Isometry3<f64> {
        let since_s = time.seconds_since(flight.begin()) + self.phase_s;
        let crossing = (since_s / self.crossing_s).floor();
        let part = since_s / self.crossing_s - crossing;
        let middle_s = (crossing + 0.5) * self.crossing_s - self.phase_s;
        let camera = |motion: super::Motion| motion.pose_w_b * self.pose_b_c;
        let view = camera(flight.motion_at(middle_s.at_least(0.0)));
        let forward = view.rotation * Vector3::z();
        // Where the camera looks straight down, the horizon gives no right.
        let level = |v: Vector3<f64>| Vector3::new(v.x, v.y, 0.0).normalize();
        let right = forward.cross(&Vector3::z()).try_normalize(0.1);
        let right = right.unwrap_or_else(|| level(view.rotation * Vector3::x()));
        let ahead = Vector3::z().cross(&right);
        let to_right_m = (part - 0.5) * self.way_m;
        let p = camera(flight.motion(time)).translation.vector + forward * PEOPLE_M + right * to_right_m;
        let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[right, ahead, Vector3::z()]));
        Isometry3::from_parts(p.into(), UnitQuaternion::from_rotation_matrix(&axes))
    }
}
