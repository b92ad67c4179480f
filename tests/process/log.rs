//! The flight recorder as its user meets it: `--record`, `verify`, `log`, and what may happen to a log.

use super::{fails, plumbline, stderr, succeeds};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A flight that is quickly rendered.
const FLIGHT: [&str; 7] = ["replay", "sim:low-texture", "--duration", "3", "--scale", "0.5", "--record"];

fn recorded(log: &str, more: &[&str]) -> std::process::Output {
    plumbline(&[&FLIGHT[..], &[log], more].concat())
}

fn json(bytes: &[u8]) -> serde_json::Value {
    serde_json::from_slice(bytes).unwrap()
}

#[test]
fn a_recorded_flight_is_verified_and_flown_again() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("flight.mcap").to_str().unwrap().to_owned();
    let flown = recorded(&log, &["--json"]);
    assert!(flown.status.success(), "{}", stderr(&flown));
    let report = json(&flown.stdout);
    assert_eq!(report["hot_path_allocations"], 0, "recording included");
    assert_eq!(report["recording"]["not_recorded"], 0);
    let verified = succeeds(&["verify", &log, "--json"]);
    let verified = json(&verified.stdout);
    assert_eq!((&verified["identical"], &verified["complete"]), (&true.into(), &true.into()));
    assert_eq!(verified["estimate_digest"], report["estimate_digest"]);
    let again = json(&plumbline(&["replay", &log, "--json"]).stdout);
    assert_eq!(again["estimate_digest"], report["estimate_digest"]);
    assert_eq!(again["odometry_digest"], report["odometry_digest"]);
    assert_eq!(again["config_hash"], report["config_hash"]);
    let contents = plumbline(&["log", &log]);
    let contents = String::from_utf8_lossy(&contents.stdout);
    for part in ["with the flight", "this one", "/input/left", report["config_hash"].as_str().unwrap()] {
        assert!(contents.contains(part), "'{part}' is missing in: {contents}");
    }
    fails(&["replay", "sim:room", "--record", &log], 2, &["flight.mcap: exists", "delete it"]);
    fails(&["replay", "sim:room", "--record", "flight.log"], 2, &["flight.log", ".mcap"]);
    fails(&["verify", "nowhere.mcap"], 2, &["nowhere.mcap"]);
}

#[test]
fn a_changed_byte_of_the_file_fails_the_verification() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("flight.mcap");
    let path = log.to_str().unwrap();
    assert!(recorded(path, &[]).status.success());
    let mut bytes = std::fs::read(&log).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&log, bytes).unwrap();
    fails(&["verify", path], 1, &["flight.mcap: damaged after", "bytes"]);
    // What comes before the damage can be flown.
    let flown = succeeds(&["replay", path, "--json"]);
    assert!(stderr(&flown).contains("the log breaks off") && stderr(&flown).contains("s of data were flown"));
    let report = json(&flown.stdout);
    assert!((5..60).contains(&report["frames"].as_u64().unwrap()), "{}", report["frames"]);
    assert!(report["warnings"].as_array().unwrap().iter().any(|w| w["what"] == "the log breaks off"));
}

#[test]
fn a_killed_recording_is_read_up_to_its_last_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("flight.mcap");
    let path = log.to_str().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_plumbline"));
    command.args(["replay", "sim:low-texture", "--duration", "12", "--scale", "0.5", "--record", path]);
    let mut flying = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    let bytes = |log: &Path| log.metadata().map_or(0, |m| m.len());
    while bytes(&log) < 3_000_000 && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(5));
    }
    // SIGKILL: nothing of the process runs any more.
    flying.kill().unwrap();
    flying.wait().unwrap();
    fails(&["verify", path], 1, &["not complete", "--allow-incomplete"]);
    let verified = succeeds(&["verify", path, "--allow-incomplete", "--json"]);
    let replayed = succeeds(&["replay", path, "--json"]);
    assert!(stderr(&replayed).contains("the log breaks off"), "{}", stderr(&replayed));
    let verified = json(&verified.stdout);
    assert_eq!((&verified["identical"], &verified["truncated"]), (&true.into(), &true.into()));
    assert!(verified["estimates_identical"].as_u64().unwrap() > 10);
}

#[test]
fn a_disk_without_room_ends_the_recording_and_not_the_flight() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("flight.mcap");
    let path = log.to_str().unwrap();
    // A file may have 1000 blocks of a kilobyte: a write beyond fails as on a full disk.
    let script = "trap '' XFSZ; ulimit -f 1000; exec \"$@\"";
    let mut command = Command::new("bash");
    command.args(["-c", script, "bash", env!("CARGO_BIN_EXE_plumbline")]).args(FLIGHT).args([path, "--json"]);
    let flown = command.output().unwrap();
    assert_eq!(flown.status.code(), Some(1), "{}", stderr(&flown));
    assert!(stderr(&flown).contains("recording stopped, the flight continues"), "{}", stderr(&flown));
    assert!(stderr(&flown).contains("the recording failed"), "{}", stderr(&flown));
    let report = json(&flown.stdout);
    assert_eq!(report["frames"], 60);
    assert!(report["recording"]["not_recorded"].as_u64().unwrap() > 0);
    succeeds(&["verify", path, "--allow-incomplete"]);
}
