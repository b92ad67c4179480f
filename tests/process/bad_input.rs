//! Every bad input of a first use: one line that names cause and cure, and the right exit status.

use super::dataset::{copy, dataset};
use super::{plumbline, stderr};
use std::fs;
use std::path::{Path, PathBuf};

/// Damages a copy of a sound data set, or of a configuration.
type Damage = fn(&Path);

/// A command, where FLIGHT is the damaged data set, TOML a configuration and FOLDER the folder of both; the status that it ends
/// with, what its last line says, with `...` between, and how its input is damaged.
struct Case {
    name: &'static str,
    command: &'static str,
    status: i32,
    words: &'static str,
    damage: Damage,
}

/// What is refused.
const fn case(name: &'static str, command: &'static str, words: &'static str, damage: Damage) -> Case {
    Case { name, command, status: 2, words, damage }
}

/// What is judged, and not fit to fly.
const fn unfit(name: &'static str, command: &'static str, words: &'static str, damage: Damage) -> Case {
    Case { status: 1, ..case(name, command, words, damage) }
}

/// Table of inertial samples, and of the left images.
const IMU: &str = "flight/mav0/imu0/data.csv";
const LEFT: &str = "flight/mav0/cam0/data.csv";
const BOTH: [&str; 3] = [IMU, LEFT, "flight/mav0/cam1/data.csv"];

fn none(_: &Path) {}

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

