//! A vehicle that is killed and started again, over and over, while a station watches. Part of `make soak`.

use crate::local::children;
use crate::vehicle::{PLUMBLINE, Running, eventually, flight, free_port, render};
use crate::{plumbline, stderr};
use plumbline_test_support::soak_minutes;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Length of the flight that never gets to its end, s.
const FLIGHT_S: u32 = 40;
/// The frames of a simulated flight, Hz.
const FRAME_RATE_HZ: f64 = 20.0;
/// Most that is lost of a log when its process is killed: half a second waits for its chunk, the rest for the recorder.
const MAX_LOST_S: f64 = 1.5;

/// A station that counts the estimates it receives.
struct Station {
    child: Child,
    received: Arc<AtomicU64>,
}

impl Station {
    fn start(endpoint: &str) -> Self {
        let mut command = Command::new(PLUMBLINE);
        command.args(["ground", "--json", "--no-http", "--listen", endpoint]);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let received = Arc::new(AtomicU64::new(0));
        let count = Arc::clone(&received);
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let state: Value = serde_json::from_str(&line).unwrap();
                count.fetch_add(u64::from(state["state"] == "tracking"), Ordering::Relaxed);
            }
        });
        Self { child, received }
    }

    fn received(&self) -> u64 {
        self.received.load(Ordering::Relaxed)
    }

    fn resident_mb(&self) -> f64 {
        let status =
            std::fs::read_to_string(format!("/proc/{}/status", children(self.child.id())[0])).unwrap();
        let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
        line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A log of a process that was killed after `flown_s` of flight is whole up to shortly before; frames verified.
fn verify_up_to_the_cut(log: &Path, flown_s: f64) -> u64 {
    let path = log.to_str().unwrap();
    let whole = plumbline(&["verify", path]);
    assert_eq!(whole.status.code(), Some(1), "{}", stderr(&whole));
    assert!(stderr(&whole).contains("--allow-incomplete"), "{}", stderr(&whole));
    let verified = plumbline(&["verify", path, "--allow-incomplete", "--json"]);
    assert!(verified.status.success(), "{}", stderr(&verified));
    let verified: Value = serde_json::from_slice(&verified.stdout).unwrap();
    assert_eq!((&verified["identical"], &verified["truncated"]), (&true.into(), &true.into()), "{verified}");
    let frames = verified["estimates_identical"].as_u64().unwrap();
    let least = FRAME_RATE_HZ * (flown_s - MAX_LOST_S);
    assert!(frames as f64 >= least, "{frames} frames of {flown_s:.1} s of flight: {verified}");
    frames
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_a_vehicle_that_is_killed_comes_back_and_its_logs_are_whole_up_to_the_cut() {
    render(FLIGHT_S);
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let station = Station::start(&endpoint);
    let folder = tempfile::tempdir().unwrap();
    let restarts = 4 + 2 * soak_minutes();
    let (mut slowest_s, mut verified_frames, mut settled_mb) = (0.0_f64, 0, None);
    for k in 0..restarts {
        let log = folder.path().join(format!("flight{k}.mcap"));
        let mut command = flight("drone", FLIGHT_S);
        command.args(["--connect", &endpoint, "--record"]).arg(&log);
        let (before, begun) = (station.received(), Instant::now());
        let mut vehicle = Running::start(command);
        // No longer than a process, its session and the start of an estimate take.
        eventually("estimates come again", Duration::from_secs(15), || station.received() > before + 5);
        let back = Instant::now();
        slowest_s = slowest_s.max((back - begun).as_secs_f64());
        // Killed at another place in its chunk each time.
        std::thread::sleep(Duration::from_millis(2000 + 370 * u64::from(k % 11)));
        assert!(vehicle.child.try_wait().unwrap().is_none(), "it ended by itself: {}", vehicle.words());
        vehicle.kill();
        verified_frames += verify_up_to_the_cut(&log, back.elapsed().as_secs_f64());
        std::fs::remove_file(&log).unwrap();
        settled_mb.get_or_insert_with(|| station.resident_mb());
    }
    let grown_mb = station.resident_mb() - settled_mb.unwrap_or_default();
    println!(
        "{restarts} restarts: estimates came again within {slowest_s:.2} s, {verified_frames} frames of cut logs are \
         verified, the station grew by {grown_mb:.1} MB"
    );
    assert!(grown_mb < 8.0, "the station grew by {grown_mb:.1} MB");
}
