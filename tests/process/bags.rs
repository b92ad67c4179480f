//! ROS 2 bags, written by another implementation than ours, are flown as the data set is that they were made of.

use super::python::interpreter;
use super::{fails, plumbline, stderr};
use plumbline_test_support::shared;
use std::path::Path;
use std::process::Command;

/// The digest of the estimates of a flight.
fn digest(arguments: &[&str]) -> String {
    let output = plumbline(&[&["replay", "--json"], arguments].concat());
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(report["completion"].as_f64().unwrap() > 0.3, "{arguments:?} hardly has a pose to compare");
    report["estimate_digest"].as_str().unwrap().to_owned()
}

/// Writes the first frames of a data set as a bag.
fn written(python: &Path, dataset: &str, out: &str, kind: &str, frames: &str) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/python/write_bag.py");
    let status = Command::new(python).arg(script).args([dataset, out, kind, frames]).status().unwrap();
    assert!(status.success(), "{out}");
}

#[test]
fn a_bag_of_the_clip_gives_the_estimates_of_the_clip_bit_for_bit() {
    let Some(clip) = shared("euroc/V1_01_easy_clip") else { return };
    let Some(python) = interpreter("rosbags, numpy") else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (clip, config) = (clip.to_str().unwrap().to_owned(), at("clip.toml"));
    // As `replay` makes it of the data set: the noise is that of the preset.
    let mounting = ["--imu-to-vehicle", "180,-70.3,0"];
    let import = ["config", "import", "--euroc", &clip, "--out", &config, "--noise", "base"];
    let imported = plumbline(&[&import[..], &mounting].concat());
    assert!(imported.status.success(), "{}", stderr(&imported));
    for (kind, frames) in [("png", 40), ("raw", 12)] {
        let (bag, cut) = (at(kind), format!("0..{frames}"));
        written(&python, &clip, &bag, kind, &frames.to_string());
        assert_eq!(digest(&[&bag, "--config", &config]), digest(&[&clip, "--frames", &cut]), "{kind}");
    }
    let file = format!("{}/png.mcap", at("png"));
    fails(&["replay", &file], 2, &["png.mcap", "calibration", "--config"]);
    let wrong = ["replay", &file, "--config", &config, "--topic", "imu=/imu9"];
    fails(&wrong, 2, &["/imu9", "/imu0 (sensor_msgs/msg/Imu)"]);
    fails(&["replay", &file, "--config", &config, "--topic", "up=/x"], 2, &["--topic", "left=NAME"]);
    // What else takes recordings takes it: a checkup, a map, and images for a log that holds none.
    let (poses, map, log) = (at("poses.tum"), at("bag.map"), at("log.mcap"));
    let without = ["--record", &log, "--set", "recorder.images=none", "--trajectory", &poses];
    for arguments in [
        &["doctor", &file, "--config", &config][..],
        &[&["replay", &file, "--config", &config], &without[..]].concat(),
        &["verify", &log, "--images", &file],
        &["map", "build", &file, "--config", &config, "--poses", &poses, "--out", &map],
    ] {
        let output = plumbline(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    }
    fails(&["verify", &log, "--images", &file, "--topic", "left=/x"], 2, &["/x", "/cam0"]);
    let imu = plumbline(&["calibrate", "imu", &file, "--out", &at("imu.toml")]);
    assert!(imu.status.success(), "{}", stderr(&imu));
    assert!(stderr(&imu).contains("shaken"), "{}", stderr(&imu));
}

#[test]
fn a_bag_of_sqlite_is_refused_with_the_command_that_converts_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("old.db3");
    std::fs::write(&file, b"SQLite format 3\0").unwrap();
    fails(&["replay", file.to_str().unwrap(), "--config", "euroc"], 2, &["old.db3", "ros2 bag convert"]);
}
