//! Live runs of the real binary: slowed down, held still, stopped; and the same bits when left in peace.

use crate::cgroup::Group;
use crate::host::beside_bare_timers;
use crate::succeeds;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// Processors of a virtual machine that sleep wake up when its host gets round to it.
pub const AWAKE: &str = "runtime.idle_latency_us=0";

/// Eight times the points and a longer window: the usual work would still be done in time on a quarter of a processor.
const MUCH_WORK: [&str; 4] = [
    "--set=estimator.points.max_points=1000",
    "--set=estimator.points.cell_px=18",
    "--set=estimator.window.max_landmarks=2000",
    "--set=estimator.window.keyframes=12",
];

/// A flight whose frames are rendered beforehand into a folder, so that only the estimator runs live.
struct Flight {
    folder: tempfile::TempDir,
    arguments: Vec<String>,
}

impl Flight {
    fn new(scene: &str, duration_s: u32, scale: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let cache = folder.path().join("cache").display().to_string();
        let duration = duration_s.to_string();
        let flown = ["replay", scene, "--start", "2", "--duration", &duration, "--scale", scale];
        let arguments = [&flown[..], &["--cache", &cache, "--set", AWAKE]].concat();
        let arguments = arguments.into_iter().map(str::to_owned).collect();
        let flight = Self { arguments, folder };
        let rendered = flight.finished(&["--no-lines"]);
        assert!(rendered["completion"].as_f64().unwrap() > 0.9);
        flight
    }

    fn report(&self) -> std::path::PathBuf {
        self.folder.path().join("report.json")
    }

    fn command(&self, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_plumbline"));
        command.args(&self.arguments).args(more).arg("--report").arg(self.report());
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }

    /// Runs to the end and reads the report.
    fn finished(&self, more: &[&str]) -> Value {
        crate::done(self.command(more));
        self.read_report()
    }

    fn read_report(&self) -> Value {
        crate::json(self.report())
    }
}

fn number(report: &Value, key: &str) -> f64 {
    report["live"][key].as_f64().unwrap_or_else(|| panic!("{key} is missing in {}", report["live"]))
}

/// Every frame was tracked as in virtual time.
fn is_undisturbed(report: &Value) -> bool {
    ["frames_shed", "frames_short_of_samples", "steps_down"].iter().all(|key| number(report, key) == 0.0)
}

#[test]
fn a_live_run_gives_the_bits_of_virtual_time_with_any_number_of_threads() {
    let flight = Flight::new("sim:room", 5, "0.5");
    let digests = |report: &Value| (report["estimate_digest"].clone(), report["odometry_digest"].clone());
    let virtual_time = flight.finished(&["--threads", "1"]);
    for threads in ["3", "4"] {
        assert_eq!(digests(&virtual_time), digests(&flight.finished(&["--threads", threads])), "{threads}");
    }
    // A machine that is busy with other things may refuse a frame: then there is nothing to compare.
    for _ in 0..4 {
        let live = flight.finished(&["--speed", "1"]);
        if is_undisturbed(&live) && number(&live, "late_corrections") == 0.0 {
            assert_eq!(digests(&virtual_time), digests(&live));
            assert_eq!(live["hot_path_allocations"], 0);
            return;
        }
    }
    panic!("no live run went undisturbed");
}

#[test]
fn a_tick_that_is_held_up_for_a_moment_changes_no_estimate() {
    let Some(group) = Group::freezer("moments") else { return };
    let flight = Flight::new("sim:low-texture", 5, "0.5");
    let virtual_time = flight.finished(&["--no-lines", "--threads", "1"]);
    // A machine that is busy with other things may refuse a frame: then there is nothing to compare.
    for _ in 0..4 {
        let mut child = flight.command(&["--no-lines", "--speed", "1"]).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(1500));
        group.add_thread(child.id(), thread_of(child.id(), "tick").expect("the tick has a thread"));
        for _ in 0..6 {
            group.set_frozen(true);
            // Longer than the period of the frames, which wait for their samples meanwhile.
            std::thread::sleep(Duration::from_millis(75));
            group.set_frozen(false);
            std::thread::sleep(Duration::from_millis(325));
        }
        assert!(child.wait().unwrap().success());
        let live = flight.read_report();
        assert!(number(&live, "ticks_missed") >= 60.0, "{}", live["live"]);
        if is_undisturbed(&live) {
            assert_eq!(virtual_time["estimate_digest"], live["estimate_digest"]);
            return;
        }
        println!("{:#}", live["live"]);
    }
    panic!("no live run went undisturbed");
}