const CASES: &[Case] = &[
    case(
        "images of another size than the configuration's",
        "replay FLIGHT --config euroc",
        "images are 376x240 ... 752x480 ... use the calibration of this data set",
        none,
    ),
    case(
        "stamps of the IMU in seconds",
        "replay FLIGHT",
        "imu0/data.csv ... line 2 ... if it is in seconds, multiply it by 1e9",
        |folder| rows(&folder.join(IMU), in_seconds),
    ),
    case(
        "stamps of the images in seconds",
        "replay FLIGHT",
        "cam0/data.csv ... multiply it by 1e9",
        |folder| rows(&folder.join(LEFT), in_seconds),
    ),
    case(
        "no ground truth",
        "evaluate EST FLIGHT",
        "holds no mav0/state_groundtruth_estimate0/data.csv ... give a trajectory file",
        |folder| fs::remove_dir_all(folder.join("flight/mav0/state_groundtruth_estimate0")).unwrap(),
    ),
    case(
        "ground truth of positions alone",
        "evaluate EST FLIGHT",
        "leica0/data.csv ... positions without attitudes ... give a trajectory file",
        |folder| {
            let truth = folder.join("flight/mav0/state_groundtruth_estimate0");
            fs::rename(truth, folder.join("flight/mav0/leica0")).unwrap();
        },
    ),
    case(
        "inertial samples without stamps",
        "replay FLIGHT",
        "imu0/data.csv ... not stamped ... have the stamp 0 ... record again",
        |folder| rows(&folder.join(IMU), |row| [&["0".to_owned()], &row[1..]].concat()),
    ),
    case("images in another format", "replay FLIGHT", "cam1/data ... convert the images to PNG", |folder| {
        for image in fs::read_dir(folder.join("flight/mav0/cam1/data")).unwrap() {
            fs::write(image.unwrap().path(), b"II*\0no PNG").unwrap();
        }
    }),
    case("a folder of logs", "verify FOLDER", "is a folder ... /*.mcap", |folder| {
        fs::write(folder.join("flight.mcap"), "").unwrap()
    }),
    case("a folder without logs", "verify FOLDER", "is a folder without flight logs ... --record", none),
    case(
        "a start beyond the end",
        "replay FLIGHT --start 100",
        "0.450 s of frames, of which what comes after 100 s holds none ... choose others",
        none,
    ),
    case(
        "frames beyond the end",
        "replay FLIGHT --frames 500..",
        "frames 0..10, of which 500.. holds none",
        none,
    ),
    case(
        "a key of another estimator",
        "config TOML",
        "drone.toml ... max_features ... unknown key ... did you mean",
        |folder| {
            let file = folder.join("drone.toml");
            let text = fs::read_to_string(&file).unwrap();
            fs::write(&file, text.replacen("max_iterations = ", "max_features = ", 1)).unwrap();
        },
    ),
    case(
        "a mounting in words",
        "config TOML",
        "vehicle.imu_to_vehicle_deg ... a list of 3 numbers or \"unknown\" is expected",
        |folder| set(folder, "imu_to_vehicle_deg", "\"upright\""),
    ),
    case(
        "an unset device",
        "config TOML",
        "drone.toml ... driver.v4l2.left ... CHANGE-ME ... plumbline devices",
        |folder| set(folder, "left", "\"/dev/v4l/by-path/CHANGE-ME-video-index0\""),
    ),
    case(
        "a flight with an unset device",
        "fly --config TOML",
        "drone.toml ... driver.v4l2.left ... CHANGE-ME ... plumbline devices",
        |folder| set(folder, "left", "\"/dev/v4l/by-path/CHANGE-ME-video-index0\""),
    ),
    case(
        "a preset of a rig that was not set",
        "fly --config mipi-stereo",
        "2 keys refused\n  `driver.v4l2.left`:  ... \n  `driver.v4l2.right`:  ... CHANGE-ME",
        none,
    ),
    case(
        "a value of another type",
        "config TOML",
        "camera[0].rate_hz ... (line  ... invalid type: string",
        |folder| set(folder, "rate_hz", "\"20 Hz\""),
    ),
    case(
        "defaults as a configuration",
        "replay FLIGHT --config defaults",
        "defaults: no configuration by themselves ... plumbline config defaults ... euroc, sim",
        none,
    ),
    case(
        "a preset whose name is mistyped",
        "replay FLIGHT --config realsense",
        "did you mean realsense-d435i or realsense-d455?",
        none,
    ),
    case(
        "an autopilot and an unknown mounting",
        "replay FLIGHT --config TOML --speed 1 --autopilot udp://127.0.0.1:14540",
        "vehicle.imu_to_vehicle_deg is \"unknown\" ... wrong attitude ... plumbline doctor --live",
        |folder| set(folder, "imu_to_vehicle_deg", "\"unknown\""),
    ),
    case(
        "ROS 2 and an unknown mounting",
        "replay FLIGHT --config TOML --speed 1 --publish --set ros.enabled=true",
        "vehicle.imu_to_vehicle_deg is \"unknown\" ... ROS 2 ... plumbline doctor --live",
        |folder| set(folder, "imu_to_vehicle_deg", "\"unknown\""),
    ),
    case(
        "a rig without a mounting",
        "config import --euroc FLIGHT --out OUT",
        "--imu-to-vehicle ... roll,pitch,yaw ... unknown",
        |folder| {
            let file = folder.join("flight/mav0/imu0/sensor.yaml");
            let text = fs::read_to_string(&file).unwrap();
            let lines = text.lines().filter(|line| !line.starts_with("imu_to_vehicle_deg"));
            fs::write(&file, lines.collect::<Vec<_>>().join("\n")).unwrap();
        },
    ),
    case(
        "a mounting that is none",
        "config import --euroc FLIGHT --out OUT --imu-to-vehicle 1,2",
        "--imu-to-vehicle ... three angles in degrees",
        none,
    ),
    case(
        "a map of one camera",
        "replay FLIGHT --mono --save-map OUT",
        "--save-map: a map needs two cameras ... leave it out",
        none,
    ),
    case(
        "a map of a data set without its second camera",
        "replay FLIGHT --save-map OUT",
        "--save-map: a map needs two cameras",
        |folder| {
            fs::remove_dir_all(folder.join("flight/mav0/cam1")).unwrap();
        },
    ),
    case(
        "a map without places",
        "replay FLIGHT --save-map OUT --set estimator.places.enabled=false",
        "--save-map: estimator.places.enabled is false",
        none,
    ),
    case(
        "another separator",
        "replay FLIGHT",
        "imu0/data.csv ... line 2 ... commas separate columns",
        |folder| {
            let table = folder.join(IMU);
            fs::write(&table, fs::read_to_string(&table).unwrap().replace(',', ";")).unwrap();
        },
    ),
    case(
        "clocks that have nothing in common",
        "replay FLIGHT",
        "imu0/data.csv ... the IMU was recorded from ... the images from",
        |folder| {
            rows(&folder.join(IMU), |mut row| {
                row[0] = (row[0].parse::<i64>().unwrap() + 3_600_000_000_000).to_string();
                row
            });
        },
    ),
    case("no images", "doctor FLIGHT", "none of the 10 images ... copy them here", |folder| {
        for camera in ["cam0", "cam1"] {
            fs::remove_dir_all(folder.join(format!("flight/mav0/{camera}/data"))).unwrap();
        }
    }),
    case("no inertial samples", "replay FLIGHT", "imu0", |folder| {
        fs::write(folder.join(IMU), "#timestamp [ns],w,w,w,a,a,a\n").unwrap()
    }),
    case("a focal length below zero", "replay FLIGHT", "camera[0].focal_px", |folder| {
        let file = folder.join("flight/mav0/cam0/sensor.yaml");
        let text = fs::read_to_string(&file).unwrap();
        fs::write(&file, text.replace("intrinsics: [", "intrinsics: [-")).unwrap();
    }),
    case("a folder that is no data set", "replay FOLDER", "case-", none),
    case("an empty table", "replay FLIGHT", "cam0/data.csv ... has no rows", |folder| {
        fs::write(folder.join(LEFT), "#timestamp [ns],filename\n").unwrap()
    }),
    case(
        "images in microseconds beside samples in nanoseconds",
        "replay FLIGHT",
        "the stamps of the images are 1000 times smaller ... are they in microseconds?",
        |folder| {
            for table in &BOTH[1..] {
                rows(&folder.join(table), |mut row| {
                    row[0] = (row[0].parse::<i64>().unwrap() / 1000).to_string();
                    row
                });
            }
        },
    ),
    case(
        "a trajectory of a simulated flight that was not flown",
        "evaluate sim:room FLIGHT",
        "is a simulated flight, which holds no trajectory ... --trajectory out.tum",
        none,
    ),
    case(
        "a trajectory that is not there",
        "evaluate /nowhere/est.tum FLIGHT",
        "/nowhere/est.tum ... does not exist; give a trajectory file",
        none,
    ),
    case(
        "a key without its section",
        "replay FLIGHT --set max_points=200",
        "did you mean `estimator.points.max_points`?",
        none,
    ),
    case(
        "files of Kalibr that are exchanged",
        "config import --camchain IMU.yaml --imu IMU.yaml --imu-to-vehicle 0,0,0 --out OUT",
        "imu.yaml ... --camchain and --imu exchanged",
        |folder| fs::write(folder.join("imu.yaml"), "update_rate: 200.0\n").unwrap(),
    ),
    unfit("exchanged columns", "doctor FLIGHT", "not fit to fly ... units and columns", |folder| {
        rows(&folder.join(IMU), |row| [&row[..1], &row[4..7], &row[1..4]].concat());
    }),
    unfit(
        "a host with a preset that was not set",
        "doctor --config mipi-stereo --watch 0.1",
        "not fit to fly ... configuration",
        none,
    ),
];

