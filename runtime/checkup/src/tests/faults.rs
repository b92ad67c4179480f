//! Faults of stamps, samples and images alone.

use super::{ALL, FEW, assert_found, flight, is_fit, lively, measure, told};
use crate::Fitness;
use crate::plausibility::{Plausibility, UNITS_AND_COLUMNS};
use crate::timing::Sensor;
use plumbline_config::Timestamp;
use plumbline_config::options::VehicleConfig;
use plumbline_estimator::HealthBits;

#[test]
fn a_stuck_axis_is_named() {
    let mut stuck = flight(ALL);
    let held = stuck.samples[700].1.gyro.y;
    stuck.samples[700..].iter_mut().for_each(|(_, sample)| sample.gyro.y = held);
    assert_found(&stuck.report(), "flight", Fitness::NotFit, "the gyroscope repeats its readings");
}

#[test]
fn samples_at_the_end_of_the_range_are_counted() {
    let mut cut = flight(ALL);
    cut.config.imu.accel_range_m_s2 = 30.0;
    cut.samples.iter_mut().step_by(20).for_each(|(_, sample)| sample.accel.z = 30.0);
    assert_found(&cut.report(), "flight", Fitness::NotFit, "larger range");
}

#[test]
fn black_images_are_told() {
    let black = flight(FEW).with(|data| {
        let images = data.frames.iter_mut().flat_map(|(_, _, images)| images);
        images.flat_map(|image| image.pixels_mut()).for_each(|grey| *grey /= 12);
    });
    assert_found(&black.report(), "black images", Fitness::NotFit, "light, exposure");
}

/// Frames whose intervals vary, as those of a camera that exposes by the light do, and that are not the configured ones.
#[test]
fn a_varying_frame_rate_is_a_line_and_everything_else_is_judged() {
    let varying = super::fitted::by_hand().with(|data| {
        let mut count = 0;
        data.frames.retain(|_| {
            count += 1;
            count % 5 != 0 && count % 7 != 0
        });
        (0..).zip(&mut data.frames).for_each(|(number, frame)| frame.0 = number);
    });
    let report = varying.report();
    let timing = measure(&report, "camera timing");
    assert!(timing.verdict == Fitness::Mind && timing.cure.contains("camera.0.rate_hz"), "{}", told(&report));
    assert_ne!(measure(&report, "focal length").verdict, Fitness::NotMeasured, "{}", told(&report));
    assert!(is_fit(&report), "{}", told(&report));
}

#[test]
fn lost_samples_another_rate_and_stamps_that_run_backwards_are_told() {
    let mut lossy = flight(0);
    let mut count = 0;
    lossy.samples.retain(|_| {
        count += 1;
        count % 20 != 0
    });
    assert_found(&lossy.report(), "IMU timing", Fitness::NotFit, "lose samples");

    let mut slow = flight(0);
    slow.config.imu.rate_hz = 400.0;
    assert_found(&slow.report(), "IMU timing", Fitness::NotFit, "imu.rate_hz");

    let mut back = flight(0);
    back.samples.swap(500, 501);
    assert_found(&back.report(), "IMU timing", Fitness::NotFit, "backwards");
    assert_found(&back.report(), "camera timing", Fitness::NotFit, "0 samples arrived");
}

#[test]
fn gravity_in_g_and_a_wrong_mounting_are_told() {
    let mut scaled = flight(0);
    scaled.samples.iter_mut().for_each(|(_, sample)| sample.accel /= 9.806_65);
    let report = scaled.report();
    assert_found(&report, UNITS_AND_COLUMNS, Fitness::NotFit, "9.80665");
    assert_eq!(measure(&report, "mounting").verdict, Fitness::NotMeasured, "{}", told(&report));

    let mut turned = flight(0);
    turned.config.vehicle = VehicleConfig::mounted([0.0, 0.0, 0.0]);
    assert_found(&turned.report(), "mounting", Fitness::NotFit, "imu_to_vehicle_deg");
}

#[test]
fn stamps_in_microseconds_are_named_by_their_unit() {
    let micros = flight(0).with(|data| {
        for (_, sample) in &mut data.samples {
            sample.stamp = Timestamp::from_nanos(sample.stamp.as_nanos() / 1000);
        }
    });
    assert_found(&micros.report(), "IMU timing", Fitness::NotFit, "microseconds; write them in nanoseconds");
}