#[test]
fn on_a_host_slowed_down_four_times_odometry_goes_on_and_frames_do_not_pile_up() {
    let Some(group) = Group::with_quota("slow", 0.25) else { return };
    let flight = Flight::new("sim:room", 12, "1");
    // Real-time priorities would escape the quota.
    let live = ["--speed", "1", "--set", "runtime.realtime=false"];
    let mut child = flight.command(&[&live[..], &MUCH_WORK].concat()).spawn().unwrap();
    group.add_process(child.id());
    let (ended, host) = beside_bare_timers(Duration::from_millis(5), 80, || child.wait());
    assert!(ended.unwrap().success());
    let host_ms = host.late_ms(1.0);
    let report = flight.read_report();
    println!("{:#}; a bare timer beside it: {host_ms} ms late at most", report["live"]);
    assert!(number(&report, "steps_down") >= 1.0, "nothing was left out");
    let lateness = &report["live"]["sample_to_odometry_ms"];
    // The quota stops every thread of the process for milliseconds at a time; odometry waits no longer than that.
    assert!(lateness["p50"].as_f64().unwrap() < 5.0, "{lateness}");
    assert!(lateness["p99"].as_f64().unwrap() < 50.0 + host_ms, "{lateness}, host {host_ms}");
    let response = &report["live"]["frame_response_ms"];
    assert!(response["max"].as_f64().unwrap() < 150.0 + host_ms, "{response}, host {host_ms}");
    // One that the window takes in hand, and one that waits.
    assert!(report["live"]["queue_depth"]["tracked frames"].as_f64().unwrap() <= 2.0);
    assert!(report["accuracy"]["ate_percent"].as_f64().unwrap() < 1.0, "{}", report["accuracy"]);
    assert_eq!(report["resets"], 0);
}

#[test]
fn a_simulator_that_cannot_keep_up_leaves_frames_out_and_falls_no_further_behind() {
    let Some(group) = Group::with_quota("renderer", 0.25) else { return };
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["replay", "sim:room", "--start", "2", "--duration", "6"].map(str::to_owned).to_vec();
    let flight = Flight { folder, arguments };
    // Frames are rendered in flight.
    let live = ["--speed", "1", "--no-lines", "--set", "runtime.realtime=false"];
    let mut child = flight.command(&live).spawn().unwrap();
    group.add_process(child.id());
    let (ended, host) = beside_bare_timers(Duration::from_millis(5), 80, || child.wait());
    assert!(ended.unwrap().success());
    let report = flight.read_report();
    let [latest_ms, overdue] =
        ["frame_latest_at_source_ms", "frames_overdue_at_source"].map(|key| number(&report, key));
    println!("{overdue} frames overdue, the latest {latest_ms} ms late: {:#}", report["live"]);
    assert!(overdue >= 10.0, "the renderer kept up");
    assert!(latest_ms < 1000.0 + host.late_ms(1.0), "{latest_ms} ms");
    assert!(report["frames"].as_f64().unwrap() >= 10.0);
}

#[test]
fn a_disturbed_flight_is_executed_again_bit_for_bit_from_its_log() {
    let cores = std::thread::available_parallelism().unwrap().get();
    let Some(group) = Group::with_quota("disturbed", 0.25) else { return };
    let flight = Flight::new("sim:room", 8, "1");
    let log = flight.folder.path().join("flight.mcap").display().to_string();
    let live = ["--speed", "1", "--set", "runtime.realtime=false", "--record", &log];
    let recorder =
        ["images=raw", "queue_frames=200", "queue_entries=20000"].map(|key| format!("--set=recorder.{key}"));
    let recorder = recorder.each_ref().map(String::as_str);
    let mut child = flight.command(&[&live[..], &recorder, &MUCH_WORK].concat()).spawn().unwrap();
    group.add_process(child.id());
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..cores {
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        let ended = child.wait().unwrap();
        stop.store(true, Ordering::Relaxed);
        assert!(ended.success());
    });
    let report = flight.read_report();
    println!("{:#}", report["live"]);
    assert!(number(&report, "steps_down") + number(&report, "frames_shed") >= 1.0, "nothing was disturbed");
    succeeds(&["verify", &log, "--json"]);
    // Followed by the rule instead of the log, the same inputs give something else.
    let undisturbed = flight.finished(&[&["--threads", "1"][..], &MUCH_WORK].concat());
    assert_ne!(report["estimate_digest"], undisturbed["estimate_digest"]);
}

/// The thread of `pid` that is called `name`.
pub fn thread_of(pid: u32, name: &str) -> Option<u32> {
    for entry in std::fs::read_dir(format!("/proc/{pid}/task")).ok()?.flatten() {
        if std::fs::read_to_string(entry.path().join("comm")).is_ok_and(|comm| comm.trim() == name) {
            return entry.file_name().to_str()?.parse().ok();
        }
    }
    None
}

/// A flight on its way, ended when the test is.
struct Flying {
    child: Child,
    lines: Receiver<String>,
}

