//! One rule for the exit status of every command: 2 for what is asked wrongly or is not there, 1 for what fails.

use super::dataset::{Folder, dataset};
use super::{plumbline, stderr};

/// Every command that takes an input, with one that is not there.
const MISSING: [&[&str]; 18] = [
    &["replay", "/nowhere/flight"],
    &["replay", "/nowhere/flight.mcap"],
    &["replay", "sim:room", "--path", "/nowhere/path.tum"],
    &["replay", "sim:room", "--config", "/nowhere/config.toml"],
    &["replay", "FLIGHT", "--truth", "/nowhere/truth.tum"],
    &["replay", "sim:room", "--trajectory", "/nowhere/out.tum"],
    &["replay", "sim:room", "--record", "/nowhere/out.mcap"],
    &["fly", "--config", "/nowhere/drone.toml"],
    &["verify", "/nowhere/flight.mcap"],
    &["log", "/nowhere/flight.mcap"],
    &["evaluate", "/nowhere/a.tum", "/nowhere/b.tum"],
    &["config", "/nowhere/config.toml"],
    &["doctor", "--config", "/nowhere/config.toml"],
    &["doctor", "/nowhere/flight"],
    &["simulate", "OUT", "--config", "/nowhere/config.toml"],
    &["simulate", "OUT", "--path", "/nowhere/path.tum"],
    &["ground", "--report", "/nowhere/report.json"],
    &["router", "--listen", "tcp/127.0.0.1:0", "--users-file", "/nowhere/users"],
];

/// Wrong usage of every command.
const WRONG: [&[&str]; 33] = [
    &[],
    &["fly-away"],
    &["replay"],
    &["replay", "sim:moon"],
    &["replay", "sim:room?durations=3"],
    &["replay", "sim:room?duration=3", "--seed", "2"],
    &["replay", "sim:room?duration=3", "--stop", "2"],
    &["verify", "sim:room?duration=3"],
    &["log", "sim:room?duration=3"],
    &["calibrate", "rig", "sim:room?duration=3", "--out", "OUT"],
    &["replay", "sim:room", "--trajectory", "OUT/"],
    &["replay", "sim:room", "--speed", "-1"],
    &["replay", "sim:room", "--speed", "0"],
    &["replay", "sim:room", "--set", "estimator.points.sigma_px=-1"],
    &["replay", "sim:room", "--set", "camera[7].focal_px=1"],
    &["replay", "sim:room", "--frames", "1..5"],
    &["replay", "sim:room", "--duration", "5", "--blackout", "6..7"],
    &["replay", "sim:room", "--trajectory", "OUT", "--odometry", "OUT"],
    &["replay", "sim:room", "--autopilot", "udp://127.0.0.1:1"],
    &["replay", "FLIGHT", "--blackout", "1..2"],
    &["replay", "FLIGHT", "--seed", "7"],
    &["replay", "FLIGHT", "--cache", "OUT"],
    &["replay", "FLIGHT", "--start", "5", "--stop", "4"],
    &["fly"],
    &["fly", "--config", "sim"],
    &["fly", "--config", "sim", "--record", "/nowhere/log"],
    &["simulate", "OUT", "--scene", "moon"],
    &["evaluate", "a.tum"],
    &["doctor", "--config", "euroc", "--watch", "0"],
    &["doctor", "--config", "euroc", "--seconds", "3"],
    &["doctor", "sim:room", "--seconds", "0"],
    &["keys", "OUT", "--vehicle", "../x"],
    &["ground", "--connect", "nowhere"],
];

#[test]
fn what_is_asked_wrongly_or_is_not_there_is_2_and_told_in_words() {
    let folder = Folder::new();
    let (flight, out) = (dataset(folder.path(), "0.5"), folder.at("out"));
    for arguments in MISSING.into_iter().chain(WRONG) {
        let arguments: Vec<&str> = arguments
            .iter()
            .map(|argument| match *argument {
                "FLIGHT" => flight.as_str(),
                "OUT" => out.as_str(),
                "OUT/" => "logs-that-are-not-there/",
                argument => argument,
            })
            .collect();
        let output = plumbline(&arguments);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(!said.is_empty() && !said.contains("panicked"), "{arguments:?}: {said}");
    }
}

#[test]
fn what_fails_is_1() {
    let folder = Folder::new();
    let (a, b, flight) = (folder.at("a.tum"), folder.at("b.tum"), dataset(folder.path(), "0.5"));
    std::fs::write(&a, "1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n").unwrap();
    std::fs::write(&b, "100.0 0 0 0 0 0 0 1\n101.0 1 0 0 0 0 0 1\n").unwrap();
    assert_eq!(plumbline(&["evaluate", &a, &b]).status.code(), Some(1));
    // A device that is always full.
    let full = plumbline(&["replay", &flight, "--trajectory", "/dev/full"]);
    assert_eq!(full.status.code(), Some(1), "{}", stderr(&full));
    assert!(stderr(&full).contains("/dev/full"), "{}", stderr(&full));
}

#[test]
fn a_reader_of_stdout_that_has_gone_fails_no_command() {
    let folder = tempfile::tempdir().unwrap();
    let [report, data] = ["report.json", "flight"].map(|name| folder.path().join(name).display().to_string());
    let flight = ["sim:room", "--scale", "0.5", "--duration", "1"];
    let commands: [&[&str]; 4] = [
        &["replay", flight[0], flight[1], flight[2], flight[3], flight[4], "--report", &report],
        &["simulate", &data, "--scale", "0.5", "--duration", "1"],
        &["config", "euroc"],
        &["completions", "bash"],
    ];
    for command in commands {
        // A pipe whose reader goes before anything is written.
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_plumbline"))
            .args(command)
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{command:?}: {}", stderr(&output));
    }
    let report = crate::json(report);
    assert!(report["frames"].as_u64().is_some_and(|frames| frames > 0), "{report}");
    assert!(std::path::Path::new(&data).join("mav0/imu0/data.csv").is_file());
}
