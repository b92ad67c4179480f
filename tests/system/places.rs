//! Real images are found in a map of real images, and none in the wrong place.

mod build;
mod frames;

use build::{build, locate};
use frames::RecordedFrames;
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_drivers::StampedPose;
use plumbline_drivers::tum::read_tum;
use plumbline_estimator::places::{MapLimits, PlaceMap};
use plumbline_tests::shared;

/// An image overlaps with a map when so many of the map's points lie in its view, and are seen from not too
/// different a place: at a distance of half to twice that of their keyframe, and turned by less than 30 degrees.
const MIN_SHARED_POINTS: usize = 30;
const FEATURES: usize = 400;

/// The room of V1_01: 60 stereo pairs, seconds apart.
struct Room {
    folder: std::path::PathBuf,
    poses: Vec<StampedPose>,
}

impl Room {
    fn open() -> Option<Self> {
        let folder = shared("euroc/V1_01_places")?.join("euroc/V1_01_places");
        let poses = read_tum(&folder.join("poses.tum")).unwrap();
        Some(Self { folder, poses })
    }

    fn frames(&self, offset: usize) -> RecordedFrames {
        RecordedFrames::open(&self.folder, 2, offset, FEATURES).unwrap()
    }

    fn map(&self, offset: usize) -> PlaceMap {
        let limits = MapLimits { keyframes: 64, features: FEATURES };
        build(&mut self.frames(offset), &self.poses, limits).unwrap()
    }

    fn pose(&self, stamp: Timestamp) -> Isometry3<f64> {
        self.poses.iter().find(|p| p.stamp == stamp).unwrap().pose
    }
}

/// Most points that any keyframe of the map shares with a view from `pose_m_b`.
fn shared_points(map: &PlaceMap, pose_m_b: &Isometry3<f64>, pose_b_c: &Isometry3<f64>) -> usize {
    let pose_m_c = pose_m_b * pose_b_c;
    let shared = |(slot, keyframe): (usize, &plumbline_estimator::places::Keyframe)| {
        let points = map.features(slot).iter().filter(|f| f.is_point());
        let seen = points.filter(|f| {
            let at_keyframe = f.position_c();
            let p_m = keyframe.pose_m_c() * nalgebra::Point3::from(at_keyframe);
            let here = pose_m_c.inverse() * p_m;
            let ratio = here.z / at_keyframe.z;
            let rays = [
                p_m.coords - pose_m_c.translation.vector,
                p_m.coords - keyframe.pose_m_c().translation.vector,
            ];
            let angle = rays[0].angle(&rays[1]).to_degrees();
            // Half of the field of the camera: 752x480 px at a focal length of 458 px.
            (0.5..2.0).contains(&ratio)
                && angle < 30.0
                && (here.x / here.z).abs() < 0.8
                && (here.y / here.z).abs() < 0.5
        });
        seen.count()
    };
    map.keyframes().map(shared).max().unwrap_or(0)
}

#[test]
fn every_second_image_of_a_room_is_found_between_the_others() {
    let Some(room) = Room::open() else { return };
    for offset in [0, 1] {
        let map = room.map(offset);
        let mut frames = room.frames(1 - offset);
        let pose_b_c = frames.left().pose_b_c;
        let (mut overlapping, mut found_overlapping) = (0, 0);
        let (mut errors_m, mut errors_deg, mut nees) = (Vec::new(), Vec::new(), Vec::new());
        let up_b = |stamp| room.pose(stamp).rotation.inverse() * Vector3::z();
        locate(&mut frames, &map, up_b, |frame| {
            let truth = room.pose(frame.stamp);
            let overlaps = shared_points(&map, &truth, &pose_b_c) >= MIN_SHARED_POINTS;
            overlapping += usize::from(overlaps);
            let Some(found) = &frame.located else { return };
            found_overlapping += usize::from(overlaps);
            let moved: Vector3<f64> = found.pose_m_b.translation.vector - truth.translation.vector;
            let turned = truth.rotation.inverse() * found.pose_m_b.rotation;
            errors_m.push(moved.norm());
            errors_deg.push(turned.angle().to_degrees());
            let mut error = nalgebra::Vector6::zeros();
            error.fixed_rows_mut::<3>(0).copy_from(&moved);
            error.fixed_rows_mut::<3>(3).copy_from(&turned.scaled_axis());
            nees.push(error.dot(&found.covariance.cholesky().unwrap().solve(&error)));
        })
        .unwrap();
        for values in [&mut errors_m, &mut errors_deg, &mut nees] {
            values.sort_unstable_by(f64::total_cmp);
        }
        let middle = errors_m.len() / 2;
        let last = errors_m.len() - 1;
        println!(
            "map from image {offset} on: {overlapping} overlap, {found_overlapping} of them found, {} in all; \
             median {:.3} m {:.2} degrees, worst {:.3} m {:.2} degrees; NEES median {:.1}, worst {:.1}",
            errors_m.len(),
            errors_m[middle],
            errors_deg[middle],
            errors_m[last],
            errors_deg[last],
            nees[middle],
            nees[last]
        );
        assert!(overlapping >= 15 && 10 * found_overlapping >= 6 * overlapping);
        assert!(errors_m[last] <= 0.3 && errors_deg[last] <= 5.0, "one is found in the wrong place");
        assert!(errors_m[middle] <= 0.05 && errors_deg[middle] <= 1.0);
        // Six unknowns: the median of a chi-squared variable is 5.3, and 99.99 % lie below 28.
        assert!((1.0..12.0).contains(&nees[middle]) && nees[last] < 40.0);
    }
}

#[test]
fn images_of_another_place_are_not_found() {
    let Some(room) = Room::open() else { return };
    let Some(shared) = shared("euroc/MH_05_mono_clip") else { return };
    let map = room.map(0);
    let hall = shared.join("euroc/MH_05_mono_clip");
    let mut frames = RecordedFrames::open(&hall, 10, 0, FEATURES).unwrap();
    let mut looked_at = 0;
    // The rig's x axis points up in flight, or nearly.
    locate(
        &mut frames,
        &map,
        |_| Vector3::x(),
        |frame| {
            looked_at += 1;
            assert!(
                frame.located.is_none(),
                "{} of the machine hall is found in the Vicon room",
                frame.stamp
            );
        },
    )
    .unwrap();
    assert!(looked_at >= 25);
}
