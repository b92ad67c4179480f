//! One part of a calibration is wrong: it is named first, with its size, and nothing beside it; a sound one is fit.

use super::{ALL, Data, FlightPath, assert_found, is_fit, measure, missing, simulated, told};
use crate::{Fitness, Measure};
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::options::rows_from_isometry;

/// A flight by hand, which turns about all axes.
pub(super) fn by_hand() -> Data {
    simulated(FlightPath::HandHeld, 0.0, 12.0, ALL)
}

#[track_caller]
fn assert_first(report: &[Measure], name: &str) {
    let first = &report[0];
    assert!(first.name == name && first.verdict == Fitness::NotFit, "{}", told(report));
    let others = report[1..].iter().filter(|measure| measure.verdict == Fitness::NotFit);
    assert_eq!(others.count(), 0, "{}", told(report));
}

#[test]
fn a_sound_flight_shows_every_essential() {
    let report = by_hand().report();
    println!("{}", told(&report));
    assert!(is_fit(&report) && missing(&report).is_empty(), "{}", told(&report));
}

#[test]
fn focal_lengths_of_either_sign_and_size() {
    for factor in [1.03, 0.97, 0.75] {
        let report = by_hand()
            .with(|data| {
                let focal = |f: f64| f * factor;
                data.config.camera.iter_mut().for_each(|camera| camera.focal_px = camera.focal_px.map(focal));
            })
            .report();
        assert_first(&report, "focal length");
        let step = measure(&report, "focal length").figures["step"];
        assert!((step + factor.ln()).abs() < 0.003, "{step}: {}", told(&report));
    }
}

#[test]
fn a_delay_and_a_clock_that_runs_fast() {
    for late_s in [0.04, -0.08] {
        let late = by_hand().with(|data| {
            data.frames.iter_mut().for_each(|(_, stamp, _)| *stamp = stamp.plus_seconds(late_s));
        });
        let report = late.report();
        assert_first(&report, "time offset");
        let step = measure(&report, "time offset").figures["step"];
        assert!((step + late_s).abs() < 0.001, "{step}: {}", told(&report));
    }
    // Of one camera too; a pace that is not the configured one is no wrong rate of the sensor.
    for (rate, cameras) in [(1.002, 2), (0.97, 1), (1.03, 1), (2.0, 2)] {
        let fast = by_hand().with(|data| {
            data.config.camera.truncate(cameras);
            let first = data.samples[0].1.stamp;
            for (_, sample) in &mut data.samples {
                sample.stamp = first.plus_seconds(rate * sample.stamp.seconds_since(first));
            }
        });
        let report = fast.report();
        assert_first(&report, "clock rate");
        assert!(!told(&report).contains("imu.rate_hz"), "{}", told(&report));
    }
}

#[test]
fn a_camera_that_is_turned_on_the_imu_and_a_wrong_baseline() {
    let turned = by_hand().with(|data| {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.06, -0.05, 0.06));
        for camera in &mut data.config.camera {
            camera.pose_b_c = rows_from_isometry(&(turn * camera.pose_b_c()));
        }
    });
    assert_first(&turned.report(), "camera-IMU rotation");
    let longer = by_hand().with(|data| {
        let [left, right] = [0, 1].map(|k| data.config.camera[k].pose_b_c());
        let mut apart = left.inverse() * right;
        apart.translation.vector *= 1.5;
        data.config.camera[1].pose_b_c = rows_from_isometry(&(left * apart));
    });
    assert_first(&longer.report(), "baseline");
}

#[test]
fn columns_of_either_sensor() {
    let gyro = by_hand().with(|data| data.samples.iter_mut().for_each(|(_, s)| s.gyro.x = -s.gyro.x));
    assert_found(&gyro.report(), "gyroscope axes", Fitness::NotFit, "-x y z");
    let accel = by_hand().with(|data| {
        data.samples.iter_mut().for_each(|(_, s)| s.accel = Vector3::new(s.accel.y, s.accel.x, s.accel.z));
    });
    assert_found(&accel.report(), "accelerometer axes", Fitness::NotFit, "y x z");
}

#[test]
fn images_that_are_mirrored_or_exchanged_or_black_in_turn() {
    let mirrored = by_hand().with(|data| {
        for (_, _, images) in &mut data.frames {
            for image in images {
                let width = image.width();
                image.pixels_mut().chunks_mut(width).for_each(<[u8]>::reverse);
            }
        }
    });
    assert_found(&mirrored.report(), "way the images lie", Fitness::NotFit, "both images are mirrored");
    let exchanged =
        by_hand().with(|data| data.frames.iter_mut().for_each(|(_, _, images)| images.swap(0, 1)));
    assert_found(&exchanged.report(), "way the images lie", Fitness::NotFit, "exchanged");
    let black = by_hand().with(|data| {
        let odd = data.frames.iter_mut().skip(1).step_by(2);
        odd.for_each(|(_, _, images)| images.iter_mut().for_each(|image| image.pixels_mut().fill(2)));
    });
    assert_found(&black.report(), "black images", Fitness::NotFit, "every second frame");
}

/// One camera tells a focal length and the scale of the gyroscope apart badly, and a lens is off more often.
#[test]
fn one_camera_names_the_likelier_of_two_first() {
    let report = by_hand()
        .with(|data| {
            data.config.camera.truncate(1);
            data.config.camera[0].focal_px = data.config.camera[0].focal_px.map(|f| 1.04 * f);
        })
        .report();
    assert_first(&report, "focal length");
    assert!(report[0].value.contains("or the gyroscope scale instead"), "{}", told(&report));
}

#[test]
fn cameras_that_are_knocked_are_the_cause_and_no_cabin() {
    let report = by_hand()
        .with(|data| {
            for image in data.frames[130..].iter_mut().flat_map(|(_, _, images)| images) {
                let width = image.view().width();
                image.pixels_mut().chunks_mut(width).for_each(|row| row.copy_within(..width - 12, 12));
            }
        })
        .report();
    assert_first(&report, crate::FLIGHT);
    let title = report[0].title();
    assert!(title.starts_with("flight: cameras may have been moved"), "{title}");
    assert!(report[0].cure.contains("calibrate rig"), "{}", told(&report));
}
