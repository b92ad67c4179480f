//! A flight survives faults of the program: what dies is told, what can go on goes on, and what cannot is started again, by the
//! rules of our systemd unit.

use super::supervisor::{Seen, Supervisor, Unit};
use crate::dataset::Folder;
use crate::realtime::autopilot::{Autopilot, MOUNTING, gaps_ms, is_tracking, list};
use crate::realtime::live::AWAKE;
use crate::vehicle::{PLUMBLINE, cache, render};
use crate::{stderr, succeeds};
use plumbline_test_support::{SOAK_IN_FULL_MIN, soak_minutes};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Length of the rendered flight, s; no test flies it to its end but those of one process.
const FLIGHT_S: u32 = 12;
/// Time of the fault, in s of the process.
const FAULT_S: f64 = 3.5;
/// From the death of the tick to the first odometry of the next process, s.
const MAX_RESTART_S: f64 = 3.0;
/// Longest gap of odometry with a pose at the autopilot while the estimator restarts, s: the odometry continues by the IMU.
const MAX_BLIND_S: f64 = 0.5;

/// A flight with faults, recorded beforehand and flown in real time.
pub fn flight(sabotage: &str, duration_s: u32, more: &[&str]) -> Command {
    let mut command = Command::new(PLUMBLINE);
    let duration = duration_s.to_string();
    command.args(["replay", "sim:room", "--start", "2", "--scale", "0.5", "--no-lines", "--speed", "1"]);
    command.args(["--duration", &duration, "--set", MOUNTING, "--set", AWAKE]);
    command.arg("--cache").arg(cache()).args(more).env("PLUMBLINE_SABOTAGE", sabotage);
    command.stdout(Stdio::null());
    command
}

/// Result of a flight that met a fault.
struct Survived {
    story: Vec<Seen>,
    /// Odometry messages to the autopilot.
    odometry: Vec<Value>,
    texts: Vec<String>,
    said: String,
}

impl Survived {
    /// Longest time without a message, and without one that tracks once there had been one, s.
    fn gaps_s(&self) -> [f64; 2] {
        let tracking: Vec<Value> = self.odometry.iter().filter(|m| is_tracking(m)).cloned().collect();
        [&self.odometry, &tracking]
            .map(|messages| gaps_ms(messages).last().copied().unwrap_or(f64::MAX) * 1e-3)
    }

    /// Counters in the order in which the autopilot was told of them.
    fn counters(&self) -> Vec<i64> {
        let mut all: Vec<i64> = self.odometry.iter().map(|m| m["reset_counter"].as_i64().unwrap()).collect();
        all.dedup();
        all
    }

    /// Number of starts of the process.
    fn starts(&self) -> usize {
        self.story.iter().filter(|seen| **seen == Seen::Started).count()
    }
}

/// Flies under the unit's rules with a fault in the first process, for so long; `None` where there is no pymavlink.
fn survived(sabotage: &str, seconds: f64) -> Option<Survived> {
    render(FLIGHT_S);
    let folder = tempfile::tempdir().unwrap();
    let autopilot = Autopilot::start_for(seconds + 1.0)?;
    let said = folder.path().join("said");
    let (fault, url, log) = (sabotage.to_owned(), autopilot.url.clone(), said.clone());
    let mut supervisor = Supervisor::start(Unit::ours(), folder.path(), move |start| {
        let mut command = flight(if start == 0 { &fault } else { "" }, FLIGHT_S, &["--autopilot", &url]);
        command.stderr(append(&log));
        command
    });
    std::thread::sleep(Duration::from_secs_f64(seconds));
    supervisor.stop();
    let got = autopilot.finish();
    let texts = list(&got["texts"]).iter().map(|text| text["text"].as_str().unwrap().to_owned()).collect();
    let survived = Survived {
        story: supervisor.story(),
        odometry: list(&got["odometry"]).clone(),
        texts,
        said: std::fs::read_to_string(said).unwrap(),
    };
    let [any, tracking] = survived.gaps_s();
    println!(
        "{sabotage}: {:?}; longest gaps {any:.3} s of any message, {tracking:.3} s of those that track; counters {:?}; {:?}",
        survived.story,
        survived.counters(),
        survived.texts
    );
    Some(survived)
}

fn append(path: &Path) -> std::fs::File {
    std::fs::OpenOptions::new().create(true).append(true).open(path).unwrap()
}

