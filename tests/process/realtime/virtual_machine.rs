//! `plumbline fly` behind a real kernel, in a virtual machine (`scripts/vm`): two of the kernel's virtual cameras, and an
//! IMU at an emulated serial port that this side plays.

use crate::hardware::{Epoch, Microcontroller, Recording, Trouble};
use crate::plumbline;
use plumbline_test_support::{Need, skip, workspace};
use serde_json::Value;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Slow enough for emulated processors on a busy host.
const FRAME_RATE_HZ: f64 = 5.0;
const IMU_RATE_HZ: i64 = 100;
/// Duration for which both cameras are unplugged, s.
const UNPLUGGED_S: f64 = 2.0;

/// Configuration of the machine: small images, and little work on them.
fn config(folder: &Path) -> String {
    let preset = String::from_utf8(plumbline(&["config", "sim"]).stdout).unwrap();
    let mut text = String::new();
    let mut table = String::new();
    for line in preset.lines() {
        if line.starts_with('[') {
            table = line.to_owned();
        }
        let key = line.split(" = ").next().unwrap_or_default();
        let value = match (table.as_str(), key) {
            ("[[camera]]", "width_px") => "320",
            ("[[camera]]", "height_px") => "180",
            ("[[camera]]", "rate_hz") => "5.0",
            ("[[camera]]", "focal_px") => "[190.0, 190.0]",
            ("[[camera]]", "centre_px") => "[160.0, 90.0]",
            ("[imu]", "rate_hz") => "100.0",
            ("[estimator.points]", "max_points") => "40",
            ("[estimator.lines]" | "[estimator.places]", "enabled") | ("[runtime]", "realtime") => "false",
            ("[driver.v4l2]", "left") => "\"/dev/v4l/by-path/platform-vivid.0-port0-video-index0\"",
            ("[driver.v4l2]", "right") => "\"/dev/v4l/by-path/platform-vivid.0-port1-video-index0\"",
            // Its stamps are of the end of frames that have not ended yet, unless told otherwise.
            ("[driver.v4l2]", "controls") => "[\"timestamp_source=1\"]",
            _ => {
                text += &format!("{line}\n");
                continue;
            }
        };
        text += &format!("{key} = {value}\n");
    }
    let file = folder.join("fly.toml").display().to_string();
    std::fs::write(&file, text).unwrap();
    file
}

/// Plays an IMU at rest to whoever asks at the other end of the socket.
fn play(socket: &Path, seconds: i64) {
    let end = Instant::now() + Duration::from_secs(120);
    let connected = loop {
        match UnixStream::connect(socket) {
            Ok(connected) => break connected,
            Err(_) if Instant::now() > end => return,
            Err(_) => std::thread::sleep(Duration::from_millis(50)),
        }
    };
    let mut imu = Microcontroller::at(connected);
    if imu.is_asked_within(Duration::from_secs(240)) {
        let recording = Recording::at_rest(IMU_RATE_HZ, seconds);
        let epoch = Epoch::in_ms(&recording, 10);
        imu.play(&recording, epoch, 0..recording.readings.len(), &Trouble::none());
    }
}

/// The JSON between two marks of what the machine said.
fn between(said: &str, from: &str, to: &str) -> Value {
    let part = said.split(from).nth(1).and_then(|rest| rest.split(to).next());
    let part = part.unwrap_or_else(|| panic!("no {from} in {said}"));
    serde_json::from_str(part).unwrap_or_else(|error| panic!("{error}: {part}"))
}

/// A copy of the command without what only backtraces need: the machine holds it in memory.
fn stripped(folder: &Path) -> String {
    let copy = folder.join("plumbline").display().to_string();
    let strip = ["--strip-debug", "-o", &copy, env!("CARGO_BIN_EXE_plumbline")];
    if !Command::new("strip").args(strip).status().is_ok_and(|status| status.success()) {
        std::fs::copy(env!("CARGO_BIN_EXE_plumbline"), &copy).unwrap();
    }
    copy
}

