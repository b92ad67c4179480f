//! ROS bags, written by another implementation than ours, are flown as the data set is that they were made of.

use super::dataset::Folder;
use super::python::interpreter;
use super::{fails, plumbline, stderr, succeeds};
use plumbline_test_support::shared;
use std::path::Path;
use std::process::Command;

/// The digest of the estimates of a flight.
fn digest(arguments: &[&str]) -> String {
    let output = succeeds(&[&["replay", "--json"], arguments].concat());
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(report["completion"].as_f64().unwrap() > 0.3, "{arguments:?} hardly has a pose to compare");
    report["estimate_digest"].as_str().unwrap().to_owned()
}

/// Writes the first frames of a data set as bags: each has its place, the kind of its images, storage and compression.
fn written<'a>(
    python: &Path,
    dataset: &str,
    frames: u32,
    bags: impl IntoIterator<Item = (&'a str, &'a [&'a str])>,
) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/python/write_bag.py");
    let bags = bags.into_iter().map(|(out, how)| [&[out][..], how].concat().join(","));
    let status = Command::new(python).arg(script).args([dataset, &frames.to_string()]).args(bags).status();
    assert!(status.unwrap().success(), "{dataset}");
}

/// The configuration that `replay` makes of the clip: the noise is that of the preset.
fn imported(clip: &str, config: &str) {
    let import = ["config", "import", "--euroc", clip, "--out", config, "--noise", "base"];
    succeeds(&[&import[..], &["--imu-to-vehicle", "180,-70.3,0"]].concat());
}

#[test]
fn a_bag_of_the_clip_gives_the_estimates_of_the_clip_bit_for_bit() {
    let Some(clip) = shared("euroc/V1_01_easy_clip") else { return };
    let Some(python) = interpreter("rosbags, numpy, PIL") else { return };
    let folder = Folder::new();
    let (clip, config) = (clip.to_str().unwrap().to_owned(), folder.at("clip.toml"));
    imported(&clip, &config);
    for (kind, frames) in [("png", 40), ("raw", 12)] {
        let (bag, cut) = (folder.at(kind), format!("0..{frames}"));
        written(&python, &clip, frames, [(bag.as_str(), &[kind, "mcap"][..])]);
        assert_eq!(digest(&[&bag, "--config", &config]), digest(&[&clip, "--frames", &cut]), "{kind}");
    }
    let file = format!("{}/png.mcap", folder.at("png"));
    fails(&["replay", &file], 2, &["png.mcap", "calibration", "--config"]);
    let wrong = ["replay", &file, "--config", &config, "--topic", "imu=/imu9"];
    fails(&wrong, 2, &["/imu9", "/imu0 (sensor_msgs/msg/Imu)"]);
    fails(&["replay", &file, "--config", &config, "--topic", "up=/x"], 2, &["--topic", "left=NAME"]);
    // What else takes recordings takes it: a checkup, and images for a log that holds none.
    let log = folder.at("log.mcap");
    let without = ["--record", &log, "--set", "recorder.images=none"];
    for arguments in [
        &[&["replay", &file, "--config", &config], &without[..]].concat()[..],
        &["verify", &log, "--images", &file],
    ] {
        succeeds(arguments);
    }
    fails(&["doctor", &file, "--config", &config], 4, &["not shown: "]);
    fails(&["verify", &log, "--images", &file, "--topic", "left=/x"], 2, &["/x", "/cam0"]);
}

#[test]
fn bags_of_sqlite_and_ros_1_give_the_estimates_of_the_clip_bit_for_bit() {
    let Some(clip) = shared("euroc/V1_01_easy_clip") else { return };
    let Some(python) = interpreter("rosbags, numpy, PIL") else { return };
    let folder = Folder::new();
    let (clip, config) = (clip.to_str().unwrap().to_owned(), folder.at("clip.toml"));
    imported(&clip, &config);
    let expected = digest(&[&clip, "--frames", "0..12"]);
    let kinds: [&[&str]; 4] = [
        &["raw", "db3", "none", "short"],
        &["raw", "bag", "none", "short"],
        &["png", "bag", "bz2", "short"],
        &["png", "bag", "lz4", "short"],
    ];
    let bags = kinds.map(|how| folder.at(&how.join("-")) + if how[1] == "bag" { ".bag" } else { "" });
    written(&python, &clip, 12, bags.iter().map(String::as_str).zip(kinds));
    for bag in &bags {
        assert_eq!(digest(&[bag, "--config", &config]), expected, "{bag}");
    }
}

#[test]
fn every_command_that_takes_recordings_takes_bags_of_every_kind() {
    let Some(clip) = shared("euroc/V1_01_easy_clip") else { return };
    let Some(python) = interpreter("rosbags, numpy, PIL") else { return };
    let folder = Folder::new();
    let (clip, config) = (clip.to_str().unwrap().to_owned(), folder.at("clip.toml"));
    imported(&clip, &config);
    for storage in ["db3", "bag"] {
        let bag = if storage == "bag" { folder.at("rec.bag") } else { folder.at("rec") };
        written(&python, &clip, 40, [(bag.as_str(), &["png", storage][..])]);
        let file = if storage == "bag" { bag.clone() } else { format!("{bag}/rec.db3") };
        let own = |name: &str| folder.at(&format!("{storage}-{name}"));
        let (log, rig) = (own("log.mcap"), own("rig.toml"));
        let with = ["--config", &config];
        let topics = ["--topic", "left=/cam0/image_raw", "--topic", "right=/cam1/image_raw"];
        let without = ["--record", &log, "--set", "recorder.images=none"];
        for arguments in [
            [&["replay", &file][..], &with, &without, &topics].concat(),
            vec!["verify", &log, "--images", &file],
        ] {
            succeeds(&arguments);
        }
        fails(&["doctor", &file, "--config", &config], 4, &["not shown: "]);
        // Forty frames carried by a vehicle calibrate nothing: the command reads them, and says what it lacks.
        let rigged = plumbline(&["calibrate", "rig", &file, "--config", &config, "--out", &rig]);
        assert!(!rigged.status.success() && !stderr(&rigged).contains("is no bag"), "{}", stderr(&rigged));
        fails(&["replay", &file], 2, &[&file, "calibration", "--config"]);
        let wrong = ["replay", &file, "--config", &config, "--topic", "imu=/imu9"];
        fails(&wrong, 2, &["/imu9", "/imu0 (sensor_msgs/"]);
    }
}

#[test]
fn what_is_called_a_bag_and_is_none_is_refused_with_what_to_give() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, words) in [
        ("cut.db3", &b"SQLite format 3\0"[..], &["cut.db3", "damaged database", ".recover"][..]),
        ("empty.db3", b"", &["empty.db3", "is empty"]),
        ("text.bag", b"not a bag at all", &["text.bag", "is no bag", "rosbag record"]),
        ("old.bag", b"#ROSBAG V1.2\n rest", &["old.bag", "another version", "rosbag fix"]),
        (
            "packed.mcap.zstd",
            b"\x28\xb5\x2f\xfd and no frame",
            &["packed.mcap.zstd", "compressed by Zstandard", "zstd -d"],
        ),
    ] {
        let file = folder.path().join(name);
        std::fs::write(&file, bytes).unwrap();
        fails(&["replay", file.to_str().unwrap(), "--config", "euroc"], 2, words);
    }
    let folder = folder.path().to_str().unwrap();
    fails(&["replay", folder, "--config", "euroc"], 2, &["bags of different names", "name one"]);
}