impl Flying {
    fn start(mut command: Command) -> Self {
        let mut child = command.spawn().unwrap();
        let said = BufReader::new(child.stderr.take().unwrap());
        let (sender, lines) = channel();
        std::thread::spawn(move || said.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
        Self { child, lines }
    }

    /// Waits for a line that says `words`.
    fn says(&self, words: &str) -> Instant {
        let mut seen = Vec::new();
        while let Ok(line) = self.lines.recv_timeout(Duration::from_secs(20)) {
            if line.contains(words) {
                return Instant::now();
            }
            seen.push(line);
        }
        panic!("nobody said '{words}': {seen:#?}");
    }
}

impl Drop for Flying {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_stage_that_stalls_is_named_within_a_tenth_of_a_second_and_the_odometry_goes_on() {
    let Some(group) = Group::freezer("stall") else { return };
    let flight = Flight::new("sim:low-texture", 8, "0.5");
    let mut flying = Flying::start(flight.command(&["--speed", "1", "-v"]));
    std::thread::sleep(Duration::from_secs(3));
    let window = thread_of(flying.child.id(), "window").expect("the window has a thread");
    // Held still while it waits for a frame, it has no work to be late with until the next one comes.
    group.add_thread(flying.child.id(), window);
    let frozen = Instant::now();
    group.set_frozen(true);
    let named = flying.says("window is stalled") - frozen;
    std::thread::sleep(Duration::from_secs(1).saturating_sub(frozen.elapsed()));
    group.set_frozen(false);
    let held_ms = frozen.elapsed().as_secs_f64() * 1e3;
    flying.says("window is back");
    assert!(flying.child.wait().unwrap().success());
    let report = flight.read_report();
    // Up to a frame period may pass before there is work to stall on.
    assert!(named < Duration::from_millis(160), "{named:?}");
    assert!(number(&report, "stalls") >= 1.0);
    // A tick that waited for the window was as late as the window was held, and 200 a second were missed.
    let late_ms = report["live"]["tick_late_ms"]["max"].as_f64().unwrap();
    let missed = number(&report, "ticks_missed");
    println!("named after {named:?}, held for {held_ms:.0} ms: ticks late by {late_ms} ms, {missed} missed");
    assert!(late_ms < held_ms / 2.0, "{late_ms} ms late, the window was held for {held_ms} ms");
    assert!(missed < 0.2 * held_ms / 2.0, "{missed} ticks missed in {held_ms} ms");
}

#[test]
fn a_signal_stops_a_flight_gracefully_and_its_log_is_whole() {
    let flight = Flight::new("sim:low-texture", 8, "0.5");
    let log = flight.folder.path().join("flight.mcap").display().to_string();
    let mut flying = Flying::start(flight.command(&["--speed", "1", "--record", &log]));
    std::thread::sleep(Duration::from_secs(3));
    let asked = Instant::now();
    assert!(Command::new("kill").args(["-TERM", &flying.child.id().to_string()]).status().unwrap().success());
    assert!(flying.child.wait().unwrap().success());
    assert!(asked.elapsed() < Duration::from_secs(2));
    let frames = flight.read_report()["frames"].as_u64().unwrap();
    assert!((20..120).contains(&frames), "{frames} frames");
    succeeds(&["verify", &log]);
}

/// Largest lateness of a bare timer in the output of `doctor`, ms.
fn largest_of(doctor: &str) -> f64 {
    let after = doctor.split("largest ").nth(1).unwrap_or_else(|| panic!("no timer in {doctor}"));
    after.split([';', '\n']).next().unwrap().trim().parse().unwrap()
}

#[test]
#[ignore = "takes minutes: make soak"]
fn soak_a_long_live_flight_keeps_its_time() {
    let minutes = plumbline_test_support::soak_minutes();
    let flight = Flight::new("sim:room", 60 * minutes, "1");
    let watch = (60 * minutes).to_string();
    // On two processors the tick has one of its own.
    let apart = ["--set", "runtime.tick_cpus=[0]", "--set", "runtime.work_cpus=[1]"];
    let doctor = Command::new(env!("CARGO_BIN_EXE_plumbline"))
        .args(["doctor", "--watch", &watch])
        .args(apart)
        .args(["--set", AWAKE])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let report = flight.finished(&[&["--speed", "1"], &apart[..]].concat());
    let bare_ms = largest_of(&String::from_utf8(doctor.wait_with_output().unwrap().stdout).unwrap());
    println!("a bare timer beside it: {bare_ms} ms late at most; {:#}", report["live"]);
    let late = &report["live"]["tick_late_ms"];
    assert!(late["max"].as_f64().unwrap() <= 5.0 + bare_ms, "{late}, a bare timer {bare_ms} ms");
    let latency = &report["live"]["sample_to_odometry_ms"];
    assert!(latency["p999"].as_f64().unwrap() <= 1.0, "{latency}");
    assert_eq!(number(&report, "frames_shed") + number(&report, "frames_passed_over"), 0.0);
    assert_eq!(report["hot_path_allocations"], 0);
    assert!(number(&report, "memory_growth_mb") <= 1.0);
}
