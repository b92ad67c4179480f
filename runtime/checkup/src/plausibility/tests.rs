//! Each kind of nonsense gives its warning, and sound data give none.

use super::*;
use crate::tests::{Seen, rendered};
use plumbline_config::options::image_sizes;
use plumbline_drivers::{
    DriverError, EurocDataset, EurocOptions, Faults, ImuSource, StereoFrame, StereoSource,
};
use plumbline_simulator::{FlightPath, Scenario, Scene, Simulator};

/// Frames that were rendered before.
struct Rendered(std::vec::IntoIter<Seen>);

impl StereoSource for Rendered {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        let Some((sequence, stamp, images)) = self.0.next() else { return Ok(false) };
        (frame.sequence, frame.stamp, frame.images, frame.valid) = (sequence, stamp, images, [true; 2]);
        Ok(true)
    }

    fn expected_frames(&self) -> Option<u64> {
        Some(self.0.len() as u64)
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }
}

/// A flight's data, kept so that a test can change them: images are rendered once.
struct Flight {
    config: Config,
    samples: Vec<ImuSample>,
    glimpses: Vec<Glimpse>,
}

impl Flight {
    /// Reads two streams to their ends.
    fn read(config: &Config, imu: &mut dyn ImuSource, stereo: &mut dyn StereoSource) -> Self {
        let samples =
            std::iter::from_fn(|| imu.next_reading().unwrap()).map(|reading| reading.sample).collect();
        let sizes = image_sizes(&config.camera);
        let (mut frame, mut glimpse) = (StereoFrame::new(sizes), Glimpse::new(sizes));
        let mut glimpses = Vec::new();
        while stereo.next_frame(&mut frame).unwrap() {
            (glimpse.stamp, glimpse.valid) = (frame.stamp, frame.valid);
            for (thumbnail, image) in glimpse.images.iter_mut().zip(&frame.images) {
                thumbnail.take(image);
            }
            glimpses.push(glimpse.clone());
        }
        Self { config: config.clone(), samples, glimpses }
    }

    /// A simulated flight from the third second on, with half the resolution.
    fn simulated(scene: Scene, duration_s: f64) -> Self {
        let config = Config::preset("sim").unwrap();
        let scenario = Scenario {
            scene,
            path: FlightPath::Demo,
            start_s: 3.0,
            duration_s,
            resolution_scale: 0.5,
            ..Scenario::default()
        };
        let simulator = Simulator::new(&config, &scenario).unwrap();
        let frames = rendered(&simulator, &format!("{scenario:?}"), usize::MAX).into_iter();
        Self::read(simulator.config(), &mut simulator.imu(), &mut Rendered(frames))
    }

    /// Looks at the data as a run would, with samples that are changed.
    fn findings_with(&self, change: impl Fn(&mut ImuSample)) -> Vec<Finding> {
        let mut plausibility = Plausibility::new(&self.config, false);
        for mut sample in self.samples.iter().copied() {
            change(&mut sample);
            plausibility.add_sample(&sample);
        }
        for (sequence, glimpse) in (0..).zip(&self.glimpses) {
            if plausibility.has_seen_enough() {
                break;
            }
            plausibility.add_frame(glimpse);
            plausibility.add_estimate(sequence, HealthBits::default());
        }
        plausibility.findings()
    }

    fn findings(&self) -> Vec<Finding> {
        self.findings_with(|_| ())
    }
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
        assert_eq!(Flight::simulated(scene, 8.0).findings(), [], "{scene:?}");
    }
}

#[test]
fn sound_recordings_give_no_warning() {
    for clip in ["V1_01_easy_clip", "MH_05_mono_clip"] {
        let Some(path) = plumbline_test_support::shared(&format!("euroc/{clip}")) else { return };
        let config = plumbline_config::import::euroc_into(Config::preset("euroc").unwrap(), &path).unwrap();
        let dataset = EurocDataset::open(&path, &EurocOptions::for_config(&config)).unwrap();
        let flight = Flight::read(&config, &mut dataset.imu(), &mut dataset.stereo());
        assert_eq!(flight.findings(), [], "{clip}");
    }
}

#[test]
fn units_of_the_imu_are_told() {
    let flight = Flight::simulated(Scene::Room, 7.0);
    let accel = |factor: f64| flight.findings_with(|s| s.accel *= factor);
    names(&accel(1.0 / 9.806_65), &["accelerometer", "units of gravity (g)", "9.80665"]);
    names(&accel(1000.0 / 9.806_65), &["thousandths of gravity"]);
    names(
        &flight.findings_with(|s| s.gyro *= 180.0 / std::f64::consts::PI),
        &["gyroscope", "degrees a second"],
    );
}

