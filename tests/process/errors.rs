//! Bad input ends with one clear line and the right exit status, never a panic.

use super::{fails, plumbline, stderr};
use std::fs;
use std::path::Path;

/// A simulated data set of half a second in `folder`.
fn dataset(folder: &Path) -> String {
    let out = folder.join("flight");
    let path = out.to_str().unwrap().to_owned();
    let output = plumbline(&["simulate", &path, "--duration", "0.5", "--scale", "0.5"]);
    assert!(output.status.success(), "{}", stderr(&output));
    path
}

#[test]
fn a_folder_that_is_no_data_set() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_str().unwrap();
    fails(&["replay", path], 2, &[path]);
    fails(&["replay", "/nowhere/at/all"], 2, &["/nowhere/at/all"]);
}

#[test]
fn an_empty_imu_table() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path());
    fs::write(format!("{path}/mav0/imu0/data.csv"), "#timestamp [ns],w,w,w,a,a,a\n").unwrap();
    fails(&["replay", &path], 2, &["imu0"]);
}

#[test]
fn truncated_images_and_a_nan_are_survived_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path());
    let images = fs::read_dir(format!("{path}/mav0/cam0/data")).unwrap();
    let mut images: Vec<_> = images.map(|e| e.unwrap().path()).collect();
    images.sort();
    let bytes = fs::read(&images[4]).unwrap();
    fs::write(&images[4], &bytes[..bytes.len() / 3]).unwrap();
    let table = format!("{path}/mav0/imu0/data.csv");
    let mut lines: Vec<String> = fs::read_to_string(&table).unwrap().lines().map(str::to_owned).collect();
    let stamp = lines[50].split(',').next().unwrap().to_owned();
    lines[50] = format!("{stamp},NaN,0,0,0,0,9.81");
    fs::write(&table, lines.join("\n")).unwrap();
    let output = plumbline(&["replay", &path, "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["faults"]["imu"]["corrupt"], 1);
    assert_eq!(report["faults"]["cameras"]["corrupt"], 1);
    assert_eq!(report["resets"], 0);
}

#[test]
fn a_wrong_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path());
    let sensor = format!("{path}/mav0/cam0/sensor.yaml");
    let text = fs::read_to_string(&sensor).unwrap().replace("intrinsics: [", "intrinsics: [-");
    fs::write(&sensor, text).unwrap();
    fails(&["replay", &path], 2, &["camera[0].focal_px"]);
}

#[test]
fn configurations_that_cannot_be() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bad.toml");
    let preset = String::from_utf8(plumbline(&["config", "sim"]).stdout).unwrap();
    fs::write(&file, preset.replace("keyframes = 7", "keyframs = 7")).unwrap();
    let file = file.to_str().unwrap();
    fails(&["replay", "sim:room", "--config", file], 2, &[file, "keyframs"]);
    fails(&["replay", "sim:moon"], 2, &["moon", "room"]);
    fails(&["replay", "sim:room", "--blackout", "7..5"], 2, &["--blackout"]);
    fails(&["router"], 2, &["--listen"]);
}

#[test]
fn trajectories_without_common_time() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a.tum"), folder.path().join("b.tum"));
    fs::write(&a, "1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n").unwrap();
    fs::write(&b, "100.0 0 0 0 0 0 0 1\n101.0 1 0 0 0 0 0 1\n").unwrap();
    fails(&["evaluate", a.to_str().unwrap(), b.to_str().unwrap()], 1, &[]);
}
