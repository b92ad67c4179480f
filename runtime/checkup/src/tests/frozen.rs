//! Images that freeze, with noise of their own on each copy.

use super::{ALL, Data, FlightPath, assert_found, flight, lively, measure, simulated, told};
use crate::{CheckupReport, Fitness, frozen, scale};
use std::ops::Range;

/// Images of these cameras that repeat the one at the beginning, with noise up to so many grey levels.
fn freeze(cameras: &[usize], time_s: Range<f64>, noise: u64) -> impl Fn(&mut Data) {
    move |data| {
        let begin = data.frames[0].1;
        let is_within = |stamp: &plumbline_config::Timestamp| time_s.contains(&stamp.seconds_since(begin));
        let first = data.frames.iter().position(|(_, stamp, _)| is_within(stamp)).unwrap();
        let kept = data.frames[first].2.clone();
        let mut state = 3_u64;
        for (_, _, images) in data.frames.iter_mut().filter(|(_, stamp, _)| is_within(stamp)) {
            for camera in cameras {
                images[*camera] = kept[*camera].clone();
                for grey in images[*camera].pixels_mut() {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    let off = (state >> 40) % (2 * noise + 1);
                    *grey = (u64::from(*grey) + off).saturating_sub(noise).min(255) as u8;
                }
            }
        }
    }
}

/// Nothing but the frozen images is wrong.
#[track_caller]
fn assert_named(report: &CheckupReport, words: &str) {
    assert_found(report, frozen::NAME, Fitness::NotFit, words);
    let wrong = report.measures.iter().filter(|m| m.verdict > Fitness::Good && m.name != frozen::NAME);
    assert_eq!(wrong.count(), 0, "{}", told(report));
}

#[test]
fn frozen_cameras_are_named_with_their_times_and_no_calibration_is_advised() {
    let Some(lively) = lively() else { return };
    for (cameras, side, shown) in [
        (&[0][..], "left images", "the right ones move"),
        (&[1][..], "right images", "the left ones move"),
        (&[0, 1][..], "left and right images", "gyroscope and accelerometer show motion"),
    ] {
        for noise in [0, 3] {
            let report = lively.with(freeze(cameras, 2.0..4.53, noise)).report();
            println!("{cameras:?} {noise}\n{}", told(&report));
            assert_named(
                &report,
                &format!("{side} stand still for 2.5 s (2.0 to 4.5 s after the first image; 50 of 140"),
            );
            assert_named(&report, shown);
            assert_named(&report, "and restart");
        }
    }
}

#[test]
fn short_times_of_frozen_images_are_counted() {
    let Some(lively) = lively() else { return };
    let report = lively.with(|data| {
        for from_s in [1.0, 3.0, 5.0] {
            freeze(&[0], from_s..from_s + 0.53, 3)(data);
        }
    });
    let report = report.report();
    assert_named(
        &report,
        "for 1.5 s (1.0 to 1.5 s, 3.0 to 3.5 s, 5.0 to 5.5 s after the first image; 30 of 140",
    );
}

#[test]
fn images_that_are_frozen_all_the_time_leave_nothing_to_measure() {
    let Some(lively) = lively() else { return };
    let report = lively.with(freeze(&[1], 0.0..9.0, 3)).report();
    assert_found(&report, frozen::NAME, Fitness::NotFit, "right images stand still for 7.0 s (0.0 to");
    for name in ["epipolar error", "time offset", scale::NAME] {
        assert_eq!(measure(&report, name).cure, crate::NAMED_ABOVE, "{}", told(&report));
    }
}

#[test]
fn a_vehicle_that_rests_or_turns_slowly_has_no_frozen_images() {
    let paths = [(FlightPath::Demo, 3.0), (FlightPath::Hover, 2.0), (FlightPath::Carried, 4.0)];
    let flights = paths.map(|(path, start_s)| simulated(path, start_s, 6.0, ALL));
    for flight in flights.into_iter().chain([flight(ALL)]).chain(lively()) {
        let report = flight.report();
        assert!(report.measure(frozen::NAME).is_none(), "{}", told(&report));
    }
}

#[test]
fn a_vehicle_on_the_ground_that_is_pushed_to_and_fro_has_no_frozen_images() {
    let pushed = flight(30).with(|data| {
        let still = data.frames[0].2.clone();
        for (k, (_, _, images)) in data.frames.iter_mut().enumerate() {
            for (image, still) in images.iter_mut().zip(&still) {
                let width = still.width();
                let moved = k % 2;
                for (to, from) in image.pixels_mut().chunks_mut(width).zip(still.pixels().chunks(width)) {
                    to[moved..].copy_from_slice(&from[..width - moved]);
                }
            }
        }
        for (k, (_, sample)) in data.samples.iter_mut().enumerate() {
            let to_and_fro = if k / 10 % 2 == 0 { 1.0 } else { -1.0 };
            sample.gyro.x += 0.1 * to_and_fro;
            sample.accel.y += to_and_fro;
        }
    });
    let report = pushed.report();
    assert!(report.measure(frozen::NAME).is_none(), "{}", told(&report));
}
