//! Faults in flight are survived without a reset, and the covariance accounts for them.

use plumbline_lab::campaign::table::{SILENCE_HEAD, TRUST_HEAD, silence_row, trust_row};
use plumbline_lab::campaign::{CampaignFault, PATHS};
use plumbline_lab::report::trust::MAX_NEES_DURING;
use plumbline_simulator::Scene;
use plumbline_tests::entry;

/// Flies V1_02 in the room for twelve seconds with `fault`; the error stays below `max_error_m` and within
/// `max_sigmas` of what the covariance says.
fn survives(fault: CampaignFault, max_error_m: f64, max_sigmas: f64) {
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
    survives(CampaignFault::Blackout, 0.3, 4.0);
}

#[test]
fn one_frame_in_twenty_lost() {
    survives(CampaignFault::Drops, 0.1, 4.0);
}

#[test]
fn the_left_camera_silent_for_five_seconds() {
    survives(CampaignFault::LeftLost, 0.2, 4.0);
}

#[test]
fn flickering_exposure() {
    survives(CampaignFault::Flicker, 0.1, 4.0);
}

#[test]
fn stamps_eight_milliseconds_off() {
    survives(CampaignFault::Offset, 0.2, 4.0);
}

#[test]
fn extrinsics_one_degree_off() {
    survives(CampaignFault::Extrinsics, 0.2, 4.0);
}

/// Flies as the campaign does, and asserts that errors were consistent with the covariance and that the estimate
/// recovered at once.
fn is_honest(fault: CampaignFault) {
    let Some(entry) = entry("V1_02_medium", ("room", Scene::Room), 1, 15.0, fault) else { return };
    let report = entry.fly(None, false, None, 2).unwrap();
    println!("{TRUST_HEAD}\n{}", trust_row(&entry, &report).unwrap());
    let trust = report.trust.unwrap();
    assert!(trust.is_deserved() && trust.recovery_s.is_some_and(|s| s <= 1.0), "{trust:?}");
    assert!(trust.worst_error_m < 0.1 && report.resets == 0, "{trust:?}");
}

#[test]
fn an_inertial_sensor_at_the_ends_of_its_range() {
    is_honest(CampaignFault::Saturated);
}

#[test]
fn a_right_camera_turned_by_two_degrees() {
    is_honest(CampaignFault::RightTurned);
}

/// Flies with a sensor that fails in silence after ten seconds: it is named within a second, and estimates that may be used are
/// within five standard deviations.
fn names_the_sensor(fault: CampaignFault) {
    let Some(entry) = entry("V1_02_medium", ("room", Scene::Room), 1, 15.0, fault) else { return };
    let report = entry.fly(None, false, None, 2).unwrap();
    println!("{SILENCE_HEAD}\n{}", silence_row(&entry, &report).unwrap());
    assert!(entry.is_honest_of_silence(&report), "{:?}", report.silence);
}

#[test]
fn a_gyroscope_that_reads_zero() {
    names_the_sensor(CampaignFault::GyroZero);
}

#[test]
fn inertial_samples_stamped_half_a_second_late() {
    names_the_sensor(CampaignFault::ImuLate500);
}

/// Every sensor that fails in silence, along four paths; the figures stand in docs/benchmarks.md.
#[test]
#[ignore = "minutes; run by `make soak`"]
fn soak_every_silent_sensor_is_named() {
    let (mut rows, mut silent) = (Vec::new(), Vec::new());
    for fault in CampaignFault::ALL.into_iter().filter(|fault| fault.is_silent()) {
        for (path, _) in PATHS {
            let Some(entry) = entry(path, ("room", Scene::Room), 1, 15.0, fault) else { return };
            let report = entry.fly(None, false, None, 2).unwrap();
            rows.extend(silence_row(&entry, &report));
            if !entry.is_honest_of_silence(&report) {
                silent.push(format!("{fault:?} on {path}: {:?}", report.silence));
            }
        }
    }
    println!("{SILENCE_HEAD}\n{}", rows.join("\n"));
    assert!(silent.is_empty(), "{silent:#?}");
}

/// Every fault at full resolution; the figures stand in docs/benchmarks.md.
#[test]
#[ignore = "minutes; run by `make soak`"]
fn soak_no_fault_gives_false_confidence() {
    let mut rows = Vec::new();
    let mut deceived = Vec::new();
    for fault in CampaignFault::ALL.into_iter().filter(|fault| !fault.is_silent()) {
        let Some(entry) = entry("V1_02_medium", ("room", Scene::Room), 1, 16.0, fault) else { return };
        let report = entry.fly(None, false, None, 2).unwrap();
        rows.extend(trust_row(&entry, &report));
        let trust = report.trust.unwrap();
        // A hover lasts to the end: what comes after it is short.
        let is_during = trust.nees_during.is_none_or(|nees| nees <= MAX_NEES_DURING);
        let is_honest = trust.is_deserved() || (fault == CampaignFault::Hover && is_during);
        if !is_honest {
            deceived.push(format!("{fault:?}: {trust:?}"));
        }
    }
    println!("{TRUST_HEAD}\n{}", rows.join("\n"));
    assert!(deceived.is_empty(), "{deceived:#?}");
}
