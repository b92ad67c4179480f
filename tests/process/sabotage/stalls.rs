//! Obstacles for which a flight does not wait: a disk that is full or gone, a terminal that nobody reads, and programs kept
//! from running. Part of `make soak`.

use super::survival::flight;
use crate::dataset::Folder;
use crate::hardware::{Epoch, Microcontroller, Trouble, send_frames};
use crate::mounted::Mounted;
use crate::realtime::autopilot::{Autopilot, gaps_ms, is_tracking, list};
use crate::realtime::hardware_in_the_loop::Rig;
use crate::{plumbline, stderr};
use plumbline_test_support::{Need, skip};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use serde_json::Value;
use std::fs::File;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Length of the flights, s; when frames begin, and when something happens to the disk.
const END_S: f64 = 9.0;
const FRAMES_S: f64 = 2.5;
const EVENT_S: f64 = 6.5;
/// Longest gap of odometry sent to the autopilot at 40 Hz, ms.
const MAX_GAP_MS: f64 = 100.0;
/// Longest lateness, ms: where programs of real-time priority leave nothing, the kernel keeps a twentieth of each second for
/// all others; and some more.
const MAX_LATE_MS: f64 = 50.0 + 30.0;
/// Age from which everything written is on the medium, s.
const MAX_LOST_S: f64 = 2.0;

/// Messages to the autopilot, and the end of the flight.
struct Flown {
    odometry: Vec<Value>,
    status: ExitStatus,
    ended_within: Duration,
}

/// Flies with live sensors; `during` runs when something is to happen. `None` without pymavlink.
fn flown(rig: &Rig, mut command: Command, during: impl FnOnce() + Send) -> Option<Flown> {
    let autopilot = Autopilot::start_for(END_S + 4.0)?;
    command.arg("--set").arg(format!("autopilot.connect=\"{}\"", autopilot.url));
    let mut imu = Microcontroller::plugged_in(&rig.path("imu"));
    let mut child = command.spawn().unwrap();
    // Its terminals are ours no more.
    drop(command);
    let (recording, epoch) = (&rig.recording, Epoch::in_ms(&rig.recording, 700));
    std::thread::scope(|scope| {
        let frames = rig.frames(FRAMES_S..END_S - 0.3);
        scope.spawn(move || send_frames(&rig.path("frames"), recording, epoch, frames));
        scope.spawn(move || {
            std::thread::sleep(Duration::from_secs_f64(0.7 + EVENT_S));
            during();
        });
        imu.play(recording, epoch, rig.samples(0.0..END_S), &Trouble::none());
    });
    let asked = Instant::now();
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let status = end_of(&mut child);
    let ended_within = asked.elapsed();
    Some(Flown { odometry: list(&autopilot.finish()["odometry"]).clone(), status, ended_within })
}

