//! `plumbline doctor` on data: a verdict for each thing, an exit status, and the same for programs.

use super::{plumbline, stderr};
use serde_json::Value;

fn json(arguments: &[&str]) -> (Option<i32>, Value) {
    let output = plumbline(arguments);
    let text = String::from_utf8_lossy(&output.stdout);
    let value = serde_json::from_str(&text).unwrap_or_else(|_| panic!("{text}{}", stderr(&output)));
    (output.status.code(), value)
}

/// A flight that shows everything.
const LIVELY: &str = "sim:room?path=hand-held&scale=0.5&duration=12";

#[test]
fn a_simulated_flight_is_fit_by_its_figures() {
    let (status, report) = json(&["doctor", LIVELY, "--json"]);
    assert_eq!((status, &report["fit"]), (Some(0), &Value::Bool(true)), "{report:#}");
    assert!(report["not_looked_at"].to_string().contains("this host"), "{report:#}");
    let measures = report["measures"].as_array().unwrap();
    let of = |name: &str| measures.iter().find(|measure| measure["name"] == name).unwrap();
    assert!(of("focal length")["figures"]["step"].as_f64().unwrap().abs() < 0.003, "{report:#}");
}

#[test]
fn what_is_not_shown_is_no_verdict_and_has_its_motion() {
    let host = plumbline(&["doctor", "--config", "sim", "--watch", "0.1"]);
    let text = String::from_utf8_lossy(&host.stdout);
    let last = text.trim_end().lines().last().unwrap();
    assert!(
        last.starts_with("This host is fit to fly") && last.contains("Not looked at: the sensors"),
        "{last}"
    );
    for source in ["sim:room", "sim:room?mono=true&scale=0.5"] {
        let data = plumbline(&["doctor", source, "--seconds", "2", "--json"]);
        let said = stderr(&data);
        assert_eq!(data.status.code(), Some(4), "{said}");
        let parts = ["not shown: calibration: too short: 10 s of motion are needed", "fly this: turn it"];
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
        let report: Value = serde_json::from_slice(&data.stdout).unwrap();
        assert_eq!(report["fit"], false, "{report:#}");
    }
}

#[test]
fn a_right_camera_without_calibration_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight").display().to_string();
    plumbline(&["simulate", &path, "--duration", "2", "--scale", "0.4"]);
    std::fs::remove_file(format!("{path}/mav0/cam1/sensor.yaml")).unwrap();
    let output = plumbline(&["doctor", &path]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("cam1 is left out: one camera is used"), "{text}{}", stderr(&output));
}

/// A data set says which fault is in it, and `doctor` finds it.
#[test]
fn frozen_images_are_named_with_their_camera_and_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frozen").display().to_string();
    let fault =
        ["--path", "hand-held", "--duration", "8", "--scale", "0.5", "--fault", "image-frozen:right@4+2.03"];
    let written = plumbline(&[&["simulate", &path], &fault[..]].concat());
    let text = String::from_utf8_lossy(&written.stdout).into_owned();
    assert!(text.contains("fault: image-frozen:right") && text.contains("from 4 to 6.03 s"), "{text}");
    let (status, report) = json(&["doctor", &path, "--json"]);
    let wrong: Vec<_> = report["measures"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|measure| measure["verdict"] == "not fit")
        .collect();
    assert_eq!((status, wrong.len(), &wrong[0]["name"]), (Some(1), 1, &"frozen images".into()), "{report:#}");
    let (value, cure) = (wrong[0]["value"].as_str().unwrap(), wrong[0]["cure"].as_str().unwrap());
    assert!(value.starts_with("right: ") && value.contains("(4."), "{value}");
    assert!(cure.contains("restart it"), "{cure}");
}

#[test]
fn a_simulated_flight_has_a_path_by_its_name() {
    for (path, imu, words) in [
        ("V9", "simulated", "no such path or file; give demo, hand-held"),
        ("demo", "recorded", "such as V1_02"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let to = folder.path().join("flight").display().to_string();
        let refused = plumbline(&["simulate", &to, "--path", path, "--imu", imu]);
        assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
        assert!(stderr(&refused).contains(words), "{}", stderr(&refused));
    }
}

/// With its cure, and before everything else.
#[test]
fn an_axis_that_fails_with_noise_is_named() {
    let (status, report) = json(&["doctor", &format!("{LIVELY}&fault=gyro-dead:x@0"), "--json"]);
    assert_eq!((status, &report["fit"]), (Some(1), &Value::Bool(false)), "{report:#}");
    assert!(report["measures"][0]["name"].as_str().unwrap().starts_with("gyroscope"), "{report:#}");
}

#[test]
fn live_sensors_that_are_not_there_are_told_after_the_time_that_was_given() {
    let (left, imu) =
        ("driver.v4l2.left=\"/dev/nobody-has-this\"", "driver.imu.connect=\"iio://nobody-has-this\"");
    let arguments = ["doctor", "--config", "sim", "--live", "--seconds", "1", "--watch", "0.1", "--json"];
    let (status, report) = json(&[&arguments[..], &["--set", left, "--set", imu]].concat());
    assert_eq!((status, &report["fit"]), (Some(1), &Value::Bool(false)), "{report:#}");
    let measures = report["measures"].as_array().unwrap();
    for name in ["IMU timing", "camera timing"] {
        let measure = measures.iter().find(|measure| measure["name"] == name).unwrap();
        assert_eq!(
            (&measure["verdict"], &measure["value"]),
            (&"not fit".into(), &"0 samples arrived".into())
        );
    }
    assert!(report["host"].as_array().is_some_and(|checks| checks.len() == 9), "{report:#}");
    let without = plumbline(&["doctor", "--config", "sim", "--live"]);
    assert_eq!(without.status.code(), Some(2));
    assert!(stderr(&without).contains("driver.imu.connect"), "{}", stderr(&without));
}

#[test]
fn a_real_recording_at_rest_is_not_shown_and_with_another_mounting_not_fit() {
    let Some(clip) = plumbline_test_support::shared("euroc/V1_01_easy_clip") else { return };
    let clip = clip.to_str().unwrap();
    // It stands still, so it shows little.
    let (status, report) = json(&["doctor", clip, "--json"]);
    assert_eq!((status, &report["fit"]), (Some(4), &Value::Bool(false)), "{report:#}");

    let output = plumbline(&["doctor", clip, "--set", "vehicle.imu_to_vehicle_deg=[0.0,0.0,0.0]"]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("-> put the vehicle on a level floor"), "{text}");
    assert_eq!(stderr(&output).trim(), "plumbline: not fit to fly: mounting");
}

#[test]
fn what_a_flight_needs_and_has_not_makes_it_not_fit() {
    let host = ["doctor", "--config", "sim", "--watch", "0.1", "--json"];
    let (status, report) = json(&[&host[..], &["--record", "/nowhere-at-all"]].concat());
    assert_eq!((status, &report["fit"]), (Some(1), &Value::Bool(false)), "{report:#}");
    let checks = report["host"].as_array().unwrap();
    let of = |name: &str| checks.iter().find(|check| check["name"] == name).unwrap();
    assert_eq!(of("disk")["verdict"], "not fit");
    assert_eq!(
        (&of("certificates")["verdict"], &of("autopilot")["verdict"]),
        (&"good".into(), &"good".into())
    );
}
