use super::super::reprojection::{InversePoint, PointMeasurement};
use super::super::test_room::{Room, always};
use super::*;
use nalgebra::{Matrix2, Vector2};

fn seen(x: f64) -> PointMeasurement {
    PointMeasurement {
        xy: Vector2::new(x, 0.0),
        xy_rate: Vector2::zeros(),
        weight: Matrix2::identity(),
        row: Default::default(),
    }
}

fn track(track_id: u32, measured: [Option<PointMeasurement>; 2]) -> TrackMeasurement<PointMeasurement> {
    TrackMeasurement { track_id, measured }
}

fn guess(measured: &PointMeasurement) -> InversePoint {
    InversePoint { xy: measured.xy, rho: 0.1 }
}

#[test]
fn a_new_landmark_is_hosted_by_the_first_camera_that_sees_its_track() {
    let mut store = LandmarkStore::new(4);
    let tracks = [
        track(7, [Some(seen(0.1)), Some(seen(0.2))]),
        track(3, [None, Some(seen(0.3))]),
        track(5, [None, None]),
    ];
    host(&mut store, 2, &tracks, guess);
    assert_eq!(store.all().len(), 2, "a track that no camera sees hosts nothing");
    let of = |id: u32| &store.all()[store.of_track(id).expect("is there")];
    assert_eq!((of(7).host, of(7).host_camera, of(7).observations.len()), (2, 0, 2));
    assert_eq!((of(3).host, of(3).host_camera, of(3).observations.len()), (2, 1, 1));
    assert_eq!(of(3).feature.xy.x, 0.3);
    assert!(!of(3).is_triangulated);
}

/// A window whose measurements fit, `spoil` applied to the observations of track 4.
fn spoiled(spoil: impl Fn(&mut Observation<PointMeasurement>)) -> super::super::Window {
    let mut window = Room { frames: 4, sees: always, disturbance: 0.0, ..Room::default() }.window();
    let index = window.points.of_track(4).expect("is there");
    window.points.all_mut()[index].observations.iter_mut().for_each(spoil);
    let _ = window.linearize(0.0);
    window.remove_outliers();
    window
}

#[test]
fn an_observation_in_the_newest_frame_that_does_not_fit_is_told_of() {
    let window = spoiled(|o| {
        if (o.frame, o.camera) == (3, 1) {
            o.measured.xy.x += 0.05;
        }
    });
    assert_eq!(window.outliers().points, [4]);
    let landmark = &window.points.all()[window.points.of_track(4).expect("stays")];
    assert_eq!(landmark.observations.len(), 7);
}

#[test]
fn one_in_an_older_frame_is_dropped_in_silence() {
    let window = spoiled(|o| {
        if o.frame == 1 {
            o.measured.xy.y -= 0.05;
        }
    });
    assert!(window.outliers().points.is_empty());
    let landmark = &window.points.all()[window.points.of_track(4).expect("stays")];
    assert_eq!(landmark.observations.len(), 6);
}

#[test]
fn a_landmark_that_its_own_host_contradicts_goes() {
    let window = spoiled(|o| {
        if (o.frame, o.camera) == (0, 0) {
            o.measured.xy.x += 0.05;
        }
    });
    assert!(window.points.of_track(4).is_none());
}

#[test]
fn a_landmark_that_is_left_with_one_view_goes() {
    let window = spoiled(|o| {
        if (o.frame, o.camera) != (0, 0) {
            o.measured.xy.x += 0.05;
        }
    });
    assert!(window.points.of_track(4).is_none());
    assert_eq!(window.outliers().points, [4, 4], "both cameras tell");
}

#[test]
fn an_observation_that_is_no_number_never_fits() {
    for value in [f64::NAN, f64::INFINITY] {
        let window = spoiled(|o| {
            if o.frame == 2 {
                o.measured.xy.x = value;
            }
        });
        let landmark = &window.points.all()[window.points.of_track(4).expect("stays")];
        assert_eq!(landmark.observations.len(), 6);
    }
}

/// A window of five frames whose measurements fit, the newest pose turned by `turn_rad` about the camera's axes, and the
/// observations of `moved` tracks in the newest frame shifted.
fn newest_astray(turn_rad: f64, moved: u32) -> super::super::Window {
    let mut window = Room { frames: 5, sees: always, disturbance: 0.0, ..Room::default() }.window();
    let newest = window.frames.last_mut().expect("has frames");
    newest.nav.rot_o_b *=
        crate::geometry::exp_so3(&nalgebra::Vector3::new(0.4, -0.3, 0.5).map(|x| x * turn_rad));
    for landmark in window.points.all_mut().iter_mut().filter(|l| l.track_id < moved) {
        landmark.observations.iter_mut().filter(|o| o.frame == 4).for_each(|o| o.measured.xy.x += 0.05);
    }
    let _ = window.linearize(0.0);
    window
}

#[test]
fn a_minority_that_moves_is_removed_as_ever() {
    let mut window = newest_astray(0.0, 6);
    assert!(!window.is_newest_doubtful());
    window.remove_outliers();
    let mut moved: Vec<u32> = window.outliers().points.clone();
    moved.dedup();
    assert_eq!(moved, [0, 1, 2, 3, 4, 5]);
}

#[test]
fn images_that_agree_with_each_other_outvote_one_motion_that_contradicts_them() {
    let mut window = newest_astray(0.0, 0);
    let truth = window.frames.last().expect("has frames").nav.clone();
    let lie = crate::geometry::exp_so3(&nalgebra::Vector3::new(0.1, 0.0, 0.05));
    let newest = window.frames.last_mut().expect("has frames");
    let mut motion = newest.inertial.as_ref().expect("has a motion").motion.clone();
    motion.delta_rot *= lie;
    newest.inertial = Some(super::super::InertialFactor::new(motion, &window.imu_noise));
    newest.nav.rot_o_b *= lie;
    let _ = window.optimize(8);
    assert!(window.is_newest_doubtful(), "the motion alone keeps it where it is");
    assert!(window.doubt_newest_motion(8));
    let found = &window.frames.last().expect("has frames").nav;
    let off_rad = found.rot_o_b.angle_to(&truth.rot_o_b);
    assert!(off_rad < 0.1 * lie.angle(), "{off_rad}");
    assert!((found.p_o_b - truth.p_o_b).norm() < 1e-2);
}