#[test]
fn rows_that_are_filled_with_zeros_are_told() {
    let flight = Flight::simulated(Scene::Room, 7.0);
    let with = |one_in: u64, change: fn(&mut ImuSample)| {
        let count = std::cell::Cell::new(0_u64);
        flight.findings_with(|s| {
            count.set(count.get() + 1);
            if count.get().is_multiple_of(one_in) {
                change(s);
            }
        })
    };
    names(
        &with(2, |s| s.gyro = nalgebra::Vector3::zeros()),
        &["the gyroscope is exactly zero", "unite_imu_method"],
    );
    names(&with(3, |s| s.accel = nalgebra::Vector3::zeros()), &["the accelerometer is exactly zero"]);
    // A few are no driver's habit, and a simulator at rest has many in one run.
    assert_eq!(with(100, |s| s.gyro = nalgebra::Vector3::zeros()), []);
    let count = std::cell::Cell::new(0_u64);
    let at_rest = flight.findings_with(|s| {
        count.set(count.get() + 1);
        if count.get() < 200 {
            s.gyro = nalgebra::Vector3::zeros();
        }
    });
    assert!(!at_rest.iter().any(|finding| finding.what.contains("zeros")), "{at_rest:?}");
}

#[test]
fn samples_that_are_handed_out_twice_are_told() {
    let flight = Flight::simulated(Scene::Room, 7.0);
    let (count, held) = (std::cell::Cell::new(0_u64), std::cell::Cell::new(None::<ImuSample>));
    let findings = flight.findings_with(|s| {
        count.set(count.get() + 1);
        match held.get() {
            Some(last) if count.get() % 2 == 0 => (s.gyro, s.accel) = (last.gyro, last.accel),
            _ => held.set(Some(*s)),
        }
    });
    names(&findings, &["samples of the IMU repeat", "bit for bit", "its own rate"]);
}

#[test]
fn columns_that_are_swapped_are_told() {
    let flight = Flight::simulated(Scene::Room, 7.0);
    names(
        &flight.findings_with(|s| std::mem::swap(&mut s.gyro, &mut s.accel)),
        &["columns of gyroscope and accelerometer"],
    );
    names(&flight.findings_with(|s| s.gyro.swap_rows(0, 1)), &["columns of the gyroscope", "y x z"]);
    names(&flight.findings_with(|s| s.gyro.swap_rows(0, 2)), &["columns of the gyroscope", "z y x"]);
    names(&flight.findings_with(|s| s.accel.swap_rows(0, 1)), &["columns of the accelerometer", "y x z"]);
    names(&flight.findings_with(|s| s.accel = -s.accel), &["gravity points upwards", "is negated"]);
}

#[test]
fn wrong_extrinsics_and_an_imu_turned_by_half_a_turn_are_told() {
    let mut flight = Flight::simulated(Scene::Room, 7.0);
    let turned = flight.findings_with(|s| {
        for v in [&mut s.gyro, &mut s.accel] {
            (v.x, v.y) = (-v.x, -v.y);
        }
    });
    names(&turned, &["-x -y z", "T_CB where T_BC", "invert camera[..].pose_b_c"]);
    for camera in &mut flight.config.camera {
        let matrix = camera.pose_b_c().inverse().to_homogeneous();
        camera.pose_b_c = std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]));
    }
    names(&flight.findings(), &["extrinsics are inverted", "T_CB"]);
}

#[test]
fn swapped_cameras_are_told() {
    let mut flight = Flight::simulated(Scene::Room, 7.0);
    flight.glimpses.iter_mut().for_each(|glimpse| glimpse.images.swap(0, 1));
    names(&flight.findings(), &["left and right camera are swapped"]);
}

#[test]
fn one_image_on_both_sides_is_named() {
    let mut flight = Flight::simulated(Scene::Room, 7.0);
    flight.glimpses.iter_mut().for_each(|glimpse| glimpse.images[1] = glimpse.images[0].clone());
    names(&flight.findings(), &["left and right images are the same", "driver.v4l2.right"]);
    // Both cameras in the dark see the same too.
    flight
        .glimpses
        .iter_mut()
        .flat_map(|glimpse| &mut glimpse.images)
        .for_each(|image| image.pixels.fill(3.0));
    assert!(flight.findings().iter().all(|finding| !finding.what.contains("are the same")));
}

#[test]
fn focal_lengths_of_another_camera_are_told() {
    let mut flight = Flight::simulated(Scene::Room, 12.0);
    for camera in &mut flight.config.camera {
        camera.focal_px = camera.focal_px.map(|focal| 2.0 * focal);
    }
    names(&flight.findings(), &["focal lengths of another camera"]);
}

#[test]
fn images_that_freeze_with_noise_are_no_other_focal_length() {
    let mut flight = Flight::simulated(Scene::Room, 16.0);
    let frozen = flight.glimpses.len() / 2;
    for k in frozen + 1..flight.glimpses.len() {
        let images = flight.glimpses[frozen].images.clone();
        let glimpse = &mut flight.glimpses[k];
        glimpse.images = images;
        for (pixel, grey) in glimpse.images.iter_mut().flat_map(|image| &mut image.pixels).enumerate() {
            *grey += ((pixel * 31 + k * 17) % 5) as f32 * 0.1;
        }
    }
    names(&flight.findings(), &["stand still while the gyroscope turns", "freeze", "restart"]);
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
