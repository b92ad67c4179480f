//! Every bad input of a first use: one line that names cause and cure, and the right exit status.

use super::dataset::{copy, dataset};
use super::{plumbline, stderr, succeeds};
use std::fs;
use std::path::{Path, PathBuf};

/// Three lines a case: its name; the status of a command, where FLIGHT is the damaged data set, TOML a configuration and FOLDER the
/// folder of both; what the last line says, with `...` between.
const CASES: &str = include_str!("bad_input.txt");

/// Table of inertial samples, and of the left images.
const IMU: &str = "flight/mav0/imu0/data.csv";
const LEFT: &str = "flight/mav0/cam0/data.csv";
const BOTH: [&str; 3] = [IMU, LEFT, "flight/mav0/cam1/data.csv"];

/// Rewrites every row of a table that is no comment.
fn rows(table: &Path, change: impl Fn(Vec<String>) -> Vec<String>) {
    let text = fs::read_to_string(table).unwrap();
    let row = |line: &str| match line.starts_with('#') {
        true => line.to_owned(),
        false => change(line.split(',').map(str::to_owned).collect()).join(","),
    };
    fs::write(table, text.lines().map(row).collect::<Vec<_>>().join("\n")).unwrap();
}

fn in_seconds(mut row: Vec<String>) -> Vec<String> {
    row[0] = format!("{:.9}", row[0].parse::<i64>().unwrap() as f64 * 1e-9);
    row
}

fn set(folder: &Path, key: &str, value: &str) {
    let file = folder.join("drone.toml");
    let text = fs::read_to_string(&file).unwrap();
    let line = text.lines().find(|line| line.starts_with(&format!("{key} = "))).unwrap();
    fs::write(&file, text.replacen(line, &format!("{key} = {value}"), 1)).unwrap();
}

/// Damages a copy of a sound data set, or of a configuration, as the name of a case says.
fn damage(name: &str) -> fn(&Path) {
    match name {
        "stamps of the IMU in seconds" => |folder| rows(&folder.join(IMU), in_seconds),
        "stamps of the images in seconds" => |folder| rows(&folder.join(LEFT), in_seconds),
        "no ground truth" => {
            |folder| fs::remove_dir_all(folder.join("flight/mav0/state_groundtruth_estimate0")).unwrap()
        }
        "ground truth of positions alone" => |folder| {
            let truth = folder.join("flight/mav0/state_groundtruth_estimate0");
            fs::rename(truth, folder.join("flight/mav0/leica0")).unwrap();
        },
        "inertial samples without stamps" => {
            |folder| rows(&folder.join(IMU), |row| [&["0".to_owned()], &row[1..]].concat())
        }
        "images in another format" => |folder| {
            for image in fs::read_dir(folder.join("flight/mav0/cam1/data")).unwrap() {
                fs::write(image.unwrap().path(), b"II*\0no PNG").unwrap();
            }
        },
        "a folder of logs" => |folder| fs::write(folder.join("flight.mcap"), "").unwrap(),
        "a key of another estimator" => |folder| {
            let file = folder.join("drone.toml");
            let text = fs::read_to_string(&file).unwrap();
            fs::write(&file, text.replacen("max_iterations = ", "max_features = ", 1)).unwrap();
        },
        "a mounting in words" => |folder| set(folder, "imu_to_vehicle_deg", "\"upright\""),
        "an unset device" | "a flight with an unset device" => {
            |folder| set(folder, "left", "\"/dev/v4l/by-path/CHANGE-ME-video-index0\"")
        }
        "a value of another type" => |folder| set(folder, "rate_hz", "\"20 Hz\""),
        "an autopilot and an unknown mounting" | "ROS 2 and an unknown mounting" => {
            |folder| set(folder, "imu_to_vehicle_deg", "\"unknown\"")
        }
        "a rig without a mounting" => |folder| {
            let file = folder.join("flight/mav0/imu0/sensor.yaml");
            let text = fs::read_to_string(&file).unwrap();
            let lines = text.lines().filter(|line| !line.starts_with("imu_to_vehicle_deg"));
            fs::write(&file, lines.collect::<Vec<_>>().join("\n")).unwrap();
        },
        "a map of a data set without its second camera" => |folder| {
            fs::remove_dir_all(folder.join("flight/mav0/cam1")).unwrap();
        },
        "another separator" => |folder| {
            let table = folder.join(IMU);
            fs::write(&table, fs::read_to_string(&table).unwrap().replace(',', ";")).unwrap();
        },
        "clocks that have nothing in common" => |folder| {
            rows(&folder.join(IMU), |mut row| {
                row[0] = (row[0].parse::<i64>().unwrap() + 3_600_000_000_000).to_string();
                row
            });
        },
        "no images" => |folder| {
            for camera in ["cam0", "cam1"] {
                fs::remove_dir_all(folder.join(format!("flight/mav0/{camera}/data"))).unwrap();
            }
        },
        "no inertial samples" => {
            |folder| fs::write(folder.join(IMU), "#timestamp [ns],w,w,w,a,a,a\n").unwrap()
        }
        "a focal length below zero" => |folder| {
            let file = folder.join("flight/mav0/cam0/sensor.yaml");
            let text = fs::read_to_string(&file).unwrap();
            fs::write(&file, text.replace("intrinsics: [", "intrinsics: [-")).unwrap();
        },
        "an empty table" => |folder| fs::write(folder.join(LEFT), "#timestamp [ns],filename\n").unwrap(),
        "images in microseconds beside samples in nanoseconds" => |folder| {
            for table in &BOTH[1..] {
                rows(&folder.join(table), |mut row| {
                    row[0] = (row[0].parse::<i64>().unwrap() / 1000).to_string();
                    row
                });
            }
        },
        "files of Kalibr that are exchanged" => {
            |folder| fs::write(folder.join("imu.yaml"), "update_rate: 200.0\n").unwrap()
        }
        "exchanged columns" => |folder| {
            rows(&folder.join(IMU), |row| [&row[..1], &row[4..7], &row[1..4]].concat());
        },
        _ => |_| (),
    }
}

