//! Everyday use: warnings of nonsense, parts of recordings, cures that help.

use super::dataset::{Folder, dataset};
use super::{fails, plumbline, stderr, succeeds};
use serde_json::Value;

/// The report of a replay, and what it said on stderr.
fn replayed(arguments: &[&str]) -> (Value, String) {
    let mut all = vec!["replay"];
    all.extend(arguments);
    all.push("--json");
    let output = plumbline(&all);
    let report =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {}", stderr(&output)));
    (report, stderr(&output))
}

#[test]
fn a_unit_that_is_wrong_is_warned_of_once_and_its_consequences_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), "3");
    let (sound, said) = replayed(&[&path]);
    assert_eq!((sound["warnings"].as_array().unwrap().len(), said.as_str()), (0, ""));
    let table = format!("{path}/mav0/imu0/data.csv");
    let text = std::fs::read_to_string(&table).unwrap();
    let cases = [
        (4..7, 1.0 / 9.806_65, "units of gravity", "9.80665"),
        (1..4, 57.295_78, "degrees a second", "pi/180"),
    ];
    for (columns, factor, cause, cure) in cases {
        let scaled = |(k, cell): (usize, &str)| match columns.contains(&k) {
            true => (cell.parse::<f64>().unwrap() * factor).to_string(),
            false => cell.to_owned(),
        };
        let row = |line: &str| match line.starts_with('#') {
            true => line.to_owned(),
            false => line.split(',').enumerate().map(scaled).collect::<Vec<_>>().join(","),
        };
        std::fs::write(&table, text.lines().map(row).collect::<Vec<_>>().join("\n")).unwrap();
        let (report, said) = replayed(&[&path]);
        assert_eq!(said.matches(cause).count(), 1, "{said}");
        assert!(!said.contains('\u{1b}'), "colours in a file: {said}");
        // All else is a consequence.
        let warnings = report["warnings"].as_array().unwrap();
        assert!(matches!(&warnings[..], [w] if w["cure"].as_str().unwrap().contains(cure)), "{warnings:?}");
    }
}

#[test]
fn a_camera_that_the_configuration_names_and_images_that_are_missing_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight").to_str().unwrap().to_owned();
    succeeds(&["simulate", &path, "--duration", "0.5"]);
    std::fs::remove_dir_all(format!("{path}/mav0/cam1")).unwrap();
    let mut images: Vec<_> =
        std::fs::read_dir(format!("{path}/mav0/cam0/data")).unwrap().map(|e| e.unwrap().path()).collect();
    images.sort();
    std::fs::remove_file(&images[5]).unwrap();
    std::fs::write(&images[6], b"no image").unwrap();
    let output = plumbline(&["replay", &path, "--config", "sim"]);
    let said = stderr(&output);
    assert!(said.contains("1 images or frames missing, 1 images that cannot be decoded"), "{said}");
    assert!(said.contains("holds no cam1") && said.contains("--mono"), "{said}");
}

#[test]
fn parts_of_a_recording_are_flown_by_their_seconds() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), "3");
    let frames = |arguments: &[&str]| {
        let mut all = vec![path.as_str()];
        all.extend(arguments);
        replayed(&all).0["frames"].as_u64().unwrap()
    };
    assert_eq!(frames(&[]), 60);
    assert_eq!(frames(&["--start", "0.5", "--stop", "1.5"]), 20);
    assert_eq!(frames(&["--start", "0.5", "--duration", "1"]), 20);
    assert_eq!(frames(&["--stop", "1"]), 20);
    let log = folder.path().join("flight.mcap");
    let log = log.to_str().unwrap();
    succeeds(&["replay", &path, "--record", log]);
    let (report, _) = replayed(&[log, "--start", "0.5", "--stop", "1.5"]);
    assert_eq!(report["frames"], 20);
    let (report, _) = replayed(&["sim:room", "--scale", "0.5", "--start", "3", "--stop", "4"]);
    assert_eq!(report["frames"], 20);
    fails(
        &["replay", &path, "--start", "50"],
        2,
        &["s of frames, of which what comes after 50 s holds none"],
    );
}

