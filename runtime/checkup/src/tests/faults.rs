use super::{ALL, FEW, assert_found, flight, lively, measure, simulated, told};
use crate::plausibility::{Glimpse, Plausibility, UNITS_AND_COLUMNS};
use crate::timing::Sensor;
use crate::{Checkup, Fitness};
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::Timestamp;
use plumbline_config::options::{CameraConfig, VehicleConfig, image_sizes, rows_from_isometry};
use plumbline_simulator::FlightPath;
use std::f64::consts::TAU;

#[test]
fn a_healthy_flight_is_fit_and_every_measure_is_good_or_not_in_the_data() {
    let report = flight(ALL).report();
    println!("{}", told(&report));
    assert!(report.is_fit() && report.count(Fitness::Mind) == 0, "{}", told(&report));
    // What this flight does not hold: an exposure, and turns about several axes.
    let missing: Vec<_> = report.measures.iter().filter(|m| m.verdict == Fitness::NotMeasured).collect();
    assert!(missing.iter().all(|m| {
        let absent = ["blur", "mounting heading", "camera-IMU rotation", "time offset", "focal length"];
        absent.contains(&m.name)
            || ["accelerometer axes", "scale", crate::inertial::UNMOVED_NAME].contains(&m.name)
    }));
}

#[test]
fn a_healthy_lively_flight_tells_time_offset_and_rotation_too() {
    let Some(lively) = lively() else { return };
    let report = lively.report();
    println!("{}", told(&report));
    assert!(report.is_fit() && report.count(Fitness::Mind) == 0, "{}", told(&report));
    let offset = measure(&report, "time offset");
    let rotation = measure(&report, "camera-IMU rotation");
    assert_eq!((offset.verdict, rotation.verdict), (Fitness::Good, Fitness::Good), "{}", told(&report));
    for (measure, off, sigma) in [(offset, "off_ms", "sigma_ms"), (rotation, "off_deg", "sigma_deg")] {
        let (off, sigma) = (measure.figure(off).unwrap(), measure.figure(sigma).unwrap());
        assert!(off < 3.0 * sigma, "{}: {off} and sigma {sigma}", measure.name);
    }
}

#[test]
fn swapped_cameras_are_told() {
    let swapped =
        flight(FEW).with(|data| data.frames.iter_mut().for_each(|(_, _, images)| images.swap(0, 1)));
    let report = swapped.report();
    assert_found(&report, "epipolar error", Fitness::NotFit, "swapped");
}

/// Turns a camera in the body.
fn turn(camera: &mut CameraConfig, axis_b: Vector3<f64>, degrees: f64, about_itself: bool) {
    let mut pose = camera.pose_b_c();
    let turn = UnitQuaternion::from_scaled_axis(axis_b * degrees.to_radians());
    if about_itself {
        pose.rotation *= turn;
    } else {
        pose = nalgebra::Isometry3::from_parts(nalgebra::Translation3::identity(), turn) * pose;
    }
    camera.pose_b_c = rows_from_isometry(&pose);
}

#[test]
fn a_degree_between_the_cameras_is_told_with_its_size() {
    let report = flight(FEW).with(|data| turn(&mut data.config.camera[1], Vector3::x(), 1.0, true)).report();
    assert_found(&report, "epipolar error", Fitness::NotFit, "calibrate the pair");
    let pixels = measure(&report, "epipolar error").figure("median_px").unwrap();
    let expected = flight(0).config.camera[0].focal_px[1] * 1_f64.to_radians().tan();
    // Aside from the centre it is more, by the square of the distance.
    assert!((1.0..1.15).contains(&(pixels / expected)), "{pixels} px for {expected}");
}

#[test]
fn a_degree_between_cameras_and_imu_is_told_with_its_size() {
    let Some(lively) = lively() else { return };
    let axis = Vector3::new(1.0, -1.0, 1.0).normalize();
    let turned =
        lively.with(|data| data.config.camera.iter_mut().for_each(|camera| turn(camera, axis, 1.0, false)));
    let report = turned.report();
    assert_found(&report, "camera-IMU rotation", Fitness::Mind, "turned");
    let degrees = measure(&report, "camera-IMU rotation").figure("off_deg").unwrap();
    assert!((degrees - 1.0).abs() < 0.3, "{degrees}: {}", told(&report));
    // The pair is as it was.
    assert_eq!(measure(&report, "epipolar error").verdict, Fitness::Good);
}

