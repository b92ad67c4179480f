//! Rigs whose calibration is off, moved by hand in the simulator.

use super::rendered;
use crate::camera_imu::{ByHand, DIM, FoundRig, RigError};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_config::options::rows_from_isometry;
use plumbline_config::{Config, ValidConfig};
use plumbline_drivers::ImuSource as _;
use plumbline_simulator::{Effects, FlightPath, Scenario, Simulator};

/// Time offset of the simulated cameras, s.
const OFFSET_S: f64 = 0.004;

fn simulator(path: FlightPath, seed: u64, duration_s: f64, readout_s: f64) -> Simulator {
    scaled(path, seed, duration_s, readout_s, 0.35)
}

fn scaled(path: FlightPath, seed: u64, duration_s: f64, readout_s: f64, resolution_scale: f64) -> Simulator {
    let effects = Effects { time_offset_s: OFFSET_S, readout_s, ..Effects::default() };
    let scenario = Scenario { path, duration_s, seed, resolution_scale, effects, ..Scenario::default() };
    Simulator::new(&Config::preset("sim").unwrap(), &scenario).unwrap()
}

/// The rig as it is believed: turned by a degree, moved by two centimetres, 5 ms late or early.
fn believed(simulator: &Simulator, seed: u64) -> ValidConfig {
    let angle = 2.4 * seed as f64;
    let axis = Vector3::new(angle.cos(), (1.7 * angle).sin(), 0.5).normalize();
    let away = Vector3::new((3.1 * angle).sin(), 0.4, angle.sin()).normalize() * 0.02;
    let turn = UnitQuaternion::from_scaled_axis(axis * 1.0_f64.to_radians());
    let mut config = simulator.config().clone();
    for camera in &mut config.camera {
        let pose = camera.pose_b_c();
        let moved = Isometry3::from_parts((pose.translation.vector + away).into(), turn * pose.rotation);
        camera.pose_b_c = rows_from_isometry(&moved);
    }
    config.rig.time_offset_s = OFFSET_S + if seed.is_multiple_of(2) { 0.005 } else { -0.005 };
    config.validated("believed").unwrap()
}

fn recording(simulator: &Simulator, config: &ValidConfig) -> ByHand {
    let mut recording = ByHand::new(config);
    let mut imu = simulator.imu();
    while let Some(reading) = imu.next_reading().unwrap() {
        recording.add_sample(&reading.sample);
    }
    for (number, stamp, [left, right]) in
        rendered(simulator, &format!("{:?}", simulator.scenario()), usize::MAX)
    {
        recording.add_frame(number, stamp, &[Some(left.view()), Some(right.view())]);
    }
    recording
}

/// Errors of position, m, attitude, rad, and time, s, and the largest over its standard deviation.
fn errors(simulator: &Simulator, found: &FoundRig) -> ([f64; 3], f64) {
    let truth = simulator.config().camera[0].pose_b_c();
    let pose = found.config.camera[0].pose_b_c();
    let place = pose.translation.vector - truth.translation.vector;
    let turn = (truth.rotation.inverse() * pose.rotation).scaled_axis();
    let late_s = found.config.rig.time_offset_s - OFFSET_S;
    let all: Vec<f64> = place.iter().chain(turn.iter()).copied().chain([late_s]).collect();
    let sigmas = (0..DIM).map(|k| all[k].abs() / found.covariance[(k, k)].sqrt()).fold(0.0, f64::max);
    println!(
        "position {:.2} mm, attitude {:.4} deg, time {:+.3} ms; largest {sigmas:.2} sigmas; {:?}",
        1e3 * place.norm(),
        turn.norm().to_degrees(),
        1e3 * late_s,
        found.table()
    );
    ([place.norm(), turn.norm(), late_s.abs()], sigmas)
}

fn assert_calibrated(simulator: &Simulator, found: &FoundRig) {
    let ([place, attitude, time], sigmas) = errors(simulator, found);
    assert!(place < 3e-3 && attitude < 0.05_f64.to_radians() && time < 0.2e-3);
    // Of normal errors one of seven is beyond in 300 recordings.
    assert!(sigmas < 3.5, "{sigmas} sigmas");
}

#[test]
fn a_rig_that_is_off_by_a_degree_two_centimetres_and_five_milliseconds_is_found_with_its_readout() {
    for readout_s in [0.02, 0.0] {
        let simulator = simulator(FlightPath::HandHeld, 1, 24.0, readout_s);
        let config = believed(&simulator, 1)
            .with("believed", |config| config.camera.iter_mut().for_each(|camera| camera.readout_s = 0.008))
            .unwrap();
        let mut recording = recording(&simulator, &config);
        let (found_s, sigma_s) = recording.find_readout().unwrap();
        assert!((found_s - readout_s).abs() < 1e-3 && sigma_s < 5e-4, "{found_s} {sigma_s}");
        let found = recording.calibrate().unwrap();
        assert_calibrated(&simulator, &found);
        // What comes out is a configuration: the rig, how well it is known, and all else as it was; a global shutter has no readout.
        let written = &found.config;
        assert!(written.camera.iter().all(|camera| camera.readout_s == found_s));
        assert!(readout_s > 0.0 || found_s == 0.0);
        assert!(written.rig.camera_imu_translation_sigma_m < 2e-3 && written.estimator == config.estimator);
        let apart =
            |config: &ValidConfig| config.camera[0].pose_b_c().inverse() * config.camera[1].pose_b_c();
        assert!((apart(written).inverse() * apart(&config)).translation.vector.norm() < 1e-9, "stereo stays");
        assert!(found.table().iter().any(|line| line.contains("time offset")));
    }
}

#[test]
fn a_flight_that_turns_about_one_axis_alone_is_refused_by_what_it_does_not_show() {
    let simulator = simulator(FlightPath::Demo, 1, 24.0, 0.0);
    let refused = recording(&simulator, &believed(&simulator, 1)).calibrate().unwrap_err();
    let words = refused.to_string();
    assert!(
        matches!(refused, RigError::Unseen(_)) && words.contains("the position of the cameras is known to"),
        "{words}"
    );
    // It yaws, about the vertical of the image.
    let axis =
        words.split_once("about axes across (").and_then(|(_, axis)| axis.split_once(") of the left camera"));
    let axis: Vec<f64> = axis.unwrap().0.split(' ').map(|number| number.parse().unwrap()).collect();
    assert!(Vector3::from_column_slice(&axis).normalize().y > 0.8, "{words}");
}

#[test]
fn a_recording_of_a_few_seconds_is_refused() {
    let simulator = simulator(FlightPath::HandHeld, 2, 6.0, 0.0);
    let refused = recording(&simulator, &believed(&simulator, 2)).calibrate().unwrap_err();
    assert!(refused.to_string().contains("record a minute"), "{refused}");
}

/// `FIRST=3 SEEDS=4 SECONDS=60 cargo nextest run --release -p plumbline-checkup rigs_over_seeds --run-ignored all --no-capture`
#[test]
#[ignore = "half a minute of processor a seed"]
fn rigs_over_seeds() {
    let get = |name: &str, or: u64| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(or);
    for seed in get("FIRST", 1)..get("FIRST", 1) + get("SEEDS", 3) {
        let simulator = scaled(FlightPath::HandHeld, seed, get("SECONDS", 60) as f64, 0.0, 0.5);
        let found = recording(&simulator, &believed(&simulator, seed)).calibrate().unwrap();
        print!("seed {seed}: ");
        assert_calibrated(&simulator, &found);
    }
}
