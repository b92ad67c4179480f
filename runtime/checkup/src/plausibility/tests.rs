//! Each kind of nonsense gives its warning, and sound data give none.

use super::*;
use plumbline_config::options::image_sizes;
use plumbline_drivers::simulator::{FlightPath, Scenario, Scene, Simulator};
use plumbline_drivers::{EurocDataset, EurocOptions, ImuSource as _, StereoFrame, StereoSource};

/// Looks at the data of two streams as a run would.
fn looked_at(
    config: &Config,
    samples: impl Iterator<Item = ImuSample>,
    stereo: &mut dyn StereoSource,
    swap: bool,
) -> Vec<Finding> {
    let sizes = image_sizes(&config.camera);
    let mut plausibility = Plausibility::new(config, false);
    samples.for_each(|sample| plausibility.add_sample(&sample));
    let (mut frame, mut glimpse) = (StereoFrame::new(sizes), Glimpse::new(sizes));
    while !plausibility.has_seen_enough() && stereo.next_frame(&mut frame).unwrap() {
        if swap {
            frame.images.swap(0, 1);
        }
        (glimpse.stamp, glimpse.valid) = (frame.stamp, frame.valid);
        for (thumbnail, image) in glimpse.images.iter_mut().zip(&frame.images) {
            thumbnail.take(image);
        }
        plausibility.add_frame(&glimpse);
        plausibility.add_estimate(frame.sequence, HealthBits::default());
    }
    plausibility.findings()
}

/// A simulated flight of so many seconds with half the resolution.
fn simulated(scene: Scene, start_s: f64, duration_s: f64) -> Simulator {
    let config = Config::preset("sim").unwrap();
    let scenario = Scenario {
        scene,
        path: FlightPath::Demo,
        start_s,
        duration_s,
        resolution_scale: 0.5,
        ..Scenario::default()
    };
    Simulator::new(&config, &scenario).unwrap()
}

fn samples(simulator: &Simulator) -> Vec<ImuSample> {
    let mut imu = simulator.imu();
    std::iter::from_fn(|| imu.next_reading().unwrap()).map(|reading| reading.sample).collect()
}

/// What is found when the samples of a flight are changed.
fn with_samples(change: impl Fn(&mut ImuSample)) -> Vec<Finding> {
    let simulator = simulated(Scene::Room, 3.0, 7.0);
    let mut samples = samples(&simulator);
    samples.iter_mut().for_each(change);
    looked_at(simulator.config(), samples.into_iter(), &mut simulator.stereo(), false)
}

/// The one finding names all of `words`.
fn names(findings: &[Finding], words: &[&str]) {
    let [finding] = findings else { panic!("not one finding: {findings:#?}") };
    let text = finding.to_string();
    assert!(words.iter().all(|word| text.contains(word)), "{words:?}: {text}");
}

#[test]
fn sound_flights_give_no_warning() {
    for scene in [Scene::Room, Scene::Hall, Scene::LowTexture] {
        let simulator = simulated(scene, 3.0, 8.0);
        let samples = samples(&simulator).into_iter();
        let findings = looked_at(simulator.config(), samples, &mut simulator.stereo(), false);
        assert_eq!(findings, [], "{scene:?}");
    }
}

#[test]
fn sound_recordings_give_no_warning() {
    for clip in ["V1_01_easy_clip", "MH_05_mono_clip"] {
        let Some(path) = plumbline_test_support::shared(&format!("euroc/{clip}")) else { return };
        let config = plumbline_config::import::euroc_into(Config::preset("euroc").unwrap(), &path).unwrap();
        let dataset = EurocDataset::open(&path, &EurocOptions::for_config(&config)).unwrap();
        let mut imu = dataset.imu();
        let samples = std::iter::from_fn(|| imu.next_reading().unwrap()).map(|reading| reading.sample);
        assert_eq!(looked_at(&config, samples, &mut dataset.stereo(), false), [], "{clip}");
    }
}