/// A simulated data set of half a second, a configuration and a trajectory.
fn sound(folder: &Path) -> PathBuf {
    let sound = folder.join("sound");
    fs::create_dir(&sound).unwrap();
    let flight = dataset(&sound, "0.5");
    fs::write(sound.join("drone.toml"), plumbline(&["config", "sim"]).stdout).unwrap();
    // A configuration for these images, of half the size.
    let imported = sound.join("drone.toml");
    let scaled = ["config", "import", "--euroc", &flight, "--out", imported.to_str().unwrap()];
    let imported = plumbline(&[&scaled[..], &["--base", "sim", "--overwrite"]].concat());
    assert!(imported.status.success(), "{}", stderr(&imported));
    fs::write(sound.join("est.tum"), "1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n").unwrap();
    sound
}

#[test]
fn every_bad_input_is_named_with_its_cure_and_ends_with_the_right_status() {
    let folder = tempfile::tempdir().unwrap();
    let sound = sound(folder.path());
    let mut failed = Vec::new();
    for (index, case) in CASES.iter().enumerate() {
        let damaged = folder.path().join(format!("case-{index}"));
        copy(&sound, &damaged);
        (case.damage)(&damaged);
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
        let arguments: Vec<String> = case.command.split(' ').map(place).collect();
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
        let missing: Vec<_> = case.words.split(" ... ").filter(|words| !last.contains(words)).collect();
        if output.status.code() != Some(case.status) || !missing.is_empty() || said.contains("panicked") {
            failed.push(format!("{}: {:?}, without {missing:?}: {said}", case.name, output.status.code()));
        }
    }
    assert!(failed.is_empty(), "{} of {} cases:\n{}", failed.len(), CASES.len(), failed.join("\n"));
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