/// A simulated data set of half a second, a configuration and a trajectory.
fn sound(folder: &Path) -> PathBuf {
    let sound = folder.join("sound");
    fs::create_dir(&sound).unwrap();
    let flight = dataset(&sound, "0.5");
    fs::write(sound.join("drone.toml"), plumbline(&["config", "sim"]).stdout).unwrap();
    // A configuration for these images, of half the size.
    let imported = sound.join("drone.toml");
    let scaled = ["config", "import", "--euroc", &flight, "--out", imported.to_str().unwrap()];
    succeeds(&[&scaled[..], &["--base", "sim", "--overwrite"]].concat());
    fs::write(sound.join("est.tum"), "1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n").unwrap();
    sound
}

#[test]
fn every_bad_input_is_named_with_its_cure_and_ends_with_the_right_status() {
    let folder = tempfile::tempdir().unwrap();
    let sound = sound(folder.path());
    let mut failed = Vec::new();
    for (index, case) in CASES.split("\n\n").enumerate() {
        let [name, command, words] = case.lines().collect::<Vec<_>>()[..] else { panic!("{case}") };
        let (status, command) = command.split_once(": ").unwrap();
        let damaged = folder.path().join(format!("case-{index}"));
        copy(&sound, &damaged);
        damage(name)(&damaged);
        let at = |name: &str| damaged.join(name).to_str().unwrap().to_owned();
        let place = |argument: &str| match argument {
            "FLIGHT" => at("flight"),
            "TOML" => at("drone.toml"),
            "FOLDER" => at(""),
            "EST" => at("est.tum"),
            "OUT" => at("out"),
            "IMU.yaml" => at("imu.yaml"),
            argument => argument.to_owned(),
        };
        let arguments: Vec<String> = command.split(' ').map(place).collect();
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let output = plumbline(&arguments);
        let said = stderr(&output);
        // Several refused keys have a line each, below the one of the program.
        let is_of_a_list = |line: &&str| line.starts_with("  `");
        let below = said.trim_end().lines().rev().take_while(is_of_a_list).count();
        let last: Vec<&str> = said.trim_end().lines().rev().take(below + 1).collect();
        let last = last.into_iter().rev().collect::<Vec<_>>().join("\n");
        // Errors of arguments are clap's, and have several lines.
        let last = if said.starts_with("error: ") { said.replace('\n', " ") } else { last };
        let missing: Vec<_> = words.split(" ... ").filter(|words| !last.contains(words)).collect();
        if output.status.code() != status.parse().ok() || !missing.is_empty() || said.contains("panicked") {
            failed.push(format!("{name}: {:?}, without {missing:?}: {said}", output.status.code()));
        }
    }
    assert!(failed.is_empty(), "{} cases:\n{}", failed.len(), failed.join("\n"));
}

/// Stamps of a recording that are in microseconds are named by their unit, also where a flight goes on.
#[test]
fn stamps_of_a_recording_in_microseconds_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), "3");
    for table in BOTH {
        rows(&folder.path().join(table), |mut row| {
            row[0] = (row[0].parse::<i64>().unwrap() / 1000).to_string();
            row
        });
    }
    let words = "that they are in microseconds; write them in nanoseconds";
    let flown = plumbline(&["replay", &path]);
    assert!(stderr(&flown).contains(words), "{}", stderr(&flown));
    let checked = plumbline(&["doctor", &path]);
    let text = String::from_utf8_lossy(&checked.stdout);
    assert!(checked.status.code() == Some(1) && text.contains(words), "{text}");
}
