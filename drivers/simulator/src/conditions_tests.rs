//! Tests of the conditions, on rendered images.

use super::*;
use plumbline_drivers::StereoSource;

/// A flight of the wobbling body in `scene` through a perfect camera, at half the size.
fn flight(scene: Scene, shape: impl Fn(&mut Scenario)) -> Simulator {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("wobble.tum");
    plumbline_drivers::tum::write_tum(&file, &fixture::wobble_poses(6.0)).unwrap();
    let mut scenario = Scenario {
        scene,
        path: FlightPath::Tum(file),
        duration_s: 4.0,
        resolution_scale: 0.5,
        effects: Effects::none(),
        ..Scenario::default()
    };
    shape(&mut scenario);
    Simulator::new(&fixture::config(), &scenario).unwrap()
}

/// The flight in a condition.
fn flight_in(scene: Scene, condition: &str) -> Simulator {
    let condition: SimulatedCondition = condition.parse().unwrap();
    flight(scene, |scenario| condition.apply(scenario))
}

fn left(simulator: &Simulator, index: u64) -> GrayImage {
    let mut image = GrayImage::new(1, 1);
    simulator.render_camera(index, 0, &mut simulator.scratch(), &mut image);
    image
}

fn mean(image: &GrayImage) -> f64 {
    image.pixels().iter().map(|&p| f64::from(p)).sum::<f64>() / image.pixels().len() as f64
}

/// Share of the pixels by which two images differ.
fn difference(a: &GrayImage, b: &GrayImage) -> f64 {
    let differ = a.pixels().iter().zip(b.pixels()).filter(|(a, b)| a.abs_diff(**b) > 4).count();
    differ as f64 / a.pixels().len() as f64
}

/// Shift of an image of `simulator` against rays cast at the time of each row, px, and their root mean square difference.
fn against_rays(simulator: &Simulator, index: u64, readout_s: f64) -> (Vector2<f64>, f64) {
    let image = left(simulator, index);
    let (world, lens) = (&simulator.inner.world, &simulator.inner.cameras[0].0);
    let (mut normal, mut right) = (nalgebra::Matrix2::zeros(), Vector2::zeros());
    let (mut square, mut count) = (0.0, 0.0);
    for (i, j) in (0..36).flat_map(|i| (0..22).map(move |j| (i, j))) {
        let (u, v) = (8 + 10 * i, 8 + 10 * j);
        let at = |du: usize, dv: usize| f64::from(image.pixels()[(v + dv - 1) * image.width() + u + du - 1]);
        let late_s = readout_s * (v as f64 / (image.height() as f64 - 1.0) - 0.5);
        let pose_w_c = simulator.pose_w_c(simulator.frame_time(index).plus_seconds(late_s), lens);
        let px = Vector2::new(u as f64, v as f64);
        let Some(grey) = tests::by_rays(world, lens, &pose_w_c, &px) else { continue };
        let slope = 0.5 * Vector2::new(at(2, 1) - at(0, 1), at(1, 2) - at(1, 0));
        normal += slope * slope.transpose();
        right += slope * (grey - at(1, 1));
        square += (grey - at(1, 1)).powi(2);
        count += 1.0;
    }
    (normal.try_inverse().unwrap() * right, f64::sqrt(square / count))
}

#[test]
fn rows_of_a_rolling_shutter_show_their_own_time() {
    let simulator = flight_in(Scene::Room, "rolling-shutter:20");
    for index in [10, 33, 61] {
        let (shift, rms) = against_rays(&simulator, index, 0.02);
        let (_, rms_at_once) = against_rays(&simulator, index, 0.0);
        println!("frame {index}: {shift:?} {rms:.2}, as a global shutter {rms_at_once:.2}");
        assert!(shift.norm() < 0.03 && rms < 4.0, "frame {index}: {shift} {rms}");
        assert!(rms_at_once > 2.0 * rms, "frame {index}: {rms_at_once} {rms}");
    }
}

#[test]
fn a_readout_of_nothing_is_a_global_shutter() {
    let [global, rolling] = ["rolling-shutter:0", "rolling-shutter:0.000001"];
    let [a, b] = [global, rolling].map(|condition| left(&flight_in(Scene::Room, condition), 20));
    assert!(difference(&a, &b) < 1e-3, "{}", difference(&a, &b));
}

#[test]
fn people_fill_up_to_their_share_of_the_view() {
    // The built-in flight looks ahead.
    let ahead = |scenario: &mut Scenario| {
        scenario.path = FlightPath::Demo;
        scenario.start_s = 6.0;
    };
    let empty = flight(Scene::Hall, ahead);
    for (condition, most) in [("people:33", 0.33), ("people:60", 0.6)] {
        let simulator = flight(Scene::Hall, |scenario| {
            ahead(scenario);
            condition.parse::<SimulatedCondition>().unwrap().apply(scenario);
        });
        let shares = (0..16).map(|k| difference(&left(&simulator, 5 * k), &left(&empty, 5 * k)));
        let largest = shares.fold(0.0, f64::max);
        println!("{condition}: {largest:.2}");
        assert!((0.6 * most..1.15 * most).contains(&largest), "{condition}: {largest}");
    }
}

#[test]
fn people_who_come_later_are_not_seen_before() {
    let [with, without] = [flight_in(Scene::Room, "people:33:1.2:2"), flight(Scene::Room, |_| {})];
    let share = |index| difference(&left(&with, index), &left(&without, index));
    assert_eq!([0, 20, 39].map(share), [0.0; 3]);
    assert!((45..80).step_by(5).map(share).fold(0.0, f64::max) > 0.15);
}

#[test]
fn night_is_dark_and_noisy() {
    let day = flight(Scene::Room, |_| {});
    let night = flight_in(Scene::Room, "night");
    let [a, b] = [&day, &night].map(|simulator| mean(&left(simulator, 20)));
    assert!((b / a - 0.2).abs() < 0.03, "{b} {a}");
}

#[test]
fn a_bare_room_shows_few_corners_and_a_pattern_many() {
    let corners = |condition| {
        let simulator = flight_in(Scene::Room, condition);
        [0, 25, 50, 75].map(|k| tests::corner_cells(&left(&simulator, k))).iter().sum::<usize>() as f64 / 4.0
    };
    let (bare, repeated) = (corners("bare:15"), corners("repeated:30"));
    println!("cells with a corner: bare {bare}, repeated {repeated}");
    assert!((4.0..22.0).contains(&bare) && repeated > 35.0);
}

#[test]
fn conditions_give_the_same_bits_in_any_order() {
    let make = || {
        flight(Scene::Room, |scenario| {
            for condition in ["rolling-shutter:10", "people:60", "blur:3:2"] {
                condition.parse::<SimulatedCondition>().unwrap().apply(scenario);
            }
        })
    };
    let (one, two) = (make(), make());
    let mut stream = one.stereo();
    let mut frames = Vec::new();
    let mut frame = StereoFrame::new(one.image_sizes());
    while frames.len() < 3 && stream.next_frame(&mut frame).unwrap() {
        frames.push(frame.clone());
    }
    for index in [2, 0, 1] {
        two.render_frame(index, &mut two.scratch(), &mut frame);
        assert!(frame.images == frames[index as usize].images, "frame {index}");
    }
}
