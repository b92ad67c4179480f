//! What goes wrong in flight is survived without a reset, and the covariance knows of it.

use plumbline::campaign::Fault;
use plumbline_drivers::simulator::Scene;
use plumbline_tests::entry;

/// Flies V1_02 in the room for twelve seconds with `fault`; the error stays below `max_error_m` and within
/// `max_sigmas` of what the covariance says.
fn survives(fault: Fault, max_error_m: f64, max_sigmas: f64) {
    let Some(entry) = entry("V1_02_medium", ("room", Scene::Room), 1, 12.0, fault) else { return };
    let report = entry.fly(None, false, None, 2).unwrap();
    println!("{}", entry.row(&report));
    let accuracy = report.accuracy.as_ref().unwrap();
    assert_eq!(report.resets, 0);
    assert!(report.completion >= 0.98, "completion {}", report.completion);
    assert!(accuracy.max_error_m < max_error_m, "largest error {} m", accuracy.max_error_m);
    assert!(accuracy.max_error_sigmas < max_sigmas, "{} standard deviations", accuracy.max_error_sigmas);
}

#[test]
fn a_blackout_of_a_second_and_a_half() {
    survives(Fault::Blackout, 0.3, 4.0);
}

#[test]
fn one_frame_in_twenty_lost() {
    survives(Fault::Drops, 0.1, 4.0);
}

#[test]
fn the_left_camera_silent_for_five_seconds() {
    survives(Fault::LeftLost, 0.2, 4.0);
}

#[test]
fn flickering_exposure() {
    survives(Fault::Flicker, 0.1, 4.0);
}

#[test]
fn stamps_eight_milliseconds_off() {
    survives(Fault::Offset, 0.2, 4.0);
}

#[test]
fn extrinsics_one_degree_off() {
    survives(Fault::Extrinsics, 0.2, 4.0);
}
