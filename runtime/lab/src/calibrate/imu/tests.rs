//! Sensors of known noise, simulated at rest.

use super::*;
use nalgebra::Isometry3;
use plumbline_config::{Config, Timestamp};
use plumbline_drivers::tum::write_tum;
use plumbline_drivers::{ImuSource as _, StampedPose};
use plumbline_simulator::{FlightPath, Scenario, Simulator};

/// The sensor of the preset at this rate, at rest for so long.
fn at_rest(seed: u64, duration_s: f64, rate_hz: f64) -> (Vec<ImuSample>, ImuConfig) {
    let mut config = Config::preset("sim").unwrap().into_inner();
    config.imu.rate_hz = rate_hz;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("rest.tum");
    let pose = |k: i64| StampedPose {
        stamp: Timestamp::from_nanos(k * (duration_s * 1e8) as i64),
        pose: Isometry3::new(Vector3::new(1.0, 2.0, 1.0), Vector3::new(0.2, -0.1, 0.7)),
    };
    write_tum(&file, &(0..=11).map(pose).collect::<Vec<_>>()).unwrap();
    let path = FlightPath::Tum(file);
    let scenario = Scenario { path, duration_s, seed, resolution_scale: 0.1, ..Scenario::default() };
    let simulator = Simulator::new(&config, &scenario).unwrap();
    let mut imu = simulator.imu();
    let mut samples = Vec::new();
    while let Some(reading) = imu.next_reading().unwrap() {
        samples.push(reading.sample);
    }
    (samples, config.imu)
}

/// Errors over the truth, and over their standard deviations, of all that was found of a sensor.
fn errors(found: &SensorNoise, density: f64, walk: f64) -> Vec<(f64, f64)> {
    let error = |m: Measured, truth: f64| (m.value / truth - 1.0, (m.value - truth) / m.sigma);
    let axes = found.axes.iter().flatten();
    axes.flat_map(|a| [Some(error(a.density, density)), a.walk.map(|w| error(w, walk))]).flatten().collect()
}

#[test]
fn densities_and_walks_are_those_of_the_simulated_sensor() {
    let mut squares = Vec::new();
    for seed in 1..=4 {
        let (samples, truth) = at_rest(seed, 7200.0, 40.0);
        let found = find(&samples).unwrap();
        assert!((found.rest.length_s - 7200.2).abs() < 0.1, "{:?}", found.rest);
        let [gyro, accel] = &found.sensors;
        for (name, found, truth) in [
            ("gyro_noise_density", gyro.density, truth.gyro_noise_density),
            ("gyro_bias_walk", gyro.walk, truth.gyro_bias_walk),
            ("accel_noise_density", accel.density, truth.accel_noise_density),
            ("accel_bias_walk", accel.walk, truth.accel_bias_walk),
        ] {
            let found = found.unwrap_or_else(|| panic!("seed {seed}: no {name}"));
            println!(
                "seed {seed}: {name} {:+.3}, sigma {:.3}",
                found.value / truth - 1.0,
                found.sigma / truth
            );
            assert!((found.value / truth - 1.0).abs() < 0.15, "seed {seed}: {name} {found:?}, truth {truth}");
        }
        let gyro = errors(gyro, truth.gyro_noise_density, truth.gyro_bias_walk);
        let accel = errors(accel, truth.accel_noise_density, truth.accel_bias_walk);
        for (_, sigmas) in gyro.into_iter().chain(accel) {
            assert!(sigmas.abs() < 4.0, "seed {seed}: {sigmas} sigmas");
            squares.push(sigmas * sigmas);
        }
        assert_eq!(found.remarks(9.81), Vec::<String>::new());
    }
    let mean_square = squares.iter().sum::<f64>() / squares.len() as f64;
    println!("mean square of {} errors over their sigmas: {mean_square:.2}", squares.len());
    assert!((0.4..1.7).contains(&mean_square), "{mean_square}");
}

#[test]
fn a_minute_gives_the_densities_and_says_what_is_missing() {
    let (samples, truth) = at_rest(3, 60.0, 200.0);
    let found = find(&samples).unwrap();
    let mut imu = ImuConfig::with_noise(100.0, (1.0, 0.5), (1.0, 0.5));
    let written = found.write_into(&mut imu, 1.0);
    assert!(!written.contains(&"gyro_bias_walk") && imu.gyro_bias_walk == 0.5, "{written:?}");
    assert!((imu.gyro_noise_density / truth.gyro_noise_density - 1.0).abs() < 0.15);
    assert!((imu.accel_noise_density / truth.accel_noise_density - 1.0).abs() < 0.15);
    assert_eq!(imu.rate_hz, 200.0);
    assert!(found.remarks(9.81).iter().any(|r| r.starts_with("gyroscope") && r.contains("two hours")));
    // The walk is below what is told.
    assert!(found.sensors[0].walk_at_most().unwrap() > truth.gyro_bias_walk);
}

#[test]
fn inflation_is_of_the_white_noise_alone() {
    let (samples, _) = at_rest(1, 600.0, 200.0);
    let found = find(&samples).unwrap();
    let [mut plain, mut inflated] = [(); 2].map(|()| ImuConfig::with_noise(200.0, (1.0, 1.0), (1.0, 1.0)));
    found.write_into(&mut plain, 1.0);
    found.write_into(&mut inflated, 10.0);
    assert!((inflated.accel_noise_density / plain.accel_noise_density - 10.0).abs() < 1e-9);
    assert_eq!(inflated.accel_bias_walk, plain.accel_bias_walk);
}

#[test]
fn the_drone_that_stands_in_the_recorded_clip_stands_for_five_seconds_and_its_rotors_shake_it() {
    let Some(folder) = plumbline_test_support::shared("euroc/V1_01_easy_clip") else { return };
    let found = find(&plumbline_drivers::euroc::read_imu_samples(&folder).unwrap()).unwrap();
    found.table().iter().chain(&found.remarks(9.81)).for_each(|line| println!("{line}"));
    assert!(found.rest.begin_s < 0.1 && (4.0..5.6).contains(&found.rest.length_s), "{:?}", found.rest);
    assert!((found.mean_rate - Vector3::new(-0.002, 0.021, 0.078)).norm() < 2e-3, "{}", found.mean_rate);
    let remarks = found.remarks(9.81);
    for said in [
        "not at rest throughout",
        "shaken",
        "gyroscope: 5 s are too short",
        "accelerometer: 5 s are too short",
    ] {
        assert!(remarks.iter().any(|remark| remark.contains(said)), "{said}: {remarks:?}");
    }
    // Noisier than the data sheet by the rotors, and of its order all the same.
    let densities = found.sensors.each_ref().map(|sensor| sensor.density.unwrap().value);
    assert!((1.7e-4..2e-2).contains(&densities[0]) && (2e-3..2e-1).contains(&densities[1]), "{densities:?}");
}
