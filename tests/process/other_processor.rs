//! A build for another processor has the same bits, and each executes what the other has recorded: `make arm64`, `make oldest`.
//!
//! `PLUMBLINE_OTHER` is the command line that starts the other build, an emulator before it as a rule.

use super::digests::{FLIGHTS, flown, recorded};
use std::ffi::OsStr;
use std::path::Path;
use std::process::Command;

fn here() -> Command {
    Command::new(env!("CARGO_BIN_EXE_plumbline"))
}

fn other() -> Command {
    let line = std::env::var("PLUMBLINE_OTHER")
        .expect("PLUMBLINE_OTHER starts the other build: `make arm64`, `make oldest`");
    let mut words = line.split_whitespace();
    let mut command = Command::new(words.next().expect("a command"));
    command.args(words).current_dir(plumbline_test_support::workspace());
    command
}

fn is_as_recorded(name: &str) {
    let flight = FLIGHTS.into_iter().find(|(known, _)| *known == name).unwrap();
    let Some(now) = flown(other(), flight) else { return };
    assert_eq!(now, recorded(name), "{name}: other bits than in tests/digests.toml");
    println!("{name}: the same bits");
}

#[test]
#[ignore = "needs another build: `make arm64`, `make oldest`"]
fn digest_of_the_v1_01_clip() {
    is_as_recorded("v1_01_clip");
}

#[test]
#[ignore = "needs another build: `make arm64`, `make oldest`"]
fn digest_of_the_mh_05_mono_clip() {
    is_as_recorded("mh_05_mono_clip");
}

#[test]
#[ignore = "needs another build: `make arm64`, `make oldest`"]
fn digest_of_a_room() {
    is_as_recorded("room");
}

#[test]
#[ignore = "needs another build: `make arm64`, `make oldest`"]
fn digest_of_a_hall() {
    is_as_recorded("hall");
}

#[test]
#[ignore = "needs another build: `make arm64`, `make oldest`"]
fn digest_of_low_texture() {
    is_as_recorded("low_texture");
}

#[test]
#[ignore = "needs another build: `make arm64`, `make oldest`"]
fn digest_of_a_room_with_one_camera() {
    is_as_recorded("room_mono");
}

#[test]
#[ignore = "needs another build: `make arm64`, `make oldest`"]
fn digest_of_a_room_with_faults() {
    is_as_recorded("room_with_faults");
}

fn succeeds(mut command: Command, arguments: &[&OsStr]) -> serde_json::Value {
    let output = crate::done(command.args(arguments).arg("--json"));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Flies with one build, and executes the log with the other.
fn is_verified(recorder: Command, verifier: Command, folder: &Path) {
    let log = folder.join("flight.mcap");
    let flight =
        ["replay", "sim:room", "--start=2", "--duration=3", "--scale=0.5", "--record"].map(OsStr::new);
    let flown = succeeds(recorder, &[&flight[..], &[log.as_os_str()]].concat());
    let verified = succeeds(verifier, &[OsStr::new("verify"), log.as_os_str()]);
    assert_eq!((&verified["identical"], &verified["complete"]), (&true.into(), &true.into()));
    assert_eq!(verified["same_build"], false, "the other build is another");
    assert_eq!(verified["estimate_digest"], flown["estimate_digest"]);
    assert_eq!(verified["odometry_digest"], flown["odometry_digest"]);
    assert!(verified["estimates_identical"].as_u64().unwrap() >= 50, "{verified}");
}

#[test]
#[ignore = "needs another build: `make arm64`, `make oldest`"]
fn a_log_recorded_here_is_verified_there() {
    is_verified(here(), other(), tempfile::tempdir().unwrap().path());
}

#[test]
#[ignore = "needs another build: `make arm64`, `make oldest`"]
fn a_log_recorded_there_is_verified_here() {
    is_verified(other(), here(), tempfile::tempdir().unwrap().path());
}