#[test]
fn a_gyroscope_in_degrees_is_named_though_the_driver_drops_its_fastest_samples() {
    let Some(lively) = lively() else { return };
    let mut refused = 0;
    let degrees = lively.with(|data| {
        data.samples.iter_mut().for_each(|(_, sample)| sample.gyro *= 180.0 / std::f64::consts::PI);
        data.samples.retain(|(_, sample)| {
            let is_kept = sample.gyro.amax() <= 1.5 * data.config.imu.gyro_range_rad_s;
            refused += u64::from(!is_kept);
            is_kept
        });
    });
    assert!(refused > 100, "{refused}");
    let mut checkup = degrees.checkup();
    checkup.arrivals(Sensor::Imu).refused = refused;
    let report = checkup.report();
    assert_found(&report, UNITS_AND_COLUMNS, Fitness::NotFit, "degrees a second; multiply it by pi/180");
    let timing = measure(&report, "IMU timing");
    assert_eq!(timing.figures["missing"], 0.0, "{}", told(&report));
    assert!(timing.value.contains(&format!("{refused} refused")), "{}", told(&report));
    assert_eq!(measure(&report, "mounting").verdict, Fitness::NotMeasured, "{}", told(&report));
    // Without images the unit is one of two causes.
    let mut blind = degrees.with(|data| data.frames.clear()).checkup();
    blind.arrivals(Sensor::Imu).refused = refused;
    assert_found(&blind.report(), UNITS_AND_COLUMNS, Fitness::NotFit, "degrees a second");
}

#[test]
fn what_drivers_report_of_sensors_is_the_verdict_and_its_consequences_are_not_judged() {
    let data = flight(FEW);
    let mut checkup = data.checkup();
    checkup.arrivals(Sensor::Cameras).trouble =
        Some("/run/frames: stamps such as 7 are in milliseconds".into());
    let report = checkup.report();
    assert_found(&report, "camera timing", Fitness::NotFit, "stamps such as 7 are in milliseconds");
    assert_eq!(measure(&report, "time offset").cure, crate::NAMED_ABOVE.1, "{}", told(&report));

    let mut without = data.with(|data| data.samples.clear()).checkup();
    without.arrivals(Sensor::Imu).trouble =
        Some("the IMU is missing (No such file or directory); waiting for it".into());
    let report = without.report();
    assert_found(&report, "IMU timing", Fitness::NotFit, "No such file");
    for name in ["time offset", "focal length"] {
        assert_eq!(measure(&report, name).cure, crate::NAMED_ABOVE.1, "{name}: {}", told(&report));
    }
}

#[test]
fn a_flight_warns_of_a_mounting_that_gravity_contradicts_in_the_words_of_the_checkup() {
    let turned = flight(0).with(|data| data.config.vehicle = VehicleConfig::mounted([0.0, 0.0, 0.0]));
    let mut flying = Plausibility::new(&turned.config, false);
    turned.samples.iter().for_each(|(number, sample)| flying.add_sample(*number, sample));
    let said = measure(&turned.report(), "mounting").clone();
    let findings = flying.findings(false);
    assert!(
        findings.iter().any(|finding| finding.evidence == said.value && finding.cure == said.cure),
        "{said:?}: {findings:#?}"
    );
}

#[test]
fn a_negated_accelerometer_is_named_at_rest_and_in_motion() {
    let negated =
        flight(0).with(|data| data.samples.iter_mut().for_each(|(_, sample)| sample.accel = -sample.accel));
    assert_found(&negated.report(), "mounting", Fitness::NotFit, "the accelerometer is negated");
    let negated = super::simulated(super::FlightPath::Demo, 3.0, 6.0, 0)
        .with(|data| data.samples.iter_mut().for_each(|(_, sample)| sample.accel = -sample.accel));
    let mut flying = Plausibility::new(&negated.config, false);
    negated.samples.iter().for_each(|(number, sample)| flying.add_sample(*number, sample));
    let findings = flying.findings(false);
    assert!(
        findings.iter().any(|finding| finding.cause.contains("the accelerometer is negated")),
        "{findings:#?}"
    );
}

#[test]
fn what_a_flight_contradicts_is_not_fit_and_its_cure_is_no_circle() {
    let mut flown = Plausibility::new(&flight(0).config, false);
    (0..100).for_each(|k| flown.add_estimate(HealthBits(HealthBits::ROTATION_DISPUTED.0 * (k % 2))));
    flown.add_reset("frame 60: no frame for 2.0 s", "look at cables");
    let measures = flown.contradicted();
    assert!(measures.iter().all(|measure| measure.verdict == Fitness::NotFit), "{}", told(&measures));
    assert!(!told(&measures).contains("plumbline doctor"), "{}", told(&measures));
    let titles: Vec<String> = measures.iter().map(|measure| measure.title()).collect();
    assert_eq!(
        titles,
        [
            "flight: the estimate was discarded (frame 60: no frame for 2.0 s)",
            "flight: gyroscope and images disagree on how the vehicle turns"
        ]
    );
}