/// Front-end and window begin anew in the process.
fn goes_on(task: &str, seconds: f64) -> Option<[f64; 2]> {
    let survived = survived(&format!("{task}=panic@{FAULT_S}"), seconds)?;
    assert_eq!(survived.starts(), 1, "{:?}\n{}", survived.story, survived.said);
    let gaps = survived.gaps_s();
    assert!(gaps[0] < 0.2 && gaps[1] < MAX_BLIND_S, "{gaps:?}\n{}", survived.said);
    assert_eq!(survived.counters(), [0, 1], "the reset is counted");
    assert!(survived.said.contains(&format!("{task} ended by a fault of its own: the estimate starts anew")));
    Some(gaps)
}

/// The process ends and is started again.
fn comes_back(task: &str, fault: &str, seconds: f64) -> Option<[f64; 2]> {
    let survived = survived(&format!("{task}={fault}@{FAULT_S}"), seconds)?;
    let said = &survived.said;
    assert_eq!(survived.starts(), 2, "{:?}\n{said}", survived.story);
    // Either it says so itself, or it falls silent.
    let how = survived.story.iter().find(|seen| matches!(seen, Seen::Ended(Some(3)) | Seen::Silent));
    assert!(how.is_some(), "{:?}\n{said}", survived.story);
    let gaps = survived.gaps_s();
    assert!(gaps[0] < MAX_RESTART_S, "{gaps:?}\n{said}");
    let is_of_estimator = matches!(task, "front-end" | "window" | "camera");
    // A thread that spins is waited for, and the odometry goes on by the IMU, which is told as lost after half a second.
    let waited_s = if is_of_estimator && fault == "hang" { 1.5 } else { 0.0 };
    assert!(gaps[1] < MAX_RESTART_S + waited_s, "{gaps:?}\n{said}");
    assert!(survived.odometry.iter().any(|m| !is_tracking(m)), "the autopilot is told");
    Some(gaps)
}

#[test]
fn the_death_of_the_tick_ends_the_process_and_odometry_is_back_within_three_seconds() {
    comes_back("tick", "panic", 8.0);
}

#[test]
fn a_dead_window_and_a_dead_front_end_cost_a_reset_and_the_odometry_goes_on() {
    render(FLIGHT_S);
    let folder = Folder::new();
    let (odometry, report, log) =
        (folder.at("odometry.tum"), folder.at("report.json"), folder.at("flight.mcap"));
    let files = ["--odometry", &odometry, "--report", &report, "--record", &log];
    crate::done(flight("window=panic@3 front-end=panic@4.5", 7, &files));
    let report = crate::json(report);
    let live = &report["live"];
    assert_eq!((&live["deaths"], &live["renewals"], &report["resets"]), (&2.into(), &2.into(), &2.into()));
    assert!(live["frames_lost"].as_u64().unwrap() <= 5, "{live:#}");
    let gap_s = longest_gap_s(odometry.as_ref());
    println!("odometry's longest gap {gap_s:.3} s, {live:#}");
    assert!(gap_s < 0.05, "{gap_s} s without odometry");
    // The log holds what happened, and it happens again.
    succeeds(&["verify", &log, "--json"]);
}

/// Longest gap between odometry stamps in a written trajectory, s of data.
fn longest_gap_s(path: &Path) -> f64 {
    let text = std::fs::read_to_string(path).unwrap();
    let stamps: Vec<f64> = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| line.split(' ').next().unwrap().parse().unwrap())
        .collect();
    stamps.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
}

/// Every fault of `task`, ten times; once, where soak tests are not to do all that they can.
fn ten_times(what: &str, mut fly: impl FnMut() -> Option<[f64; 2]>) {
    let rounds = if soak_minutes() < SOAK_IN_FULL_MIN { 1 } else { 10 };
    let gaps: Vec<[f64; 2]> = (0..rounds).map_while(|_| fly()).collect();
    let worst = |k: usize| gaps.iter().map(|gaps| gaps[k]).fold(0.0, f64::max);
    println!(
        "{what}, {} times: gaps {:.2} s of any message, {:.2} s of tracking",
        gaps.len(),
        worst(0),
        worst(1)
    );
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_every_task_dies_and_spins_ten_times() {
    for task in ["window", "front-end"] {
        ten_times(&format!("{task} panics"), || goes_on(task, 7.0));
    }
    for task in ["imu", "tick", "camera", "autopilot"] {
        ten_times(&format!("{task} panics"), || comes_back(task, "panic", 9.0));
    }
    for task in ["imu", "tick", "camera", "front-end", "window", "autopilot"] {
        ten_times(&format!("{task} spins"), || comes_back(task, "hang", 11.0));
    }
}