#[test]
fn twenty_milliseconds_between_the_clocks_are_told_to_the_millisecond() {
    let Some(lively) = lively() else { return };
    let shifted = lively.with(|data| {
        data.frames.iter_mut().for_each(|(_, stamp, _)| *stamp = stamp.plus_seconds(0.02));
    });
    let report = shifted.report();
    assert_found(&report, "time offset", Fitness::NotFit, "rig.time_offset_s");
    let offset_ms = measure(&report, "time offset").figure("offset_ms").unwrap();
    assert!((offset_ms + 20.0).abs() < 1.0, "{offset_ms}");
}

#[test]
fn axes_of_another_assignment_explain_nothing() {
    let Some(lively) = lively() else { return };
    let turned = lively.with(|data| {
        data.samples.iter_mut().for_each(|(_, sample)| {
            sample.gyro = nalgebra::Vector3::new(sample.gyro.y, sample.gyro.z, sample.gyro.x)
        });
    });
    let report = turned.report();
    assert_found(&report, UNITS_AND_COLUMNS, Fitness::NotFit, "columns of the gyroscope are swapped");
    let rotation = measure(&report, "camera-IMU rotation");
    assert_eq!(rotation.verdict, Fitness::NotMeasured, "{}", told(&report));
    assert!(rotation.cure.contains("problems above"), "{}", told(&report));
}

#[test]
fn cameras_turned_by_a_right_angle_are_named_and_no_sensor_is() {
    let Some(lively) = lively() else { return };
    for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
        let turned = lively
            .with(|data| data.config.camera.iter_mut().for_each(|camera| turn(camera, axis, 90.0, false)));
        let report = turned.report();
        assert_found(&report, UNITS_AND_COLUMNS, Fitness::NotFit, "turn about different axes");
        assert_eq!(measure(&report, "IMU axes").verdict, Fitness::Good, "{}", told(&report));
    }
}

#[test]
fn a_rotor_at_180_hz_is_named_though_it_is_sampled_as_20() {
    let mut shaken = flight(0);
    let begin = shaken.samples[0].1.stamp;
    for (_, sample) in &mut shaken.samples {
        let wave = (TAU * 180.0 * sample.stamp.seconds_since(begin)).sin();
        sample.accel += Vector3::new(2.0, 1.0, 3.0) * wave;
    }
    let report = shaken.report();
    assert_found(&report, "vibration of the accelerometer", Fitness::NotFit, "180");
    let found = measure(&report, "vibration of the accelerometer");
    let (hz, rms) = (found.figure("line_hz").unwrap(), found.figure("line_rms").unwrap());
    assert!((hz - 20.0).abs() < 1.0, "{hz}");
    let expected = 14_f64.sqrt() / 2_f64.sqrt();
    assert!((rms / expected - 1.0).abs() < 0.05, "{rms} m/s² for {expected}");
    assert_eq!(measure(&report, "vibration of the gyroscope").verdict, Fitness::Good);
}

#[test]
fn a_line_beside_half_the_rate_is_said_to_be_there() {
    let mut shaken = flight(0);
    let begin = shaken.samples[0].1.stamp;
    for (_, sample) in &mut shaken.samples {
        sample.gyro.x += 0.2 * (TAU * 104.0 * sample.stamp.seconds_since(begin)).sin();
    }
    assert_found(&shaken.report(), "vibration of the gyroscope", Fitness::NotFit, "near half the rate");
}

/// Adds a pulse to the readings, s after the first sample.
fn pulse(from_s: f64, lasts_s: f64, accel: Vector3<f64>, gyro: Vector3<f64>) -> impl Fn(&mut super::Data) {
    move |data| {
        let begin = data.samples[0].1.stamp;
        for (_, sample) in &mut data.samples {
            if (from_s..from_s + lasts_s).contains(&sample.stamp.seconds_since(begin)) {
                sample.accel += accel;
                sample.gyro += gyro;
            }
        }
    }
}

