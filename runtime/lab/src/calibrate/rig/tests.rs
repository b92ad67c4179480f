//! Rigs whose calibration is off, moved by hand in the simulator.

use super::*;
use nalgebra::{Isometry3, UnitQuaternion};
use plumbline_config::Config;
use plumbline_drivers::{DriverError, Faults, StereoFrame, StereoSource};
use plumbline_simulator::{Effects, FlightPath, Scenario, Scene, Simulator, scaled_config};
use std::sync::Arc;

/// A recording in memory: rendered once, flown in every pass.
struct Recording {
    simulator: Simulator,
    frames: Arc<Vec<StereoFrame>>,
}

struct Frames {
    frames: Arc<Vec<StereoFrame>>,
    next: usize,
}

impl StereoSource for Frames {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        let Some(next) = self.frames.get(self.next) else { return Ok(false) };
        frame.clone_from(next);
        self.next += 1;
        Ok(true)
    }

    fn expected_frames(&self) -> Option<u64> {
        Some(self.frames.len() as u64)
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }
}

/// Time offset of the simulated cameras, s.
const OFFSET_S: f64 = 0.004;

impl Recording {
    fn new(scenario: &Scenario) -> Self {
        let simulator = Simulator::new(&Config::preset("sim").unwrap(), scenario).unwrap();
        let mut source = simulator.stereo();
        let mut frame = StereoFrame::new(simulator.image_sizes());
        let mut frames = Vec::new();
        while source.next_frame(&mut frame).unwrap() {
            frames.push(frame.clone());
        }
        Self { simulator, frames: Arc::new(frames) }
    }

    /// The rig as it is.
    fn truth(&self) -> Rig {
        let config = self.simulator.config().clone().validated("truth").unwrap();
        let time_offset_s = self.simulator.scenario().effects.time_offset_s;
        Rig { time_offset_s, ..Rig::of(config.setup()) }
    }

    /// The rig as it is believed: turned by a degree, moved by two centimetres, 5 ms late.
    fn believed(&self, seed: u64) -> ValidConfig {
        let angle = 2.4 * seed as f64;
        let axis = Vector3::new(angle.cos(), (1.7 * angle).sin(), 0.5).normalize();
        let away = Vector3::new((3.1 * angle).sin(), 0.4, angle.sin()).normalize() * 0.02;
        let error =
            Isometry3::from_parts(away.into(), UnitQuaternion::from_scaled_axis(axis * 1.0_f64.to_radians()));
        let truth = self.truth();
        let mut config = scaled_config(self.simulator.config(), 1.0);
        let scale = self.simulator.scenario().resolution_scale;
        let points = &mut config.estimator.points;
        points.cell_px = ((points.cell_px as f64 * scale) as usize).max(28);
        for (k, camera) in config.camera.iter_mut().enumerate() {
            // In the axes of the body, for both cameras.
            let pose = truth.pose_b_c(k);
            let rotation = error.rotation * pose.rotation;
            let place = pose.translation.vector + error.translation.vector;
            camera.pose_b_c = rows_from_isometry(&Isometry3::from_parts(place.into(), rotation));
        }
        config.rig.time_offset_s = truth.time_offset_s + if seed.is_multiple_of(2) { 0.005 } else { -0.005 };
        config.validated("believed").unwrap()
    }

    fn calibrate(&self, config: &ValidConfig, options: &RigOptions) -> Result<FoundRig, RigError> {
        let mut open = |config: &ValidConfig| {
            let frames = Frames { frames: Arc::clone(&self.frames), next: 0 };
            let imu = Box::new(self.simulator.imu());
            Ok(Flight::new(config.clone(), imu, Box::new(frames), "by hand".into()))
        };
        calibrate(config, options, &mut open, &mut |_, _| ())
    }
}

fn scenario(seed: u64, duration_s: f64, resolution_scale: f64) -> Scenario {
    Scenario {
        scene: Scene::Room,
        path: FlightPath::HandHeld,
        duration_s,
        seed,
        resolution_scale,
        effects: Effects { time_offset_s: OFFSET_S, ..Effects::default() },
        ..Scenario::default()
    }
}

/// Errors over the truth: place, m, attitude, rad, time, s; and the largest over its standard deviation.
fn errors(recording: &Recording, found: &FoundRig) -> ([f64; 3], f64) {
    let error = step_between(&recording.truth(), &found.rig);
    let sigmas = (0..DIM).map(|k| error[k].abs() / found.covariance[(k, k)].sqrt()).fold(0.0, f64::max);
    println!(
        "place {:.2} mm, attitude {:.4} deg, time {:+.3} ms; largest {sigmas:.2} sigmas of {:?}; growth {:.1?}, {} pieces, {} passes",
        1e3 * error.fixed_rows::<3>(0).norm(),
        error.fixed_rows::<3>(3).norm().to_degrees(),
        1e3 * error[6],
        (0..DIM).map(|k| format!("{:.1e}", found.covariance[(k, k)].sqrt())).collect::<Vec<_>>(),
        found.growth,
        found.pieces,
        found.passes
    );
    ([error.fixed_rows::<3>(0).norm(), error.fixed_rows::<3>(3).norm(), error[6].abs()], sigmas)
}

