//! People who cross the view.

use super::Trajectory;
use super::builder::Builder;
use super::pattern::Material;
use super::scenario::{People, Scenario};
use super::shot::MAX_MOVERS;
use super::solid::Solid;
use super::world::{Finish, World};
use crate::random::{Draws, Purpose};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use plumbline_config::options::CameraConfig;
use plumbline_config::{Portable, Timestamp};

/// Distance of people from the left camera, m.
const PEOPLE_M: f64 = 1.2;
/// Share of the view's width that a person fills, about.
const PERSON_SHARE: f64 = 0.3;
/// Height at which people are kept until they come, m: below every floor.
const ABSENT_M: f64 = -1000.0;
/// Height and depth of a person, m.
const PERSON_SIZE_M: [f64; 2] = [1.75, 0.3];
/// Light on people, grey levels of a white surface.
const BRIGHTNESS: f32 = 165.0;

/// A person who walks across the view again and again.
#[derive(Clone, Copy, Debug)]
pub(super) struct Person {
    /// Takes coordinates of the left camera to the body.
    pose_b_c: Isometry3<f64>,
    /// Duration of a crossing, and how much of the first one has passed at the beginning of the path, s; negative for people who come later.
    crossing_s: f64,
    phase_s: f64,
    /// Way of a crossing, m, to the right.
    way_m: f64,
}

/// Poses in the world at `time` of people, in the order in which they entered.
pub(super) fn poses(people: &[Person], flight: &Trajectory, time: Timestamp) -> [Isometry3<f64>; MAX_MOVERS] {
    let mut poses = [Isometry3::identity(); MAX_MOVERS];
    poses.iter_mut().zip(people).for_each(|(pose, person)| *pose = person.pose(flight, time));
    poses
}

/// Puts people that fill the share of `scenario`, evenly spread, into the world. `first_frame_s` is the time of the first frame
/// after the beginning of the path, s.
pub(super) fn enter(
    scenario: &Scenario,
    camera: &CameraConfig,
    first_frame_s: f64,
    world: &mut World,
) -> Vec<Person> {
    let (People { share, speed_m_s, from_s }, seed) = (scenario.people, scenario.seed);
    if share <= 0.0 {
        return Vec::new();
    }
    // The time counts from the first frame on.
    let from_s = from_s + if from_s > 0.0 { first_frame_s } else { 0.0 };
    let view_m = PEOPLE_M * camera.width_px as f64 / camera.focal_px[0];
    let count = (share / PERSON_SHARE).round().clamp(1.0, MAX_MOVERS as f64);
    let width_m = share * view_m / count;
    let way_m = view_m + width_m;
    let crossing_s = way_m / speed_m_s.at_least(0.05);
    let mut draws = Draws::new(seed, Purpose::People, 0);
    let first_s = if from_s > 0.0 { -from_s } else { draws.unit() * crossing_s };
    // People who come later follow one another; those who are there from the start are ahead of one another.
    let next_s = crossing_s / count * if from_s > 0.0 { -1.0 } else { 1.0 };
    let clothes = [Material::Labels, Material::Posters, Material::Stones, Material::Tiles];
    (0..count as usize)
        .map(|k| {
            let finish = Finish::of(clothes[draws.index(4)]).zoomed(0.6).toned(0.05, 0.9);
            let half = Vector3::new(width_m, PERSON_SIZE_M[1], PERSON_SIZE_M[0]) * 0.5;
            let mut builder = Builder::new(seed.wrapping_add(k as u64), &[]);
            builder.solid(&Solid { centre: Vector3::zeros(), half, yaw: 0.0 }, finish);
            world.add_mover(builder.surfaces, BRIGHTNESS);
            let phase_s = first_s + k as f64 * next_s;
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
        if crossing < 0.0 {
            return Isometry3::translation(0.0, 0.0, ABSENT_M);
        }
        let part = since_s / self.crossing_s - crossing;
        let middle_s = (crossing + 0.5) * self.crossing_s - self.phase_s;
        let camera = |motion: super::MotionState| motion.pose_w_b * self.pose_b_c;
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