/// The truth of a simulated data set as TUM, with its stamps shifted.
fn truth(flight: &str, shift_s: i64, out: &str) {
    let table =
        std::fs::read_to_string(format!("{flight}/mav0/state_groundtruth_estimate0/data.csv")).unwrap();
    let rows = table.lines().filter(|line| !line.starts_with('#')).map(|line| {
        let row: Vec<&str> = line.split(',').map(str::trim).collect();
        let ns = row[0].parse::<i64>().unwrap() + shift_s * 1_000_000_000;
        format!("{:.9} {}\n", ns as f64 * 1e-9, [1, 2, 3, 5, 6, 7, 4].map(|k| row[k]).join(" "))
    });
    std::fs::write(out, rows.collect::<String>()).unwrap();
}

#[test]
fn a_truth_of_another_flight_is_refused_with_both_spans() {
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), "3");
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (own, other, estimate) = (at("own.tum"), at("other.tum"), at("estimate.tum"));
    truth(&path, 0, &own);
    truth(&path, 5_000, &other);
    let sound = succeeds(&["replay", &path, "--truth", &own, "--trajectory", &estimate]);
    // A truth without velocities is compared without them.
    let summary = String::from_utf8_lossy(&sound.stdout).into_owned();
    assert!(summary.contains("velocity unknown") && !summary.contains("velocity 0.000"), "{summary}");
    let words = [
        "--truth",
        "other.tum",
        "0 of ",
        "the truth runs from ",
        "the flight from ",
        "evaluate --time-offset",
    ];
    fails(&["replay", &path, "--truth", &other], 1, &words);
    fails(&["evaluate", &estimate, &other], 1, &["estimate.tum against ", "other.tum", "no stamps within"]);
    let own = plumbline(&["evaluate", &estimate, &own]);
    let shifted = plumbline(&["evaluate", &estimate, &other, "--time-offset", "5000"]);
    assert!(own.status.success() && stderr(&own).is_empty(), "{}", stderr(&own));
    let ate = |output: &std::process::Output| {
        String::from_utf8_lossy(&output.stdout).lines().nth(1).map(str::to_owned)
    };
    assert_eq!(ate(&own), ate(&shifted));
}

#[test]
fn a_simulated_flight_with_options_is_a_recording_for_all_that_fly_one() {
    let flight = "sim:room?start=3&duration=1&scale=0.5";
    let (named, _) = replayed(&[flight]);
    let (given, _) = replayed(&["sim:room", "--start", "3", "--duration", "1", "--scale", "0.5"]);
    assert_eq!((&named["estimate_digest"], named["frames"].as_u64()), (&given["estimate_digest"], Some(20)));
    let looked = plumbline(&["doctor", flight, "--json"]);
    let report: Value =
        serde_json::from_slice(&looked.stdout).unwrap_or_else(|_| panic!("{}", stderr(&looked)));
    let timing =
        report["measures"].as_array().unwrap().iter().find(|m| m["name"] == "camera timing").unwrap();
    assert_eq!(timing["figures"]["rate_hz"].as_f64().map(f64::round), Some(20.0), "{timing}");
    fails(&["verify", flight], 2, &["sim:room?", "plumbline simulate FOLDER", "--record LOG.mcap"]);
}

#[test]
fn the_truth_is_written_at_the_times_of_the_poses() {
    let folder = Folder::new();
    let (poses, truth) = (folder.at("poses.tum"), folder.at("truth.tum"));
    let outputs = ["--trajectory", &poses, "--true-trajectory", &truth];
    succeeds(&[&["replay", "sim:room?start=3&duration=1&scale=0.5"], &outputs[..]].concat());
    let stamps = |file: &str| {
        let text = std::fs::read_to_string(file).unwrap();
        text.lines().map(|row| row.split(' ').next().unwrap().to_owned()).collect::<Vec<_>>()
    };
    assert!(stamps(&poses).len() > 5 && stamps(&poses) == stamps(&truth), "the truth at the same times");
}

#[test]
fn calibrating_cameras_is_listed_and_without_opencv_says_how_to_build_with_it() {
    let help = String::from_utf8_lossy(&plumbline(&["calibrate", "--help"]).stdout).into_owned();
    let words: Vec<&str> = help.split_whitespace().collect();
    assert!(words.join(" ").contains("make calibration"), "{help}");
    let camera = ["calibrate", "camera", "nowhere", "--out", "my.toml", "--target"];
    let with = |target| [camera.as_slice(), &[target]].concat();
    let wrong = plumbline(&with("aprilgrid:6x6:88:0.3"));
    assert!(wrong.status.code() == Some(2) && stderr(&wrong).contains("in metres"), "{}", stderr(&wrong));
    fails(&with("aprilgrid:6x6:0.088:0.3"), 2, &["no OpenCV", "make calibration", "--features calibration"]);
}
