//! `plumbline doctor` on data: a verdict for each thing, an exit status, and the same for programs.

use super::{plumbline, stderr};
use serde_json::Value;

fn json(arguments: &[&str]) -> (Option<i32>, Value) {
    let output = plumbline(arguments);
    let text = String::from_utf8_lossy(&output.stdout);
    let value = serde_json::from_str(&text).unwrap_or_else(|_| panic!("{text}{}", stderr(&output)));
    (output.status.code(), value)
}

#[test]
fn a_simulated_flight_is_fit_by_its_figures() {
    let (status, report) = json(&["doctor", "sim:room", "--seconds", "3", "--json"]);
    assert_eq!((status, &report["fit"]), (Some(0), &Value::Bool(true)), "{report:#}");
    let open = report["not_looked_at"].to_string();
    assert!(open.contains("this host") && open.contains("blur"), "{open}");
    let measures = report["measures"].as_array().unwrap();
    let of = |name: &str| measures.iter().find(|measure| measure["name"] == name).unwrap();
    assert!(of("epipolar error")["figures"]["median_px"].as_f64().unwrap() < 0.3, "{report:#}");
    assert!((of("gravity")["figures"]["norm_m_s2"].as_f64().unwrap() - 9.81).abs() < 0.2, "{report:#}");
}

#[test]
fn a_verdict_covers_what_was_looked_at_alone() {
    let host = plumbline(&["doctor", "--config", "sim", "--watch", "0.1"]);
    let text = String::from_utf8_lossy(&host.stdout);
    let last = text.trim_end().lines().last().unwrap();
    assert!(
        last.starts_with("This host is fit to fly") && last.contains("Not looked at: the sensors"),
        "{last}"
    );
    let data = plumbline(&["doctor", "sim:room", "--seconds", "2"]);
    let text = String::from_utf8_lossy(&data.stdout);
    let last = text.trim_end().lines().last().unwrap();
    assert!(last.starts_with("The sensors are fit to fly") && last.contains("time offset"), "{last}");
}

/// Reasons stand for what was not measured, and those that share a reason are in one line.
#[test]
fn a_measure_that_the_data_do_not_hold_has_its_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight").display().to_string();
    let written =
        plumbline(&["simulate", &path, "--start", "3", "--duration", "2", "--scale", "0.5", "--mono"]);
    assert!(written.status.success(), "{}", stderr(&written));
    let looked = plumbline(&["doctor", &path]);
    let text = String::from_utf8_lossy(&looked.stdout).into_owned();
    assert_eq!(text.matches("it takes two cameras, and the configuration has one").count(), 1, "{text}");
    let line = text.lines().find(|line| line.contains("epipolar error, ")).unwrap();
    assert!(line.starts_with("not measured") && line.contains("scale"), "{text}");
    let last = text.trim_end().lines().last().unwrap();
    assert!(
        last.contains("Not measured, for the reasons above: ") && last.contains("epipolar error"),
        "{last}"
    );
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
    assert!(value.starts_with("right images stand still for 2.0 s (4.0 to 6.0 s"), "{value}");
    assert!(cure.contains("the right camera, and restart it"), "{cure}");
}

#[test]
fn a_simulated_flight_may_have_one_camera_and_a_path_by_its_name() {
    let one = plumbline(&["doctor", "sim:room?mono=true&scale=0.5", "--seconds", "2"]);
    let text = String::from_utf8_lossy(&one.stdout);
    assert!(text.contains("it takes two cameras"), "{text}{}", stderr(&one));
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

/// With its time and its cure; measures that it spoils are not judged, and a sound data set has no such axis.
#[test]
fn an_axis_that_fails_with_noise_is_named() {
    let folder = tempfile::tempdir().unwrap();
    for (name, fault, words, cure) in [
        ("sound", "accel-pulse:x:0", "all six live", ""),
        (
            "dead",
            "gyro-dead:x@0",
            "gyroscope x reads noise alone from 0 to 12 s",
            "look at wiring, bus and driver",
        ),
        (
            "exchanged",
            "accel-exchanged:yz@5",
            "accelerometer y and z read each other's motion from",
            "was right before",
        ),
    ] {
        let path = folder.path().join(name).display().to_string();
        let flight = ["--path", "hand-held", "--duration", "12", "--scale", "0.5", "--fault", fault];
        let written = plumbline(&[&["simulate", &path], &flight[..]].concat());
        assert!(written.status.success(), "{}", stderr(&written));
        let (status, report) = json(&["doctor", &path, "--json"]);
        let is_sound = cure.is_empty();
        assert_eq!((status, &report["fit"]), (Some(i32::from(!is_sound)), &is_sound.into()), "{report:#}");
        let measures = report["measures"].as_array().unwrap();
        let of = |name: &str| measures.iter().find(|measure| measure["name"] == name).unwrap();
        let told = |key: &str| of("IMU axes")[key].as_str().unwrap();
        assert!(told("value").starts_with(words) && told("cure").contains(cure), "{report:#}");
        assert_eq!(of("scale")["verdict"], if is_sound { "good" } else { "not measured" }, "{report:#}");
    }
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
    assert!(report["host"].as_array().is_some_and(|checks| checks.len() >= 10), "{report:#}");
    let without = plumbline(&["doctor", "--config", "sim", "--live"]);
    assert_eq!(without.status.code(), Some(2));
    assert!(stderr(&without).contains("driver.imu.connect"), "{}", stderr(&without));
}

#[test]
fn a_real_recording_is_fit_and_with_another_mounting_it_is_not() {
    let Some(clip) = plumbline_test_support::shared("euroc/V1_01_easy_clip") else { return };
    let clip = clip.to_str().unwrap();
    let (status, report) = json(&["doctor", clip, "--json"]);
    assert_eq!((status, &report["fit"]), (Some(0), &Value::Bool(true)), "{report:#}");

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
    assert_eq!((&of("certificates")["verdict"], &of("autopilot")["verdict"]), (&"ok".into(), &"ok".into()));
}
