//! Faults in flight are survived without a reset, and the covariance accounts for them.

use plumbline_flight::flight::open_simulation;
use plumbline_lab::report::Report;
use plumbline_simulator::{Effects, Scene};
use plumbline_tests::{along, reported};

/// Flies V1_02 in the room for twelve seconds with an effect on its images, a fault, and cameras that are believed turned by
/// `error_deg`; the error stays below `max_error_m` and within four standard deviations.
fn survives(change: impl Fn(&mut Effects), fault: Option<&str>, error_deg: f64, max_error_m: f64) {
    let Some(mut scenario) = along("V1_02_medium", Scene::Room, 12.0) else { return };
    change(&mut scenario.effects);
    let flight = open_simulation(None, &scenario, false, error_deg, None).unwrap();
    let faults: Vec<_> = fault.into_iter().map(|fault| fault.parse().unwrap()).collect();
    let report = reported(flight.with_injected(&faults, scenario.seed).unwrap());
    let accuracy = report.accuracy.as_ref().unwrap();
    assert_eq!(report.resets, 0);
    // Frames that are lost have no pose and are not counted.
    assert!(report.completion >= 0.98, "completion {}", report.completion);
    assert!(accuracy.max_error_m < max_error_m, "largest error {} m", accuracy.max_error_m);
    assert!(accuracy.max_error_sigmas < 4.0, "{} standard deviations", accuracy.max_error_sigmas);
}

#[test]
fn a_blackout_of_a_second_and_a_half() {
    survives(|effects| effects.blackout = Some((6.0, 7.5)), None, 0.0, 0.3);
}

#[test]
fn one_frame_in_twenty_lost() {
    survives(|_| {}, Some("frames-missing:0.05"), 0.0, 0.1);
}

#[test]
fn the_left_camera_silent_for_five_seconds() {
    survives(|_| {}, Some("camera-lost:left@5+5"), 0.0, 0.2);
}

#[test]
fn flickering_exposure() {
    survives(|effects| effects.flicker = 0.15, None, 0.0, 0.1);
}

#[test]
fn stamps_eight_milliseconds_off() {
    survives(|effects| effects.time_offset_s = 0.008, None, 0.0, 0.2);
}

#[test]
fn extrinsics_one_degree_off() {
    survives(|_| {}, None, 1.0, 0.2);
}

/// Flies V1_02 in the room for fifteen seconds with `fault`: the estimates that may be used are within five standard deviations.
fn is_honest(fault: &str) -> Option<Report> {
    let scenario = along("V1_02_medium", Scene::Room, 15.0)?;
    let flight = open_simulation(None, &scenario, false, 0.0, None).unwrap();
    let report = reported(flight.with_injected(&[fault.parse().unwrap()], scenario.seed).unwrap());
    let honesty = report.honesty.as_ref().unwrap();
    assert!(honesty.is_honest() && report.resets == 0, "{fault}: {honesty}");
    Some(report)
}

#[test]
fn a_blow_to_the_accelerometer() {
    is_honest("accel-pulse:x:30@6+0.1");
}

/// A sensor that fails in silence is named by the health bit `name` within a second.
fn names_the_sensor(fault: &str, name: &str) {
    let Some(report) = is_honest(fault) else { return };
    let since_s = report.honesty.unwrap().since_fault_s.unwrap();
    assert!(since_s.get(name).is_some_and(|s| *s <= 1.0), "{since_s:?}");
}

#[test]
fn a_gyroscope_that_reads_zero() {
    names_the_sensor("gyro-dead:xyz:0@10", "gyroscope stuck");
}

#[test]
fn inertial_samples_stamped_half_a_second_late() {
    names_the_sensor("imu-late:500@10", "IMU late");
}
