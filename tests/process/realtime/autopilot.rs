//! The bridge to the autopilot, with pymavlink as the autopilot.

use super::live::{AWAKE, thread_of};
use crate::cgroup::Group;
use crate::host::{Host, beside_bare_timers};
use crate::python::interpreter;
use crate::{fails, stderr};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

/// Lead of the autopilot's clock over ours.
const AHEAD_NS: i64 = 86_400_123_456_789;
/// LOCAL_FRD, BODY_FRD and VIO in MAVLink's numbers.
const FRAMES: [i64; 3] = [20, 12, 3];
const START: &str = "Plumbline: tracking";
const BLIND: &str = "Plumbline: lost, no features";
const SILENT: &str = "Plumbline: lost, estimator is silent";
const STOPPED: &str = "Plumbline: lost, stopped";

/// The autopilot, in a process of its own.
pub struct Autopilot {
    child: Child,
    said: BufReader<ChildStdout>,
    pub url: String,
}

impl Autopilot {
    /// Until the bridge stops.
    fn start() -> Option<Self> {
        Self::with(&["--seconds", "90"])
    }

    /// For so long, whoever stops and starts meanwhile.
    #[cfg(feature = "sabotage")]
    pub fn start_for(seconds: f64) -> Option<Self> {
        Self::with(&["--seconds", &seconds.to_string(), "--linger", "1000"])
    }

    fn with(arguments: &[&str]) -> Option<Self> {
        let mut child = Command::new(interpreter("pymavlink")?)
            .arg(plumbline_test_support::workspace().join("tests/python/autopilot_peer.py"))
            .args(["--ahead-ns", &AHEAD_NS.to_string()])
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(child.stdout.take().unwrap());
        let mut port = String::new();
        said.read_line(&mut port).unwrap();
        let port: u16 = port.trim().parse().expect("pymavlink is installed: scripts/setup test");
        Some(Self { child, said, url: format!("udp://127.0.0.1:{port}") })
    }

    /// Messages received, once the bridge has stopped.
    pub fn finish(mut self) -> Value {
        let mut text = String::new();
        self.said.read_to_string(&mut text).unwrap();
        assert!(self.child.wait().unwrap().success());
        serde_json::from_str(&text).unwrap()
    }
}

/// The IMU has x up, y right and z forward.
pub const MOUNTING: &str = "vehicle.imu_to_vehicle_deg=[180.0, -90.0, 0.0]";

/// A flight that begins in the middle of the rise, its frames rendered beforehand.
struct Flight {
    folder: tempfile::TempDir,
    arguments: Vec<String>,
}

impl Flight {
    fn new(duration_s: &str, more: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let cache = folder.path().join("cache").display().to_string();
        let flight = ["replay", "sim:room", "--start", "2", "--duration", duration_s, "--scale", "0.5"];
        let more = [&["--set", MOUNTING, "--set", AWAKE], more].concat();
        let arguments = [&flight[..], &["--no-lines", "--cache", &cache], &more].concat();
        let arguments: Vec<String> = arguments.into_iter().map(str::to_owned).collect();
        crate::done(Command::new(env!("CARGO_BIN_EXE_plumbline")).args(&arguments));
        Self { folder, arguments }
    }

    fn file(&self, name: &str) -> String {
        self.folder.path().join(name).display().to_string()
    }

    /// The flight in real time, with this autopilot.
    fn command(&self, url: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_plumbline"));
        command
            .args(&self.arguments)
            .args(["--speed", "1", "--autopilot", url])
            .args(["--odometry", &self.file("out.tum"), "--report", &self.file("report.json")])
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        command
    }

    fn report(&self) -> Value {
        crate::json(self.file("report.json"))
    }

    fn odometry(&self) -> Vec<Pose> {
        let text = std::fs::read_to_string(self.file("out.tum")).unwrap();
        text.lines().filter(|line| !line.starts_with('#')).map(Pose::of_tum).collect()
    }
}

type Vector = [f64; 3];
type Rotation = [Vector; 3];

/// A pose of the IMU in the odometry frame. Everything about frames is written out here a second time, by rows
/// and signs, as MAVLink and the data sets define them.
struct Pose {
    stamp_s: f64,
    position: Vector,
    rotation: Rotation,
}

impl Pose {
    fn of_tum(line: &str) -> Self {
        let n: Vec<f64> = line.split(' ').map(|x| x.parse().unwrap()).collect();
        Self { stamp_s: n[0], position: [n[1], n[2], n[3]], rotation: rotation([n[7], n[4], n[5], n[6]]) }
    }

    /// Nose, right and down of the vehicle in the odometry frame: the IMU has x up, y right, z forward.
    fn vehicle(&self) -> Rotation {
        let column = |k: usize, sign: f64| self.rotation.map(|row| sign * row[k]);
        [column(2, 1.0), column(1, 1.0), column(0, -1.0)]
    }
}

