//! Faults of the accelerometer's columns in real and simulated flights, and none where there is none.

use super::*;
use plumbline_config::Config;
use plumbline_drivers::ImuSource as _;
use plumbline_drivers::euroc::read_imu_samples;
use plumbline_simulator::{Scenario, Simulator};

/// Samples of ten real flights; none where these are not there.
fn recorded() -> Vec<(String, Vec<ImuSample>)> {
    let Some(folder) = plumbline_test_support::shared("euroc/imu") else { return Vec::new() };
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files.iter().map(|file| (file.display().to_string(), read_imu_samples(file).unwrap())).collect()
}

/// Samples of the built-in flight in motion, and how the IMU is mounted in it.
fn simulated() -> (Vec<ImuSample>, Option<UnitQuaternion<f64>>) {
    let scenario = Scenario { start_s: 3.0, duration_s: 12.5, resolution_scale: 0.5, ..Scenario::default() };
    let config = Config::preset("sim").unwrap().into_inner();
    let mut imu = Simulator::new(&config, &scenario).unwrap().imu();
    let samples = std::iter::from_fn(|| imu.next_reading().unwrap()).map(|reading| reading.sample);
    (samples.collect(), config.vehicle.rot_v_b())
}

fn changed(samples: &[ImuSample], change: impl Fn(&mut Vector3<f64>)) -> Vec<ImuSample> {
    let mut changed = samples.to_vec();
    changed.iter_mut().for_each(|sample| change(&mut sample.accel));
    changed
}

#[test]
fn recorded_flights_give_no_finding_wherever_they_begin() {
    let mut found = Vec::new();
    for (name, samples) in recorded() {
        for begin in (0..samples.len() - 1300).step_by(1100) {
            for length in [1300, 2600, 6000] {
                let part = &samples[begin..samples.len().min(begin + length)];
                let finding = GravityTurns::of(part).finding(None);
                found.extend(finding.map(|finding| format!("{name} from {begin}, {length} long: {finding}")));
            }
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn swapped_columns_of_a_flight_are_named() {
    let (samples, mounted) = simulated();
    assert_eq!(GravityTurns::of(&samples).finding(mounted), None);
    let swapped = changed(&samples, |accel| accel.swap_rows(0, 1));
    let finding = GravityTurns::of(&swapped).finding(mounted).unwrap().to_string();
    assert!(finding.contains("it delivers y x z"), "{finding}");
}

#[test]
fn a_negated_column_of_real_flights_is_named() {
    let mounted = Config::preset("euroc").unwrap().vehicle.rot_v_b();
    assert!(mounted.is_some());
    let mut told = 0;
    for (name, samples) in recorded() {
        for (axis, words) in [(0, "delivers -x y z"), (2, "delivers x y -z")] {
            let negated = changed(&samples[4000..10_000], |accel| accel[axis] = -accel[axis]);
            let Some(finding) = GravityTurns::of(&negated).finding(mounted) else { continue };
            assert!(finding.to_string().contains(words), "{name}: {finding}");
            told += 1;
        }
    }
    println!("{told} of 20");
    assert!(told >= 16 || plumbline_test_support::shared("euroc/imu").is_none(), "{told}");
}

#[test]
fn an_accelerometer_that_is_negated_altogether_shows_upside_down() {
    let (samples, mounted) = simulated();
    assert_eq!(GravityTurns::of(&samples).upside_down(mounted), None);
    let negated = GravityTurns::of(&changed(&samples, |accel| *accel = -*accel));
    assert_eq!(negated.finding(mounted), None);
    let finding = negated.upside_down(mounted).unwrap().to_string();
    assert!(finding.contains("the accelerometer is negated"), "{finding}");
}

#[test]
fn too_little_turning_is_no_verdict() {
    let still = |k: i64| ImuSample {
        stamp: Timestamp::from_nanos(k * 5_000_000),
        gyro: Vector3::new(0.001, 0.0, 0.002),
        accel: Vector3::new(0.1, 0.0, 9.8),
    };
    let samples: Vec<_> = (0..4000).map(still).collect();
    let turns = GravityTurns::of(&samples);
    assert_eq!((turns.finding(None), turns.judge().verdict), (None, Fitness::NotMeasured));
    if let Some((_, flight)) = recorded().pop() {
        let measure = GravityTurns::of(&flight[4000..10_000]).judge();
        assert_eq!(measure.verdict, Fitness::Good, "{} {}", measure.value, measure.cure);
    }
}