/// Within ten seconds.
fn end_of(child: &mut Child) -> ExitStatus {
    let end = Instant::now() + Duration::from_secs(10);
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        if Instant::now() > end {
            let _ = child.kill();
            let _ = child.wait();
            panic!("it did not end");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

impl Flown {
    /// Odometry came all the time, from the first pose on.
    fn assert_never_silent(&self) {
        let tracking: Vec<Value> = self.odometry.iter().filter(|m| is_tracking(m)).cloned().collect();
        let longest_ms = gaps_ms(&tracking).last().copied().unwrap_or(f64::MAX);
        println!(
            "{} messages with a pose, longest gap {longest_ms:.1} ms; {:?}",
            tracking.len(),
            self.status
        );
        assert!(tracking.len() > 150 && longest_ms < MAX_GAP_MS, "{} {longest_ms}", tracking.len());
    }
}

/// A terminal that nobody reads, full to the brim, to write to; with its other end.
fn stalled_terminal() -> (File, File) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let path = ptsname(&master, Vec::new()).unwrap();
    let open = |flags| {
        File::from(rustix::fs::open(&path, OFlags::WRONLY | OFlags::NOCTTY | flags, Mode::empty()).unwrap())
    };
    let filler = open(OFlags::NONBLOCK);
    while rustix::io::write(&filler, &[b'.'; 256]).is_ok() {}
    (open(OFlags::empty()), File::from(master))
}

#[test]
#[ignore = "a quarter of a minute: `make soak`"]
fn soak_a_full_disk_and_a_terminal_that_stands_still_hold_up_no_odometry() {
    let rig = Rig::new(END_S, &["--scale", "0.5"]);
    // Room for a second of images.
    let Some(disk) = Mounted::with(&["-t", "tmpfs", "-o", "size=6m", "tmpfs"], rig.path("disk")) else {
        return;
    };
    let log = disk.0.join("flight.mcap").display().to_string();
    let arguments = ["--record", &log, "--set", "recorder.images=raw"].map(str::to_owned);
    let mut command = rig.commands(arguments.into())();
    let (terminal, _other_end) = stalled_terminal();
    command.stdout(terminal.try_clone().unwrap()).stderr(terminal);
    let Some(flown) = flown(&rig, command, || ()) else { return };
    flown.assert_never_silent();
    let report = rig.report();
    println!("ended within {:?}; {}", flown.ended_within, report["recording"]);
    assert!(report["recording"]["ended_early"].as_str().is_some_and(|why| why.contains("space")), "{report}");
    assert!(flown.ended_within < Duration::from_secs(5), "{:?}", flown.ended_within);
}

/// Has the file system forget what was not synced, and refuse everything from now on, as if its power had failed.
fn cut_power(of: &Path) {
    // EXT4_IOC_SHUTDOWN without a flush of the journal.
    let cut = "import fcntl, os, struct, sys\n\
               fcntl.ioctl(os.open(sys.argv[1], os.O_RDONLY), 0x8004587d, struct.pack('I', 2))";
    assert!(Command::new("python3").args(["-c", cut]).arg(of).status().unwrap().success());
}

#[test]
#[ignore = "a quarter of a minute: `make soak`"]
fn soak_a_disk_whose_power_fails_keeps_the_log_up_to_two_seconds_before_and_the_flight_goes_on() {
    let rig = Rig::new(END_S, &["--scale", "0.5"]);
    let image = rig.path("image").display().to_string();
    File::create(&image).unwrap().set_len(400 << 20).unwrap();
    if !Command::new("mkfs.ext4").args(["-q", &image]).status().is_ok_and(|made| made.success()) {
        return skip(Need::Mounts, "mkfs.ext4 is missing");
    }
    let Some(disk) = Mounted::with(&["-o", "loop", &image], rig.path("disk")) else { return };
    let log = disk.0.join("flight.mcap").display().to_string();
    let arguments = ["--record", &log, "--set", "recorder.images=raw"].map(str::to_owned);
    let at = disk.0.clone();
    let Some(flown) = flown(&rig, rig.commands(arguments.into())(), || cut_power(&at)) else { return };
    flown.assert_never_silent();
    drop(disk);
    let Some(_disk) = Mounted::with(&["-o", "loop", &image], rig.path("disk")) else { return };
    let verified = plumbline(&["verify", &log, "--allow-incomplete", "--json"]);
    let words = format!("{}{}{}", String::from_utf8_lossy(&verified.stdout), stderr(&verified), rig.said());
    println!("{words}");
    assert!(verified.status.success(), "{words}");
    let verified: Value = serde_json::from_slice(&verified.stdout).unwrap();
    assert_eq!(verified["truncated"], true, "{words}");
    // Twenty frames a second.
    let kept = verified["estimates_identical"].as_u64().unwrap() as f64;
    assert!(kept >= 20.0 * (EVENT_S - FRAMES_S - MAX_LOST_S), "{words}");
}

/// Programs that do nothing but hold processors, at a real-time priority below all of ours.
struct Load(Vec<Child>);

impl Load {
    fn on_every_processor() -> Self {
        let spin = ["-f", "1", "sh", "-c", "while :; do :; done"];
        let one = |_| Command::new("chrt").args(spin).spawn().unwrap();
        Self((0..std::thread::available_parallelism().unwrap().get()).map(one).collect())
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        for child in &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

#[test]
#[ignore = "a quarter of a minute: `make soak`"]
fn soak_load_between_our_priorities_and_everybody_elses_holds_up_no_odometry() {
    if !Command::new("chrt").args(["-f", "1", "true"]).status().is_ok_and(|done| done.success()) {
        return skip(Need::RealtimePriority, "chrt -f 1 is refused");
    }
    let folder = Folder::new();
    let (report, log, odometry) =
        (folder.at("report.json"), folder.at("flight.mcap"), folder.at("odometry.tum"));
    let files = ["--report", &report, "--record", &log, "--odometry", &odometry, "--publish"];
    let sink = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let autopilot = format!("udp://{}", sink.local_addr().unwrap());
    let mut command = flight("", 10, &[&files[..], &["--autopilot", &autopilot]].concat());
    let said = File::create(folder.path().join("said")).unwrap();
    let mut child = command.stdout(Stdio::null()).stderr(said).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(5));
    let load = Load::on_every_processor();
    std::thread::sleep(Duration::from_secs(2));
    drop(load);
    let status = child.wait().unwrap();
    let said = std::fs::read_to_string(folder.path().join("said")).unwrap();
    assert!(status.success(), "{said}");
    let report = crate::json(report);
    let (live, bridge) = (&report["live"], &report["autopilot"]);
    println!("{live:#} {bridge:#} {}", report["recording"]);
    assert_eq!([&live["deaths"], &live["renewals"], &live["stalls"]], [0, 0, 0], "{said}");
    for late_ms in [&live["tick_late_ms"], &live["sample_to_odometry_ms"], &bridge["late_ms"]] {
        assert!(late_ms["max"].as_f64().unwrap() < MAX_LATE_MS, "{late_ms} {said}");
    }
    assert!(bridge["odometry"].as_u64().unwrap() > 380, "{bridge}");
}