fn assert_calibrated(recording: &Recording, found: &FoundRig) {
    let ([place, attitude, time], sigmas) = errors(recording, found);
    assert!(place < 3e-3 && attitude < 0.05_f64.to_radians() && time < 0.2e-3);
    assert!(sigmas < 3.0, "{sigmas} sigmas");
}

#[test]
fn a_rig_that_is_off_by_a_degree_two_centimetres_and_five_milliseconds_is_found() {
    let recording = Recording::new(&scenario(1, 27.0, 0.35));
    let config = recording.believed(1);
    let found = recording.calibrate(&config, &RigOptions::default()).unwrap();
    assert_calibrated(&recording, &found);
    // What comes out is a configuration: the rig, how well it is known, and all else as it was.
    let written = &found.config;
    assert!((Rig::of(written.setup()).minus(&found.rig)).norm() < 1e-9);
    assert!(written.rig.camera_imu_translation_sigma_m < 2e-3 && written.estimator == config.estimator);
    let apart = |config: &ValidConfig| Rig::of(config.setup()).pose_c0_c1;
    assert!((apart(written).inverse() * apart(&config)).translation.vector.norm() < 1e-9, "stereo stays");
    assert!(found.table().iter().any(|line| line.contains("time offset")));
}

/// The readout that is found, where it is believed to be 8 ms, and its standard deviation, ms.
fn readout_found(truth_s: f64) -> (f64, f64) {
    let mut shot = scenario(1, 27.0, 0.35);
    shot.effects.readout_s = truth_s;
    let recording = Recording::new(&shot);
    let believed = readout::with_readout(&recording.believed(1), 0.008).unwrap();
    let options = RigOptions { finds_readout: true, ..RigOptions::default() };
    let found = recording.calibrate(&believed, &options).unwrap();
    found.table().iter().for_each(|line| println!("{line}"));
    let readout = found.readout.unwrap();
    assert!(found.config.camera.iter().all(|camera| camera.readout_s == readout.readout_s));
    (1e3 * readout.readout_s, 1e3 * readout.sigma_s)
}

#[test]
fn the_readout_of_a_rolling_shutter_is_found() {
    let (readout_ms, sigma_ms) = readout_found(0.02);
    assert!((readout_ms - 20.0).abs() < 1.0 && sigma_ms < 0.5, "{readout_ms} ms, {sigma_ms}");
}

#[test]
fn a_global_shutter_is_found_to_be_one() {
    assert_eq!(readout_found(0.0).0, 0.0);
}

#[test]
fn a_flight_that_turns_about_one_axis_alone_is_refused_by_the_axes_that_are_missing() {
    let flight = Scenario { path: FlightPath::Demo, ..scenario(1, 20.0, 0.3) };
    let simulator = Simulator::new(&Config::preset("sim").unwrap(), &flight).unwrap();
    let recording = Recording { simulator, frames: Arc::default() };
    let refused =
        recording.calibrate(&recording.believed(1), &RigOptions::default()).unwrap_err().to_string();
    assert!(matches!(refused.as_str(), text if text.contains("it lacks rotation about")), "{refused}");
    assert!(refused.contains("rolling") && refused.contains("nodding"), "{refused}");
}

#[test]
fn a_recording_of_a_few_seconds_is_refused() {
    let recording = Recording::new(&scenario(2, 6.0, 0.3));
    let refused = recording.calibrate(&recording.believed(2), &RigOptions::default()).unwrap_err();
    assert!(refused.to_string().contains("record a minute"));
}

/// `SEEDS=6 SECONDS=60 SCALE=0.5 cargo nextest run ... rigs_over_seeds --run-ignored all --no-capture`
#[test]
#[ignore = "a minute of processor a seed"]
fn rigs_over_seeds() {
    let get = |name: &str, or: f64| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(or);
    let first = get("FIRST", 1.0) as u64;
    for seed in first..first + get("SEEDS", 3.0) as u64 {
        let recording = Recording::new(&scenario(seed, get("SECONDS", 60.0), get("SCALE", 0.5)));
        let found = recording.calibrate(&recording.believed(seed), &RigOptions::default()).unwrap();
        print!("seed {seed}: ");
        assert_calibrated(&recording, &found);
    }
}