/// The matrix of a quaternion w, x, y, z.
fn rotation([w, x, y, z]: [f64; 4]) -> Rotation {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// `v` of the odometry frame in LOCAL_FRD, whose x is where the nose pointed first.
fn local([x, y, z]: Vector, heading: f64) -> Vector {
    let (sin, cos) = heading.sin_cos();
    [cos * x + sin * y, sin * x - cos * y, -z]
}

fn distance(a: Vector, b: Vector) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

fn dot(a: Vector, b: Vector) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

fn numbers<const N: usize>(message: &Value, names: [&str; N]) -> [f64; N] {
    names.map(|name| message[name].as_f64().unwrap_or(f64::NAN))
}

fn position(message: &Value) -> Vector {
    numbers(message, ["x", "y", "z"])
}

pub fn list(value: &Value) -> &Vec<Value> {
    value.as_array().unwrap()
}

pub fn is_tracking(message: &Value) -> bool {
    message["quality"].as_i64().unwrap() >= 0
}

fn texts(got: &Value) -> Vec<&str> {
    list(&got["texts"]).iter().map(|text| text["text"].as_str().unwrap()).collect()
}

/// Gaps between arrivals, ms, in order of size.
pub fn gaps_ms(odometry: &[Value]) -> Vec<f64> {
    let at: Vec<f64> = odometry.iter().map(|m| m["at"].as_f64().unwrap()).collect();
    let mut gaps: Vec<f64> = at.windows(2).map(|pair| 1e3 * (pair[1] - pair[0])).collect();
    gaps.sort_by(f64::total_cmp);
    gaps
}

/// Result of `work`, and the lateness meanwhile of a thread with the bridge's period and priority.
fn beside_the_bridge<T>(work: impl FnOnce() -> T) -> (T, Host) {
    beside_bare_timers(Duration::from_millis(25), 70, work)
}

/// Every message came, forty a second, from the first pose until after the end, as evenly as a bare timer's
/// releases beside it; but for so many `silences`, in which there was nothing new to send.
fn assert_constant_rate(got: &Value, host: &Host, silences: usize) {
    let odometry = list(&got["odometry"]);
    let mut gaps = gaps_ms(odometry);
    for silence_ms in gaps.split_off(gaps.len() - silences) {
        assert!(silence_ms < 700.0 + host.late_ms(1.0), "{silence_ms} ms of silence");
    }
    let at = |share: f64| gaps[(share * (gaps.len() - 1) as f64) as usize];
    let all_ms = gaps.iter().sum::<f64>();
    let mean = all_ms / gaps.len() as f64;
    let mean_without_missed = all_ms / (gaps.len() as f64 + host.missed() as f64);
    println!(
        "{} messages, gap mean {mean:.3}, p1 {:.2}, p50 {:.2}, p99 {:.2}, max {:.2} ms; \
         bare timers: late p95 {:.2}, max {:.2} ms, {} missed",
        odometry.len(),
        at(0.01),
        at(0.5),
        at(0.99),
        at(1.0),
        host.late_ms(0.95),
        host.late_ms(1.0),
        host.missed()
    );
    assert!(odometry.len() > 200 && got["gaps"] == 0 && got["bad"] == 0);
    assert!(mean > 24.5 && mean_without_missed < 25.5, "{mean} ms, {mean_without_missed} without the missed");
    let beyond_ms = 5.0 + host.late_ms(0.95);
    assert!(at(0.05) > 25.0 - beyond_ms && at(0.95) < 25.0 + beyond_ms, "{gaps:?}");
    assert!(at(1.0) < 200.0 + host.late_ms(1.0), "{gaps:?}");
}

/// Frames, counter, quality and covariance of every message fit each other.
fn assert_sound(message: &Value) {
    let ids = ["frame_id", "child_frame_id", "estimator_type"].map(|name| message[name].as_i64().unwrap());
    assert_eq!((ids, &message["reset_counter"]), (FRAMES, &Value::from(0)));
    let quality = message["quality"].as_i64().unwrap();
    let covariance = |name: &str, places: &[usize]| -> Vec<Option<f64>> {
        places.iter().map(|k| list(&message[name])[*k].as_f64()).collect()
    };
    let pose = covariance("pose_covariance", &[0, 6, 11, 15, 18, 20]);
    let velocity = covariance("velocity_covariance", &[0, 6, 11]);
    let mut all = pose.iter().chain(&velocity);
    if quality == -1 {
        assert!(all.all(|x| x.is_some_and(|x| x > 9.0)), "{message}");
        assert_eq!(message["vx"], 0.0, "{message}");
    } else {
        assert!((1..=100).contains(&quality), "{message}");
        assert!(all.all(|x| x.is_some_and(|x| x > 0.0 && x < 4.0)), "{message}");
    }
    // The peer writes null for what is not finite.
    assert!(message.as_object().unwrap().values().all(is_finite), "{message}");
}

fn is_finite(value: &Value) -> bool {
    value.as_array().map_or(!value.is_null(), |values| values.iter().all(is_finite))
}

/// Each message that tracks is one of the poses that were written, turned into the autopilot's frames.
fn assert_poses(tracking: &[&Value], written: &[Pose]) {
    let nose = written[0].vehicle()[0];
    let heading = nose[1].atan2(nose[0]);
    let mut offsets = Vec::new();
    for message in tracking {
        let there = position(message);
        let distance_of = |pose: &Pose| distance(local(pose.position, heading), there);
        let same = written.iter().min_by(|a, b| distance_of(a).total_cmp(&distance_of(b))).unwrap();
        assert!(distance_of(same) < 1e-5, "{} m from the nearest", distance_of(same));
        let q: Vec<f64> = list(&message["q"]).iter().map(|x| x.as_f64().unwrap()).collect();
        let turned = rotation([q[0], q[1], q[2], q[3]]);
        for (k, axis) in same.vehicle().into_iter().enumerate() {
            assert!(distance(local(axis, heading), turned.map(|row| row[k])) < 1e-5, "{message}");
        }
        offsets.push(message["time_usec"].as_f64().unwrap() * 1e-6 - same.stamp_s);
    }
    offsets.sort_by(f64::total_cmp);
    let spread_ms = 1e3 * (offsets[offsets.len() - 1] - offsets[0]);
    println!("stamps keep their distance to {spread_ms:.3} ms");
    assert!(spread_ms < 5.0, "{spread_ms} ms");
}

/// Velocities are the slopes of the positions, seen from the vehicle.
fn assert_velocities(tracking: &[&Value]) {
    let (mut errors, mut unturned) = (Vec::new(), Vec::new());
    for three in tracking.windows(5) {
        let seconds = |k: usize| three[k]["time_usec"].as_f64().unwrap() * 1e-6;
        let (first, last) = (position(three[0]), position(three[4]));
        let slope: Vector = std::array::from_fn(|k| (last[k] - first[k]) / (seconds(4) - seconds(0)));
        let q: Vec<f64> = list(&three[2]["q"]).iter().map(|x| x.as_f64().unwrap()).collect();
        let turned = rotation([q[0], q[1], q[2], q[3]]);
        let in_body: Vector = std::array::from_fn(|k| dot(turned.map(|row| row[k]), slope));
        let sent = numbers(three[2], ["vx", "vy", "vz"]);
        errors.push(distance(in_body, sent));
        unturned.push(distance(slope, sent));
    }
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let (median, without) = (median(&mut errors), median(&mut unturned));
    println!("velocity off by {median:.4} m/s (median), by {without:.3} were it not turned");
    assert!(median < 0.05 && without > 3.0 * median, "{median}, {without}");
}

#[test]
fn an_autopilot_gets_the_odometry_at_a_constant_rate_in_its_frames_and_by_its_clock() {
    let flight = Flight::new("6", &[]);
    let Some(autopilot) = Autopilot::start() else { return };
    let (flown, host) = beside_the_bridge(|| flight.command(&autopilot.url).output().unwrap());
    assert!(flown.status.success(), "{}", stderr(&flown));
    let (got, report) = (autopilot.finish(), flight.report());
    assert_constant_rate(&got, &host, 0);
    let odometry = list(&got["odometry"]);
    odometry.iter().for_each(assert_sound);
    let tracking: Vec<&Value> = odometry.iter().filter(|m| is_tracking(m)).collect();
    assert!(is_tracking(&odometry[0]), "nothing is sent before the first pose");
    assert!(!is_tracking(&odometry[odometry.len() - 1]), "the end is told");
    assert!(tracking.len() > 200, "{}", tracking.len());
    assert_poses(&tracking, &flight.odometry());
    assert_velocities(&tracking);
    assert_eq!(texts(&got), [START, STOPPED]);
    assert!((5..=9).contains(&list(&got["heartbeats"]).len()));
    // Type 18 is an onboard controller, state 4 active.
    assert!(list(&got["heartbeats"]).iter().all(|h| h["type"] == 18));
    assert!(list(&got["heartbeats"]).iter().any(|h| h["state"] == 4));
    assert_times(&got, &report["autopilot"], &tracking);
}

/// Both sides find the offset of the clocks, and odometry is as old as it can be.
fn assert_times(got: &Value, bridge: &Value, tracking: &[&Value]) {
    println!("{bridge:#}");
    let found_ms = bridge["clock_offset_ms"].as_f64().unwrap();
    let error_ms = found_ms - AHEAD_NS as f64 * 1e-6;
    let answers = list(&got["answers"]);
    let best = answers.iter().min_by_key(|a| a["round_trip_ns"].as_i64().unwrap()).unwrap();
    let theirs_ns = best["offset_ns"].as_i64().unwrap();
    println!("offset: ours {error_ms:+.4} ms off, theirs {:+.4} ms", (theirs_ns - AHEAD_NS) as f64 * 1e-6);
    // Both clocks are one here, so the error is known; at worst it is half of a round trip.
    let half_ms = 0.5 * bridge["round_trip_ms"].as_f64().unwrap();
    assert!(error_ms.abs() < (1.6 * half_ms + 0.2).min(5.0), "{error_ms} ms, round trip {half_ms} x 2");
    assert!((theirs_ns - AHEAD_NS).abs() <= best["round_trip_ns"].as_i64().unwrap() / 2 + 1000);
    assert!(got["asked"].as_i64().unwrap() >= 10 && answers.len() > 30);
    let age_ms = |m: &&Value| {
        let measured_s = m["time_usec"].as_f64().unwrap() * 1e-6 + theirs_ns as f64 * 1e-9;
        1e3 * (m["at"].as_f64().unwrap() - measured_s)
    };
    let mut ages: Vec<f64> = tracking.iter().map(age_ms).collect();
    ages.sort_by(f64::total_cmp);
    println!("age on arrival: p50 {:.2}, p99 {:.2} ms", ages[ages.len() / 2], ages[ages.len() * 99 / 100]);
    assert!(ages[0] > -1.0 && ages[ages.len() / 2] < 15.0, "{ages:?}");
}

#[test]
fn a_blackout_is_told_and_survived_and_a_signal_ends_it_all() {
    let flight = Flight::new("12", &["--blackout", "2..4"]);
    let Some(autopilot) = Autopilot::start() else { return };
    let mut child = flight.command(&autopilot.url).stderr(Stdio::null()).spawn().unwrap();
    let (ended, host) = beside_the_bridge(|| {
        std::thread::sleep(Duration::from_secs(8));
        assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
        child.wait().unwrap()
    });
    assert!(ended.success());
    let got = autopilot.finish();
    assert_constant_rate(&got, &host, 0);
    let odometry = list(&got["odometry"]);
    odometry.iter().for_each(assert_sound);
    assert_eq!(texts(&got), [START, BLIND, START, STOPPED]);
    assert!(!is_tracking(&odometry[odometry.len() - 1]), "the end is told");
}

#[test]
fn an_estimator_that_is_held_still_is_told_and_messages_go_on() {
    let Some(group) = Group::freezer("autopilot") else { return };
    let flight = Flight::new("8", &[]);
    let Some(autopilot) = Autopilot::start() else { return };
    let mut child = flight.command(&autopilot.url).stderr(Stdio::null()).spawn().unwrap();
    let (ended, host) = beside_the_bridge(|| {
        std::thread::sleep(Duration::from_millis(3500));
        group.add_thread(child.id(), thread_of(child.id(), "tick").expect("the tick has a thread"));
        group.set_frozen(true);
        std::thread::sleep(Duration::from_millis(1500));
        group.set_frozen(false);
        child.wait().unwrap()
    });
    assert!(ended.success());
    let got = autopilot.finish();
    assert_constant_rate(&got, &host, 1);
    let odometry = list(&got["odometry"]);
    let lost = odometry.iter().filter(|m| !is_tracking(m)).count();
    let stamps: Vec<u64> = odometry.iter().map(|m| m["time_usec"].as_u64().unwrap()).collect();
    assert!(stamps.windows(2).all(|pair| pair[0] < pair[1]), "each stamp once, in order");
    let said = texts(&got);
    assert!(lost >= 30 && said[0] == START && said.contains(&SILENT), "{lost} lost; it said {said:?}");
}

#[test]
fn an_autopilot_that_cannot_be_is_refused() {
    let live = ["replay", "sim:room", "--speed", "1", "--autopilot"];
    let with = |url: &'static str| [&live[..], &[url]].concat();
    fails(&with("tcp://127.0.0.1:5760"), 2, &["--autopilot", "udp://127.0.0.1:14540"]);
    fails(&with("serial:///dev/ttyS0:57600"), 2, &["--autopilot", "57600 baud"]);
    fails(&with("serial:///dev/nowhere-at-all:921600"), 2, &["/dev/nowhere-at-all"]);
    fails(&["replay", "sim:room", "--autopilot", "udp://127.0.0.1:14540"], 2, &["--speed 1"]);
}