#[test]
fn a_blow_changes_neither_the_noise_nor_the_scale_and_is_named() {
    let hand_held = super::simulated(FlightPath::HandHeld, 0.0, 12.0, ALL);
    let sound = hand_held.report();
    let vibration = "vibration of the accelerometer";
    for (accel, from_s, lasts_s, is_told) in [
        (Vector3::new(30.0, 0.0, 0.0), 5.0, 0.1, true),
        (Vector3::new(0.0, -60.0, 0.0), 7.0, 0.3, true),
        (Vector3::new(0.0, 0.0, 200.0), 9.0, 0.02, true),
        (Vector3::new(5.0, 0.0, 0.0), 4.8, 1.0, true),
    ] {
        let report = hand_held.with(pulse(from_s, lasts_s, accel, Vector3::zeros())).report();
        println!("{accel:?}\n{}", told(&report));
        let figure =
            |report: &crate::CheckupReport, name, figure| measure(report, name).figure(figure).unwrap();
        for (name, of, tolerance) in
            [(vibration, "times_configured", 0.1), (crate::scale::NAME, "factor", 0.03)]
        {
            assert_eq!(measure(&report, name).verdict, measure(&sound, name).verdict, "{}", told(&report));
            let ratio = figure(&report, name, of) / figure(&sound, name, of);
            assert!((ratio - 1.0).abs() < tolerance, "{name}: {ratio}");
        }
        let value = &measure(&report, vibration).value;
        assert_eq!(value.contains("without a blow of"), is_told, "{value}");
        assert!(
            measure(&report, crate::scale::NAME).value.contains("contradict each other"),
            "{}",
            told(&report)
        );
    }
    assert!(!told(&sound).contains("blow"), "{}", told(&sound));
    let turned = hand_held.with(pulse(5.0, 0.1, Vector3::zeros(), Vector3::new(0.0, 3.0, 0.0))).report();
    assert_found(&turned, "vibration of the gyroscope", Fitness::NotMeasured, "without a blow of");
    assert!(turned.is_fit(), "{}", told(&turned));
}

#[test]
fn axes_that_hardly_move_are_not_measured() {
    let report = flight(0).report();
    let unmoved = measure(&report, crate::inertial::UNMOVED_NAME);
    assert_eq!(unmoved.verdict, Fitness::NotMeasured);
    assert!(unmoved.value.contains("gyroscope x y z"), "{}", told(&report));
    assert!(measure(&report, "IMU axes").value.starts_with("none repeats its value"), "{}", told(&report));
    let hand = super::simulated(FlightPath::HandHeld, 0.0, 12.0, 0).report();
    assert!(hand.measure(crate::inertial::UNMOVED_NAME).is_none(), "{}", told(&hand));
    assert!(measure(&hand, "IMU axes").value.starts_with("all six live"), "{}", told(&hand));
}

#[test]
fn a_stuck_axis_is_named() {
    let mut stuck = flight(0);
    let held = stuck.samples[700].1.gyro.y;
    stuck.samples[700..].iter_mut().for_each(|(_, sample)| sample.gyro.y = held);
    assert_found(&stuck.report(), "IMU axes", Fitness::NotFit, "gyroscope y repeats");
}

#[test]
fn samples_at_the_end_of_the_range_are_counted() {
    let mut cut = flight(0);
    cut.config.imu.accel_range_m_s2 = 30.0;
    cut.samples.iter_mut().step_by(20).for_each(|(_, sample)| sample.accel.z = 30.0);
    assert_found(&cut.report(), "IMU axes", Fitness::NotFit, "larger range");
}

#[test]
fn dark_and_burnt_out_images_are_told() {
    let seen = flight(FEW);
    let scaled = |factor: f64| {
        seen.with(|data| {
            for (_, _, images) in &mut data.frames {
                let pixels = images.iter_mut().flat_map(|image| image.pixels_mut());
                pixels.for_each(|grey| *grey = (f64::from(*grey) * factor).min(255.0) as u8);
            }
        })
    };
    assert_found(&scaled(0.08).report(), "exposure", Fitness::NotFit, "dark");
    assert_found(&scaled(6.0).report(), "exposure", Fitness::Mind, "burnt out");
}

