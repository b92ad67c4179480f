//! `plumbline fly` under the rules of our systemd unit, killed in flight: it comes back by itself, and the autopilot learns that the
//! origin is another.

use super::supervisor::{Seen, Supervisor, Unit};
use crate::hardware::{Epoch, Microcontroller, Recording, Trouble, send_frames};
use crate::realtime::autopilot::{Autopilot, gaps_ms, is_tracking, list};
use crate::realtime::hardware_in_the_loop::Rig;
use crate::{plumbline, succeeds};
use plumbline_drivers::clock::monotonic_ns;
use serde_json::Value;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Length of the recording, s; when frames begin, and when the process is killed.
const END_S: f64 = 9.5;
const FRAMES_S: f64 = 1.5;
const KILL_S: f64 = 5.0;

/// Sends what is still to come to whoever listens, until the end of the recording.
fn frames_to_anybody(path: &Path, recording: &Recording, epoch: Epoch) {
    let first_ns = recording.readings[0].sample.stamp.as_nanos() + (FRAMES_S * 1e9) as i64;
    loop {
        let now_ns = epoch.data(monotonic_ns()).max(first_ns);
        let next = recording.frames.partition_point(|frame| frame.stamp.as_nanos() < now_ns);
        // Nobody need listen to the very last.
        if next + 10 >= recording.frames.len() {
            return;
        }
        send_frames(path, recording, epoch, next..recording.frames.len() - 10);
    }
}

/// Logs in the order of their names, which begin with the time.
fn logs_in(folder: &Path) -> Vec<PathBuf> {
    let mut logs: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    logs.sort_by_key(|log| (log.metadata().unwrap().created().ok(), log.clone()));
    logs
}

#[test]
fn a_process_that_is_killed_in_flight_comes_back_and_the_autopilot_learns_of_the_new_origin() {
    let rig = Rig::new(END_S, &["--scale", "0.5"]);
    let Some(autopilot) = Autopilot::start_for(END_S + 3.0) else { return };
    // A port that somebody else has keeps nobody from flying.
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let listen = format!("network.listen=[\"tcp/{}\"]", taken.local_addr().unwrap());
    let connect = format!("autopilot.connect=\"{}\"", autopilot.url);
    let logs = rig.path("logs");
    std::fs::create_dir(&logs).unwrap();
    let mut imu = Microcontroller::plugged_in(&rig.path("imu"));
    let mut arguments: Vec<String> = ["--set", &listen, "--set", &connect].map(str::to_owned).to_vec();
    arguments.extend(["--set", "recorder.images=raw", "--record", logs.to_str().unwrap()].map(str::to_owned));
    let commands = rig.commands(arguments);
    let mut supervisor = Supervisor::start(Unit::ours(), rig.folder(), move |_| commands());
    let (recording, epoch) = (&rig.recording, Epoch::in_ms(&rig.recording, 700));
    std::thread::scope(|scope| {
        scope.spawn(|| frames_to_anybody(&rig.path("frames"), recording, epoch));
        scope.spawn(|| {
            std::thread::sleep(Duration::from_secs_f64(0.7 + KILL_S));
            supervisor.kill_dash_nine();
        });
        imu.play(recording, epoch, rig.samples(0.0..END_S), &Trouble::none());
    });
    supervisor.stop();
    let (story, said) = (supervisor.story(), rig.said());
    let got = autopilot.finish();
    assert_eq!(story.iter().filter(|seen| **seen == Seen::Started).count(), 2, "{story:?}\n{said}");
    assert!(said.contains("port already in use"), "{said}");
    assert_told(list(&got["odometry"]), &said);
    let [killed, whole] = logs_in(&logs).try_into().unwrap();
    for (log, is_cut) in [(killed, true), (whole, false)] {
        let verified = succeeds(&["verify", log.to_str().unwrap(), "--allow-incomplete", "--json"]);
        let verified: Value = serde_json::from_slice(&verified.stdout).unwrap();
        assert_eq!(verified["truncated"], is_cut, "{}: {verified}", log.display());
        assert!(verified["estimates_identical"].as_u64().unwrap() > 20, "{}: {verified}", log.display());
    }
}

/// Before the kill one counter, after it another with the first pose.
fn assert_told(odometry: &[Value], said: &str) {
    let counter = |message: &Value| message["reset_counter"].as_i64().unwrap();
    let first = counter(&odometry[0]);
    let restart = odometry.iter().position(|m| counter(m) != first).expect("another counter");
    let (before, after) = odometry.split_at(restart);
    assert!(before.iter().any(is_tracking) && is_tracking(&after[0]), "{said}");
    assert!(after.iter().all(|m| counter(m) == counter(&after[0])));
    let found =
        after.iter().position(is_tracking).unwrap_or_else(|| panic!("no pose after the restart: {said}"));
    let at = |message: &Value| message["at"].as_f64().unwrap();
    let silent_s = at(&after[0]) - at(&before[before.len() - 1]);
    let without_s = at(&after[found]) - at(before.iter().rev().find(|m| is_tracking(m)).unwrap());
    println!(
        "counters {first} and {}; silent for {silent_s:.3} s, without a pose for {without_s:.3} s, longest gap {:.3} s",
        counter(&after[0]),
        gaps_ms(odometry).last().unwrap() * 1e-3
    );
    // The clock of the sensor has to be found again before anything is estimated, which may take two seconds alone.
    assert!(
        silent_s < 5.0 && without_s < 5.0,
        "silent for {silent_s} s, {without_s} s without a pose: {said}"
    );
}
