//! Vehicles, network processes, routers and stations that are killed, over and over. Part of `make soak`.

use crate::local::{children, digests, flown_alone, was_disturbed};
use crate::supervised::{BACK, listening};
use crate::vehicle::{PLUMBLINE, Running, eventually, flight, free_port, render, resident_mb};
use crate::{plumbline, stderr, succeeds};
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
    /// A station with a session of this kind: "--listen" or "--connect".
    fn start(session: &str, endpoint: &str) -> Self {
        let mut command = Command::new(PLUMBLINE);
        command.args(["ground", "--json", "--no-http", session, endpoint]);
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

    /// Kills the only process that this one has started; the time until the station receives something again.
    fn silence_after_the_death_of_a_worker_of(&self, process: u32, signal: &str) -> Duration {
        let workers = children(process);
        assert_eq!(workers.len(), 1, "one process of {process}");
        let killed = Command::new("kill").args([signal, &workers[0].to_string()]).status().unwrap();
        assert!(killed.success());
        let died = Instant::now();
        // Lines that it had received before may still come.
        std::thread::sleep(Duration::from_millis(50));
        let before = self.received();
        eventually("the station hears the vehicle again", Duration::from_secs(15), || {
            self.received() > before
        });
        died.elapsed()
    }

    fn resident_mb(&self) -> f64 {
        resident_mb(children(self.child.id())[0])
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
    let verified = succeeds(&["verify", path, "--allow-incomplete", "--json"]);
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
    let station = Station::start("--listen", &endpoint);
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

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_process_router_and_station_killed_twenty_times_each_in_one_flight() {
    const LONG_S: u32 = 160;
    const TIMES: usize = 20;
    let alone = flown_alone(LONG_S);
    let port = free_port();
    let router = listening(&["router"], "tcp", port, &[]);
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let station = Station::start("--connect", &endpoint);
    let folder = tempfile::tempdir().unwrap();
    let (report, log) = (folder.path().join("report.json"), folder.path().join("flight.mcap"));
    let mut command = flight("drone", LONG_S);
    command.args(["--connect", &endpoint, "--report"]).arg(&report).arg("--record").arg(&log);
    let mut vehicle = Running::start(command);
    eventually("the station hears the vehicle", Duration::from_secs(15), || station.received() > 0);
    for (name, process) in [
        ("network process", vehicle.child.id()),
        ("router", router.child.id()),
        ("station", station.child.id()),
    ] {
        let silence = |k: usize| {
            std::thread::sleep(Duration::from_millis(700));
            // A panic ends a worker by SIGABRT or by a status of its own; both are faults.
            let signal = if k.is_multiple_of(2) { "-KILL" } else { "-ABRT" };
            station.silence_after_the_death_of_a_worker_of(process, signal)
        };
        let silences: Vec<Duration> = (0..TIMES).map(silence).collect();
        println!(
            "{name} killed {TIMES} times: heard again after {:.2?} at most",
            silences.iter().max().unwrap()
        );
        assert!(silences.iter().all(|silence| *silence < BACK), "{name}: {silences:.2?}");
    }
    assert!(vehicle.child.try_wait().unwrap().is_none(), "the flight ended too soon: {}", vehicle.words());
    assert!(vehicle.child.wait().unwrap().success(), "{}", vehicle.words());
    succeeds(&["verify", log.to_str().unwrap()]);
    let report = crate::json(report);
    // On a host that refuses frames there is nothing to compare; the log is whole in any case.
    println!(
        "refused or late frames: {}; ticks late, ms: {}",
        was_disturbed(&report),
        report["live"]["tick_late_ms"]
    );
    assert!(was_disturbed(&report) || digests(&report) == alone);
}
