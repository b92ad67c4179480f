//! Rooms that look alike: how often is a frame of one found in the other?

use super::building::{Building, Stop, held};
use super::flight::{Shot, shots};
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Random;
use plumbline_estimator::places::{Located, Locator, LocatorOptions, MapLimits, PlaceMap};
use std::f64::consts::TAU;

/// Views of a room that a map holds.
const VIEWS: usize = 24;
/// Frames that are located.
const FRAMES: usize = 60;
/// Displacement of the second room.
const AWAY: Vector3<f64> = Vector3::new(20.0, 0.0, 0.0);

/// Frames in all directions from the middle of a room whose middle is at `centre`.
fn around(room: &Building, centre: Vector3<f64>, count: usize, seed: u64) -> Vec<Shot> {
    let mut random = Random::new(seed);
    let stops: Vec<_> = (0..count)
        .map(|k| {
            let mut small = |scale: f64| scale * (2.0 * random.unit() - 1.0);
            let place = centre + Vector3::new(small(0.8), small(0.8), small(0.4));
            let yaw = TAU * k as f64 / count as f64;
            Stop { hall: 0, pose_m_b: held(place, yaw, &mut random) }
        })
        .collect();
    shots(room, &stops, seed + 1)
}

fn map_of(views: &[&[Shot]]) -> PlaceMap {
    let keyframes = views.iter().map(|v| v.len()).sum();
    let mut map = PlaceMap::new(MapLimits { keyframes, features: super::building::FEATURES });
    for (number, shot) in views.iter().copied().flatten().enumerate() {
        map.add(shot.keyframe(number), &shot.features);
    }
    map
}

/// Answers of a locator: right, wrong, and none.
struct Said {
    right: usize,
    wrong: Vec<(usize, Located)>,
}

fn ask(map: &PlaceMap, frames: &[Shot]) -> Said {
    let options = LocatorOptions::default();
    let mut locator = Locator::new(&options, map.limits().keyframes, map.limits().features);
    let mut said = Said { right: 0, wrong: Vec::new() };
    for (number, shot) in frames.iter().enumerate() {
        match locator.locate(map, &shot.query(number as u64), |_| true) {
            Some(found) if shot.is_at(&found) => said.right += 1,
            Some(found) => said.wrong.push((number, found)),
            None => {}
        }
    }
    said
}

impl Said {
    fn print(&self, name: &str) {
        println!("{name}: of {FRAMES} frames {} right, {} wrong", self.right, self.wrong.len());
    }

    /// Counts pairs of consecutive wrong poses: those that agree with each other as well as with the true way between,
    /// and all. The former would pass a consistency check among loops.
    fn agreeing(&self, frames: &[Shot]) -> (usize, usize) {
        let pairs = self.wrong.windows(2).filter(|w| w[1].0 == w[0].0 + 1);
        let (mut agree, mut count) = (0, 0);
        for pair in pairs {
            let true_way = frames[pair[0].0].stop.pose_m_b.inverse() * frames[pair[1].0].stop.pose_m_b;
            let way: Isometry3<f64> = pair[0].1.pose_m_b.inverse() * pair[1].1.pose_m_b;
            let off = (way.translation.vector - true_way.translation.vector).norm();
            count += 1;
            agree += usize::from(off < 0.2 && way.rotation.angle_to(&true_way.rotation) < 0.1);
        }
        (agree, count)
    }
}

#[test]
fn a_mirrored_room_is_not_taken_for_the_room() {
    let room = Building::room(1);
    let mirrored = room.moved(|p| Vector3::new(-p.x, p.y, p.z));
    let map = map_of(&[&around(&room, Vector3::zeros(), VIEWS, 1)]);
    let said = ask(&map, &around(&mirrored, Vector3::zeros(), FRAMES, 2));
    said.print("mirrored");
    // The room itself is found.
    let own = ask(&map, &around(&room, Vector3::zeros(), FRAMES, 3));
    own.print("the room itself");
    assert!(20 * own.right >= 19 * FRAMES && own.wrong.is_empty());
    assert_eq!((said.right, said.wrong.len()), (0, 0));
}

/// With both in the map, the one that fits better is said, or none; three tenths of the second room are its own.
#[test]
fn of_two_like_rooms_in_the_map_the_right_one_is_said_or_none() {
    let room = Building::room(1);
    for share in [0.2, 0.3] {
        let second = room.changed(share, 7).moved(|p| p + AWAY);
        let map = map_of(&[&around(&room, Vector3::zeros(), VIEWS, 1), &around(&second, AWAY, VIEWS, 4)]);
        for (name, frames) in [
            ("first", around(&room, Vector3::zeros(), FRAMES, 5)),
            ("second", around(&second, AWAY, FRAMES, 6)),
        ] {
            let said = ask(&map, &frames);
            said.print(&format!("both in the map, {share} of the second changed, frames of the {name}"));
            assert_eq!(said.wrong.len(), 0);
        }
    }
}

/// With the second room never seen before, a frame of it cannot but be taken for the first: what is the same is the same.
/// Nor do such poses contradict each other. What knows better is the odometry: the room would have to be where it is
/// not. This test holds down what the pose graph must expect.
#[test]
fn a_room_repeated_elsewhere_is_taken_for_the_first_and_only_the_way_there_tells() {
    let room = Building::room(1);
    let map = map_of(&[&around(&room, Vector3::zeros(), VIEWS, 1)]);
    for share in [0.2, 0.3, 0.5] {
        let second = room.changed(share, 7).moved(|p| p + AWAY);
        let frames = around(&second, AWAY, FRAMES, 6);
        let said = ask(&map, &frames);
        said.print(&format!("first in the map, {share} of the second changed"));
        let (agree, pairs) = said.agreeing(&frames);
        println!("  {agree} of {pairs} pairs of consecutive wrong poses agree with each other");
        // Each is out by the way between the rooms, and by nothing else.
        for (number, found) in &said.wrong {
            let shift = frames[*number].stop.pose_m_b.translation.vector - found.pose_m_b.translation.vector;
            assert!((shift - AWAY).norm() < 0.3, "{shift}");
        }
    }
}