#[test]
fn units_of_the_imu_are_told() {
    names(&with_samples(|s| s.accel /= 9.806_65), &["accelerometer", "units of gravity (g)", "9.80665"]);
    names(&with_samples(|s| s.accel *= 1000.0 / 9.806_65), &["thousandths of gravity"]);
    names(&with_samples(|s| s.gyro *= 180.0 / std::f64::consts::PI), &["gyroscope", "degrees a second"]);
}

#[test]
fn columns_that_are_swapped_are_told() {
    names(
        &with_samples(|s| std::mem::swap(&mut s.gyro, &mut s.accel)),
        &["columns of gyroscope and accelerometer"],
    );
    names(&with_samples(|s| s.gyro.swap_rows(0, 1)), &["columns of the gyroscope", "y x z"]);
    names(&with_samples(|s| s.gyro.swap_rows(0, 2)), &["columns of the gyroscope", "z y x"]);
    names(&with_samples(|s| s.accel.swap_rows(0, 1)), &["columns of the accelerometer", "y x z"]);
    names(&with_samples(|s| s.accel = -s.accel), &["gravity points upwards", "is negated"]);
}

#[test]
fn inverted_extrinsics_are_told() {
    let simulator = simulated(Scene::Room, 3.0, 7.0);
    let mut config: Config = simulator.config().clone();
    for camera in &mut config.camera {
        let matrix = camera.pose_b_c().inverse().to_homogeneous();
        camera.pose_b_c = std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]));
    }
    let findings = looked_at(&config, samples(&simulator).into_iter(), &mut simulator.stereo(), false);
    names(&findings, &["extrinsics are inverted", "T_CB"]);
}

#[test]
fn an_imu_turned_by_half_a_turn_is_a_cause_beside_inverted_extrinsics() {
    let found = with_samples(|s| {
        for v in [&mut s.gyro, &mut s.accel] {
            (v.x, v.y) = (-v.x, -v.y);
        }
    });
    names(&found, &["-x -y z", "T_CB where T_BC", "invert camera[..].pose_b_c"]);
}

#[test]
fn swapped_cameras_are_told() {
    let simulator = simulated(Scene::Room, 3.0, 7.0);
    let samples = samples(&simulator).into_iter();
    let findings = looked_at(simulator.config(), samples, &mut simulator.stereo(), true);
    names(&findings, &["left and right camera are swapped"]);
}

#[test]
fn focal_lengths_of_another_camera_are_told() {
    let simulator = simulated(Scene::Room, 3.0, 12.0);
    let mut config: Config = simulator.config().clone();
    for camera in &mut config.camera {
        camera.focal_px = camera.focal_px.map(|focal| 2.0 * focal);
    }
    let findings = looked_at(&config, samples(&simulator).into_iter(), &mut simulator.stereo(), false);
    names(&findings, &["focal lengths of another camera"]);
}

#[test]
fn a_camera_that_never_delivers_and_the_reason_of_a_reset_are_told() {
    let mut plausibility = Plausibility::new(&Config::preset("sim").unwrap(), false);
    (0..MISSED_AFTER).for_each(|k| plausibility.add_estimate(k, HealthBits::RIGHT_MISSING));
    names(&plausibility.findings(), &["two cameras", "--mono"]);
    plausibility.add_reset("frame 7: reset 1: speed 51.0 m/s");
    assert!(plausibility.findings()[1].to_string().contains("speed 51.0 m/s"));
}

#[test]
fn frames_that_are_lost_are_told_in_a_live_flight_alone() {
    let config = Config::preset("sim").unwrap();
    for is_live in [false, true] {
        let mut plausibility = Plausibility::new(&config, is_live);
        (0..MISSED_AFTER).for_each(|k| plausibility.add_estimate(2 * k, HealthBits::default()));
        let findings = plausibility.findings();
        assert_eq!(findings.len(), usize::from(is_live));
        assert!(findings.iter().all(|f| f.to_string().contains("39 of 79")), "{findings:?}");
    }
}