#[test]
fn a_flight_with_the_cameras_of_a_real_kernel_survives_their_being_unplugged() {
    let script = workspace().join("scripts/vm");
    let check = Command::new(&script).arg("check").output().expect("the script is there");
    if !check.status.success() {
        return skip(Need::VirtualMachine, String::from_utf8_lossy(&check.stderr).trim());
    }
    let seconds = std::env::var("PLUMBLINE_VM_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(15_i64);
    let folder = tempfile::tempdir().unwrap();
    let (socket, files) = (folder.path().join("serial"), [stripped(folder.path()), config(folder.path())]);
    let mut command = Command::new(&script);
    command.arg("run").arg(workspace().join("tests/vm/fly")).arg(seconds.to_string());
    command.env("VM_FILES", files.join(" ")).env("VM_SERIAL", &socket).env("VM_MEMORY", "1024");
    command.env("VM_TIMEOUT", (seconds + 240).to_string());
    let machine = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let output = std::thread::scope(|scope| {
        scope.spawn(|| play(&socket, seconds + 5));
        machine.wait_with_output().unwrap()
    });
    let (said, console) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{said}{console}");
    let devices = between(&said, "plumbline-vm-devices", "plumbline-vm-report");
    assert_eq!(devices["cameras"].as_array().unwrap().len(), 2, "{devices}");
    assert_eq!(devices["cameras"][1]["name"], "/dev/v4l/by-path/platform-vivid.0-port1-video-index0");
    let report = between(&said, "plumbline-vm-report", "plumbline-vm-end");
    println!("{seconds} s in the machine: {:#}\n{:#}", report["sensors"], report["live"]);
    check_figures(&report, seconds as f64);
}

fn check_figures(report: &Value, seconds: f64) {
    let (cameras, imu) = (&report["sensors"]["cameras"], &report["sensors"]["imu"]);
    let number =
        |of: &Value, key: &str| of[key].as_f64().unwrap_or_else(|| panic!("{key} is missing in {of}"));
    // Frames that came, and those that are missing by their numbers, are those of the time; opening takes some of it.
    let all = number(cameras, "count") + number(cameras, "missing");
    let expected = seconds * FRAME_RATE_HZ;
    assert!(all > 0.75 * expected - 10.0 && all < 1.05 * expected + 4.0, "{all} of {expected}: {cameras}");
    assert!(number(cameras, "pairs") > 0.4 * (seconds - UNPLUGGED_S) * FRAME_RATE_HZ, "{cameras}");
    assert!(number(cameras, "longest_gap_ms") > 0.9e3 * UNPLUGGED_S, "{cameras}");
    for camera in cameras["v4l2"]["cameras"].as_array().unwrap() {
        assert_eq!(
            (&camera["started"], &camera["lost"], &camera["restamped"]),
            (&2.into(), &1.into(), &0.into())
        );
    }
    assert_eq!(cameras["trouble"], serde_json::json!([null, null]));
    // Nothing is lost on the line. A host that starves the machine for seconds makes it doubt the sensor's clock, and learn
    // it afresh: then samples are not handed out, and count as missing.
    let handed_out = number(imu, "count");
    let came = handed_out + number(imu, "missing") + number(imu, "settling");
    assert!(came > 0.6 * seconds * IMU_RATE_HZ as f64, "{imu}");
    assert_eq!((&imu["line"]["bad_checksums"], &imu["line"]["passed_over"]), (&0.into(), &0.into()), "{imu}");
    let is_calm = number(&imu["clock"], "restarts") == 0.0;
    assert!(!is_calm || handed_out > 0.5 * seconds * IMU_RATE_HZ as f64 && imu["missing"] == 0, "{imu}");
    assert!(number(&imu["clock"], "round_trips") > 0.0, "{imu}");
    assert_eq!((&imu["opened"], &imu["lost"]), (&1.into(), &0.into()), "{imu}");
    assert_eq!((number(cameras, "allocations"), number(imu, "allocations")), (0.0, 0.0));
}