#[test]
fn a_long_exposure_is_told_with_what_is_allowed() {
    let mut long = flight(0);
    long.config.driver.v4l2.exposure_us = 30_000.0;
    let report = long.report();
    assert_found(&report, "blur", Fitness::Mind, "expose for at most");
    let blur = measure(&report, "blur");
    let allowed_ms = blur.figure("allowed_exposure_ms").unwrap();
    long.config.driver.v4l2.exposure_us = 990.0 * allowed_ms;
    assert_eq!(measure(&long.report(), "blur").verdict, Fitness::Good);
    // What the driver tells counts.
    let mut checkup = Checkup::new(&long.config);
    long.samples.iter().for_each(|(sequence, sample)| checkup.add_sample(*sequence, sample));
    checkup.tell_exposure(0.03);
    assert_found(&checkup.report(), "blur", Fitness::Mind, "expose for at most");
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
fn gravity_in_g_a_wrong_mounting_and_a_large_bias_are_told() {
    let mut scaled = flight(0);
    scaled.samples.iter_mut().for_each(|(_, sample)| sample.accel /= 9.806_65);
    let report = scaled.report();
    assert_found(&report, UNITS_AND_COLUMNS, Fitness::NotFit, "9.80665");
    assert_eq!(measure(&report, "gravity").verdict, Fitness::NotMeasured, "{}", told(&report));

    let mut turned = flight(0);
    turned.config.vehicle = VehicleConfig::mounted([0.0, 0.0, 0.0]);
    assert_found(&turned.report(), "mounting", Fitness::NotFit, "imu_to_vehicle_deg");

    let mut biased = flight(0);
    biased.samples.iter_mut().for_each(|(_, sample)| sample.gyro.z += 0.4);
    assert_found(&biased.report(), "gyroscope bias", Fitness::NotFit, "calibrate its gyroscope");
}

#[test]
fn what_the_data_do_not_hold_is_no_verdict() {
    let mut flying = flight(ALL);
    let begin = flying.samples[0].1.stamp;
    flying.samples.retain(|(_, sample)| sample.stamp.seconds_since(begin) > 3.0);
    flying.frames.retain(|(_, stamp, _)| stamp.seconds_since(begin) > 3.0);
    let report = flying.report();
    for name in ["gravity", "mounting", "gyroscope bias"] {
        assert_eq!(measure(&report, name).verdict, Fitness::NotMeasured, "{}", told(&report));
    }
    assert!(report.is_fit(), "{}", told(&report));
}

#[test]
fn what_a_flight_warns_of_is_said_by_the_checkup_in_the_same_words_and_its_consequences_are_not() {
    let degrees = flight(ALL).with(|data| {
        data.samples.iter_mut().for_each(|(_, sample)| sample.gyro *= 180.0 / std::f64::consts::PI);
    });
    let exchanged = flight(0).with(|data| {
        data.samples.iter_mut().for_each(|(_, sample)| std::mem::swap(&mut sample.gyro, &mut sample.accel));
    });
    for (data, words) in
        [(&degrees, "multiply it by pi/180"), (&exchanged, "write the columns as gyroscope x y z")]
    {
        let report = data.report();
        assert_found(&report, UNITS_AND_COLUMNS, Fitness::NotFit, words);
        let mut flight = Plausibility::new(&data.config, false);
        let sizes = image_sizes(&data.config.camera);
        for (_, sample) in &data.samples {
            flight.add_sample(sample);
        }
        for (_, stamp, images) in &data.frames {
            let mut glimpse = Glimpse::new(sizes);
            (glimpse.stamp, glimpse.valid) = (*stamp, [true; 2]);
            for (thumbnail, image) in glimpse.images.iter_mut().zip(images) {
                thumbnail.take(image);
            }
            flight.add_frame(&glimpse);
        }
        let findings = flight.findings();
        let said = measure(&report, UNITS_AND_COLUMNS);
        assert!(findings.iter().any(|finding| finding.advice() == said.cure), "{findings:#?}");
        let not_fit: Vec<_> = report.measures.iter().filter(|m| m.verdict == Fitness::NotFit).collect();
        let consequences =
            ["IMU axes", "gyroscope bias", "vibration of the gyroscope", "gravity", "mounting"];
        assert!(not_fit.iter().all(|m| !consequences.contains(&m.name)), "{}", told(&report));
    }
}

#[test]
fn one_camera_leaves_what_needs_two_open_and_says_so() {
    let one = flight(FEW).with(|data| data.config.camera.truncate(1));
    let report = one.report();
    for name in ["epipolar error", "time offset", "camera-IMU rotation", "focal length"] {
        assert_eq!(measure(&report, name).verdict, Fitness::NotMeasured, "{}", told(&report));
        assert!(report.open().contains(&name));
    }
}

#[test]
fn a_tenth_of_burnt_out_pixels_is_not_good() {
    let burnt = flight(FEW).with(|data| {
        for (_, _, images) in &mut data.frames {
            for image in images {
                let rows = image.height() * 11 / 100;
                let count = rows * image.width();
                image.pixels_mut()[..count].fill(255);
            }
        }
    });
    assert_found(&burnt.report(), "exposure", Fitness::Mind, "burnt out");
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
fn units_and_columns_are_named_before_their_consequences() {
    let in_g = flight(0).with(|data| data.samples.iter_mut().for_each(|(_, sample)| sample.accel /= 9.80665));
    let report = in_g.report();
    assert_found(&report, "units and columns", Fitness::NotFit, "in units of gravity");
    let exchanged = flight(0).with(|data| {
        data.samples.iter_mut().for_each(|(_, sample)| std::mem::swap(&mut sample.gyro, &mut sample.accel));
    });
    let report = exchanged.report();
    assert_found(
        &report,
        "units and columns",
        Fitness::NotFit,
        "columns of gyroscope and accelerometer are swapped",
    );
    assert_eq!(report.measures[0].name, "units and columns");
    assert!(flight(0).report().measure("units and columns").is_none());
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
    checkup.tell_refused(refused);
    let report = checkup.report();
    assert_found(&report, UNITS_AND_COLUMNS, Fitness::NotFit, "degrees a second; multiply it by pi/180");
    let timing = measure(&report, "IMU timing");
    assert_eq!(timing.figure("missing"), Some(0.0), "{}", told(&report));
    assert!(timing.value.contains(&format!("{refused} refused")), "{}", told(&report));
    for name in ["IMU axes", "vibration of the gyroscope", "gravity"] {
        assert_eq!(measure(&report, name).verdict, Fitness::NotMeasured, "{}", told(&report));
    }
    // Without images the unit is one of two causes.
    let mut blind = degrees.with(|data| data.frames.clear()).checkup();
    blind.tell_refused(refused);
    assert_found(&blind.report(), UNITS_AND_COLUMNS, Fitness::NotFit, "degrees a second");
}

#[test]
fn what_drivers_report_of_sensors_is_the_verdict_and_its_consequences_are_not_judged() {
    let data = flight(FEW);
    let mut checkup = data.checkup();
    checkup.tell_trouble(Sensor::Cameras, "/run/frames: stamps such as 7 are in milliseconds");
    let report = checkup.report();
    assert_found(&report, "camera timing", Fitness::NotFit, "stamps such as 7 are in milliseconds");
    assert_eq!(measure(&report, "time offset").cure, crate::NAMED_ABOVE, "{}", told(&report));
    assert_eq!(measure(&report, "epipolar error").verdict, Fitness::Good, "{}", told(&report));

    let mut without = data.with(|data| data.samples.clear()).checkup();
    without.tell_trouble(Sensor::Imu, "the IMU is missing (No such file or directory); waiting for it");
    let report = without.report();
    assert_found(&report, "IMU timing", Fitness::NotFit, "No such file");
    for name in ["IMU axes", "gravity", "mounting", "mounting heading", "vibration of the gyroscope", "blur"]
    {
        assert_eq!(measure(&report, name).cure, crate::NAMED_ABOVE, "{name}: {}", told(&report));
    }
}

#[test]
fn nothing_stands_still_in_a_flight_whose_images_are_missing() {
    let report = simulated(FlightPath::Demo, 1.0, 12.0, 0).report();
    let gravity = measure(&report, "gravity");
    assert_eq!(gravity.verdict, Fitness::NotMeasured, "{}", told(&report));
}

#[test]
fn a_flight_warns_of_a_mounting_that_gravity_contradicts_in_the_words_of_the_checkup() {
    let turned = flight(0).with(|data| data.config.vehicle = VehicleConfig::mounted([0.0, 0.0, 0.0]));
    let mut flying = Plausibility::new(&turned.config, false);
    turned.samples.iter().for_each(|(_, sample)| flying.add_sample(sample));
    let said = turned.report().measure("mounting").unwrap().clone();
    let findings = flying.findings();
    assert!(
        findings.iter().any(|finding| finding.evidence == said.value && finding.cure == said.cure),
        "{said:?}: {findings:#?}"
    );
}

#[test]
fn columns_of_the_accelerometer_are_named_and_the_mounting_is_not_judged_by_them() {
    let flying = super::simulated(super::FlightPath::Demo, 0.0, 15.0, 0);
    assert!(flying.report().measure("units and columns").is_none(), "{}", told(&flying.report()));
    let swapped =
        flying.with(|data| data.samples.iter_mut().for_each(|(_, sample)| sample.accel.swap_rows(0, 1)));
    let report = swapped.report();
    assert_found(
        &report,
        "units and columns",
        Fitness::NotFit,
        "as x y z it delivers y x z; put the columns",
    );
    assert_eq!(measure(&report, "mounting").verdict, Fitness::NotMeasured, "{}", told(&report));
}

#[test]
fn a_negated_accelerometer_is_named_at_rest_and_in_motion() {
    let negated =
        flight(0).with(|data| data.samples.iter_mut().for_each(|(_, sample)| sample.accel = -sample.accel));
    assert_found(&negated.report(), "mounting", Fitness::NotFit, "the accelerometer is negated");
    let flying = super::simulated(super::FlightPath::Demo, 3.0, 6.0, 0)
        .with(|data| data.samples.iter_mut().for_each(|(_, sample)| sample.accel = -sample.accel));
    assert_found(&flying.report(), "units and columns", Fitness::NotFit, "the accelerometer is negated");
}
