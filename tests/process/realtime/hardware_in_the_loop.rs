//! `plumbline fly` as a process, with an IMU at a real serial line and frames over a socket: what it makes of them is what
//! `replay` makes of the same flight, whatever happens on the line.

use crate::hardware::{Epoch, Microcontroller, Recording, Trouble, send_frames};
use crate::realtime::live::AWAKE;
use crate::{plumbline, stderr, succeeds};
use plumbline_config::Timestamp;
use plumbline_drivers::tum::read_tum;
use plumbline_drivers::{ImuSource as _, StampedPose};
use plumbline_flight::log::source::LogImu;
use plumbline_lab::evaluate::{EvaluateOptions, evaluate, load_trajectory};
use serde_json::Value;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Largest error of a stamp once the clock of the sensor is known, ns.
const STAMP_TOLERANCE_NS: i64 = 200_000;
/// Largest ratio of the position error in flight to that in replay.
const MAX_ATE_RATIO: f64 = 1.1;
/// Frames are sent once the clock of the sensor is known, s.
const CONVERGED_S: f64 = 3.0;
const FRAME_RATE_HZ: f64 = 20.0;
/// Largest difference of the position error over the firmware in C to that over the device of these tests, relative.
const FIRMWARE_TOLERANCE: f64 = 0.02;

/// A simulated flight as a data set with its configuration, and where `fly` finds its sensors.
pub struct Rig {
    folder: tempfile::TempDir,
    pub recording: Recording,
}

impl Rig {
    pub fn new(duration_s: f64, more: &[&str]) -> Self {
        Self::simulated(&[&["--start", "1", "--duration", &duration_s.to_string()], more].concat())
    }

    /// The flight that `simulate` makes with these options.
    pub fn simulated(options: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let [flight, config] =
            ["flight", "rig.toml"].map(|name| folder.path().join(name).display().to_string());
        succeeds(&[&["simulate", &flight], options].concat());
        let imported =
            plumbline(&["config", "import", "--euroc", &flight, "--base", "sim", "--out", &config]);
        assert!(imported.status.success(), "{}", stderr(&imported));
        Self { recording: Recording::read(flight.as_ref()), folder }
    }

    fn at(&self, name: &str) -> String {
        self.folder.path().join(name).display().to_string()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Folder of all files.
    #[cfg(feature = "sabotage")]
    pub fn folder(&self) -> &std::path::Path {
        self.folder.path()
    }

    /// Settings that name the IMU at the link `imu` and the socket `frames`.
    fn sensors(&self) -> [String; 2] {
        [
            format!("driver.imu.connect=\"serial://{}:921600\"", self.at("imu")),
            format!("driver.frames.listen=\"{}\"", self.at("frames")),
        ]
    }

    /// Makes `fly`, with the IMU at the link `imu` and frames over the socket `frames`, as often as it is asked to; what is said
    /// is gathered.
    pub fn commands(&self, more: Vec<String>) -> impl Fn() -> Command + Send + use<> {
        let [imu, frames] = self.sensors();
        let (config, report, said) = (self.at("rig.toml"), self.at("report.json"), self.path("said"));
        move || {
            let mut command = Command::new(env!("CARGO_BIN_EXE_plumbline"));
            command.args(["fly", "--config", &config, "--set", &imu, "--set", &frames, "--set", AWAKE]);
            command.args(["--report", &report]).args(&more);
            let said = std::fs::File::options().create(true).append(true).open(&said).unwrap();
            command.stdout(Stdio::null()).stderr(said);
            command
        }
    }

    /// `fly` on its way.
    fn fly(&self, more: &[&str]) -> Flying {
        let more = more.iter().map(|&argument| argument.to_owned()).collect();
        Flying(self.commands(more)().spawn().unwrap())
    }

    pub fn report(&self) -> Value {
        crate::json(self.path("report.json"))
    }

    pub fn said(&self) -> String {
        std::fs::read_to_string(self.path("said")).unwrap()
    }

    /// Places of the samples in this part of the recording, s.
    pub fn samples(&self, s: Range<f64>) -> Range<usize> {
        let first = self.recording.readings[0].sample.stamp;
        let place = |s| self.recording.readings.partition_point(|r| r.sample.stamp.seconds_since(first) < s);
        place(s.start)..place(s.end)
    }

    /// Frames in this part of the recording, s.
    pub fn frames(&self, s: Range<f64>) -> Range<usize> {
        let first = self.recording.readings[0].sample.stamp;
        let place = |s| self.recording.frames.partition_point(|f| f.stamp.seconds_since(first) < s);
        place(s.start)..place(s.end)
    }
}

/// A flight on its way, ended when the test is.
struct Flying(Child);

impl Flying {
    /// Sends the signal, and waits for the end.
    fn ends_by(mut self, signal: &str) {
        let asked = Instant::now();
        let pid = self.0.id().to_string();
        assert!(Command::new("kill").args([signal, &pid]).status().unwrap().success());
        assert!(self.0.wait().unwrap().success());
        assert!(asked.elapsed() < Duration::from_secs(3), "{:?}", asked.elapsed());
    }
}

impl Drop for Flying {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Root mean square error of positions after SE(3) alignment, m.
fn ate_m(estimate: &[StampedPose], truth: &[StampedPose]) -> f64 {
    evaluate(estimate, truth, &EvaluateOptions::default()).unwrap().ate_m.rmse
}

/// Poses with a counterpart in `others` within 5 ms.
fn common(poses: &[StampedPose], others: &[StampedPose]) -> Vec<StampedPose> {
    let has = |pose: &&StampedPose| {
        let k = others.partition_point(|other| other.stamp < pose.stamp);
        let near = others[k.saturating_sub(1)..(k + 1).min(others.len())].iter();
        near.min_by_key(|other| other.stamp.nanos_since(pose.stamp).abs())
            .is_some_and(|other| other.stamp.nanos_since(pose.stamp).abs() < 5_000_000)
    };
    poses.iter().filter(has).cloned().collect()
}

/// Result of a flight in the loop.
struct Compared {
    report: Value,
    /// Poses that both have, of all frames that were sent.
    completion: f64,
    ate_m: f64,
    ate_replayed_m: f64,
    stamp_errors_ns: Vec<i64>,
}

/// Flies from [`CONVERGED_S`] on, and compares with `replay` of the same frames.
fn flown_and_replayed(rig: &Rig, end_s: f64, trouble: &Trouble) -> Compared {
    compared(rig, end_s, |imu, epoch, samples| imu.play(&rig.recording, epoch, samples, trouble))
}

/// Flies with the samples that `play` sends; it returns the numbers of those that were hit on the way.
fn compared(
    rig: &Rig,
    end_s: f64,
    play: impl FnOnce(&mut Microcontroller, Epoch, Range<usize>) -> Vec<usize>,
) -> Compared {
    let recording = &rig.recording;
    let (log, poses) = (rig.at("flight.mcap"), rig.at("flown.tum"));
    let recorder = ["--set", "recorder.images=raw", "--set", "recorder.queue_frames=40"];
    let mut imu = Microcontroller::plugged_in(&rig.path("imu"));
    let flying = rig.fly(&[&["--record", &log, "--trajectory", &poses][..], &recorder].concat());
    let epoch = Epoch::in_ms(recording, 700);
    let frames = rig.frames(CONVERGED_S..end_s - 0.2);
    let hit = std::thread::scope(|scope| {
        scope.spawn(|| send_frames(&rig.path("frames"), recording, epoch, frames.clone()));
        play(&mut imu, epoch, rig.samples(0.0..end_s))
    });
    std::thread::sleep(Duration::from_millis(300));
    flying.ends_by("-INT");
    let report = rig.report();
    let stamp_errors_ns = check_samples(rig, &log, epoch, &hit, end_s);
    succeeds(&["verify", &log]);
    // The same frames, read from the data set.
    let (flight, config, replayed) = (rig.at("flight"), rig.at("rig.toml"), rig.at("replayed.tum"));
    let range = format!("{}..{}", frames.start, frames.end);
    let output =
        plumbline(&["replay", &flight, "--config", &config, "--frames", &range, "--trajectory", &replayed]);
    assert!(output.status.success(), "{}", stderr(&output));
    let mut flown = read_tum(poses.as_ref()).unwrap();
    flown.iter_mut().for_each(|p| p.stamp = Timestamp::from_nanos(epoch.data(p.stamp.as_nanos())));
    let (replayed, truth) = (read_tum(replayed.as_ref()).unwrap(), load_trajectory(flight.as_ref()).unwrap());
    let (flown, replayed) = (common(&flown, &replayed), common(&replayed, &flown));
    let (ate_m, ate_replayed_m) = (ate_m(&flown, &truth), ate_m(&replayed, &truth));
    println!(
        "{} common poses: ATE {:.2} mm flown, {:.2} mm replayed; {}",
        flown.len(),
        ate_m * 1e3,
        ate_replayed_m * 1e3,
        report["sensors"]
    );
    let completion = flown.len() as f64 / frames.len() as f64;
    Compared { report, completion, ate_m, ate_replayed_m, stamp_errors_ns }
}

/// No sample is lost but those that were hit; the errors of the stamps once the sensor's clock is known, sorted, ns.
fn check_samples(rig: &Rig, log: &str, epoch: Epoch, hit: &[usize], end_s: f64) -> Vec<i64> {
    let bits = |v: &nalgebra::Vector3<f64>| [v.x, v.y, v.z].map(|x| (x as f32).to_bits());
    let key = |sample: &plumbline_config::ImuSample| (bits(&sample.gyro), bits(&sample.accel));
    let readings = &rig.recording.readings;
    let places: BTreeMap<_, _> = readings.iter().enumerate().map(|(k, r)| (key(&r.sample), k)).collect();
    let (mut imu, mut came, mut errors_ns) = (LogImu::open(log.as_ref()).unwrap(), Vec::new(), Vec::new());
    let converged = rig.samples(CONVERGED_S..end_s).start;
    while let Some(reading) = imu.next_reading().unwrap() {
        let k = places[&key(&reading.sample)];
        came.push(k);
        if k >= converged {
            let truth_ns = epoch.host(readings[k].sample.stamp.as_nanos());
            errors_ns.push((reading.sample.stamp.as_nanos() - truth_ns).abs());
        }
    }
    let (first, last) = (came[0], *came.last().unwrap());
    let expected: Vec<usize> = (first..=last).filter(|k| !hit.contains(k)).collect();
    assert_eq!(came, expected, "samples were lost that were not hit");
    assert!(
        first < rig.samples(0.0..2.5).end && last + 3 >= rig.samples(0.0..end_s).end,
        "{first} to {last}"
    );
    errors_ns.sort_unstable();
    errors_ns
}

/// Garbage, changed and broken frames, pieces, bursts for a second, and a stall of 200 ms.
fn trouble() -> Trouble {
    let begin_s = CONVERGED_S;
    Trouble {
        noise_per_mille: 20,
        hit_per_mille: 5,
        split_per_mille: 100,
        bursts_s: begin_s + 1.2..begin_s + 2.2,
        stall_s: begin_s + 2.7..begin_s + 2.9,
    }
}

impl Compared {
    fn assert_good(&self) {
        self.assert_sound();
        assert!(self.ate_ratio() <= MAX_ATE_RATIO, "{}", self.ate_ratio());
    }

    fn ate_ratio(&self) -> f64 {
        self.ate_m / self.ate_replayed_m
    }

    fn assert_sound(&self) {
        let errors = &self.stamp_errors_ns;
        let at = |share: f64| errors[((errors.len() - 1) as f64 * share) as usize];
        println!(
            "ATE ratio {:.3}; stamps wrong by {} us in the median, {} at p99, {} at most",
            self.ate_ratio(),
            at(0.5) / 1000,
            at(0.99) / 1000,
            at(1.0) / 1000
        );
        assert!(self.completion > 0.9, "{} of the frames", self.completion);
        assert!(at(0.99) <= STAMP_TOLERANCE_NS, "{} us", at(0.99) / 1000);
        assert_eq!(self.report["hot_path_allocations"], 0, "{}", self.report["sensors"]);
        assert_eq!(self.report["resets"], 0);
        // Samples that come late are waited for, and the frames that came meanwhile are not left out.
        let live = &self.report["live"];
        assert_eq!((&live["frames_shed"], &live["steps_down"]), (&0.into(), &0.into()), "{live}");
        let cameras = &self.report["sensors"]["cameras"];
        assert_eq!((&cameras["missing"], &cameras["left_alone"]), (&0.into(), &0.into()), "{cameras}");
    }
}

#[test]
fn what_is_flown_is_as_accurate_as_what_is_replayed_whatever_happens_on_the_line() {
    let end_s = 7.2;
    let rig = Rig::new(end_s, &["--scale", "0.5"]);
    flown_and_replayed(&rig, end_s, &trouble()).assert_good();
}

/// The firmware in C in the place of the device of these tests, on the same flight without trouble on the line.
#[test]
fn the_firmware_in_c_flies_as_the_device_of_these_tests() {
    let end_s = 7.2;
    let rig = Rig::new(end_s, &["--scale", "0.5"]);
    let folder = tempfile::tempdir().unwrap();
    let Some(program) = crate::firmware::on_host(folder.path()) else { return };
    let usual = flown_and_replayed(&rig, end_s, &Trouble::none());
    // A log is never overwritten.
    std::fs::remove_file(rig.path("flight.mcap")).unwrap();
    let firmware = compared(&rig, end_s, |imu, epoch, samples| {
        let mut child = imu.played_by(&program, folder.path(), &rig.recording, epoch, samples);
        assert!(child.wait().unwrap().success());
        Vec::new()
    });
    usual.assert_sound();
    firmware.assert_sound();
    let ratio = firmware.ate_m / usual.ate_m;
    println!("ATE over the firmware {ratio:.4} times that over the device of the tests");
    assert!((ratio - 1.0).abs() <= FIRMWARE_TOLERANCE, "{ratio}");
    let imu = &firmware.report["sensors"]["imu"];
    assert_eq!(imu["stream"]["missing"].as_u64().or(imu["missing"].as_u64()), Some(0), "{imu}");
}

/// Ratio over three flights: losses on the line make each flight a little better or worse by chance.
#[test]
#[ignore = "takes minutes: make soak"]
fn soak_an_imu_at_1_khz_and_at_200_hz_in_the_loop_for_half_a_minute() {
    let end_s = 33.0;
    let flown = ["200", "1000"].map(|rate_hz| {
        let folder = tempfile::tempdir().unwrap();
        let config = folder.path().join("sim.toml");
        let preset = String::from_utf8(plumbline(&["config", "sim"]).stdout).unwrap();
        let [before, after] = ["rate_hz = 200.0", &format!("rate_hz = {rate_hz}.0")].map(str::to_owned);
        assert!(preset.contains(&before));
        std::fs::write(&config, preset.replacen(&before, &after, 1)).unwrap();
        println!("{rate_hz} Hz");
        ["1", "2", "3"].map(|seed| {
            let config = config.to_str().unwrap();
            let rig = Rig::new(end_s, &["--config", config, "--scale", "0.5", "--seed", seed]);
            flown_and_replayed(&rig, end_s, &trouble())
        })
    });
    flown.iter().flatten().for_each(Compared::assert_sound);
    for flights in &flown {
        let square_sum = |ate: fn(&Compared) -> f64| flights.iter().map(|f| ate(f).powi(2)).sum::<f64>();
        let ratio = (square_sum(|f| f.ate_m) / square_sum(|f| f.ate_replayed_m)).sqrt();
        println!("ATE ratio of the flights together {ratio:.3}");
        assert!(ratio <= MAX_ATE_RATIO, "{ratio}");
    }
}

#[test]
fn doctor_judges_the_sensors_that_are_plugged_in() {
    let rig = Rig::new(8.2, &["--scale", "0.5"]);
    let recording = &rig.recording;
    let mut imu = Microcontroller::plugged_in(&rig.path("imu"));
    let [imu_setting, frames_setting] = rig.sensors();
    let mut doctor = Command::new(env!("CARGO_BIN_EXE_plumbline"));
    doctor.args(["doctor", "--config", &rig.at("rig.toml"), "--set", &imu_setting, "--set", &frames_setting]);
    doctor.args(["--live", "--seconds", "7", "--watch", "0.1", "--json"]);
    let doctor = doctor.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let epoch = Epoch::in_ms(recording, 300);
    let output = std::thread::scope(|scope| {
        scope.spawn(|| send_frames(&rig.path("frames"), recording, epoch, rig.frames(0.0..8.0)));
        scope.spawn(|| imu.play(recording, epoch, rig.samples(0.0..8.2), &Trouble::none()));
        doctor.wait_with_output().unwrap()
    });
    let report: Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", stderr(&output)));
    println!("{:#}", report["measures"]);
    let of = |name: &str| report["measures"].as_array().unwrap().iter().find(|m| m["name"] == name).unwrap();
    // The first seconds of a flight have no time at rest and few turns: what is there is good.
    for name in ["IMU timing", "camera timing"] {
        assert_eq!(of(name)["verdict"], "good", "{:#}", of(name));
    }
    assert_eq!(report["source"], "the configured sensors");
}

#[test]
fn sensors_that_are_missing_at_the_start_and_unplugged_in_flight_are_taken_when_they_come() {
    let rig = Rig::new(5.6, &["--scale", "0.5"]);
    let recording = &rig.recording;
    let flying = rig.fly(&[]);
    std::thread::sleep(Duration::from_millis(600));
    let epoch = Epoch::in_ms(recording, 100);
    let play = |s: Range<f64>| {
        let mut imu = Microcontroller::plugged_in(&rig.path("imu"));
        imu.play(recording, epoch, rig.samples(s), &Trouble::none());
    };
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // The first program ends, and the frames of a second are missing.
            send_frames(&rig.path("frames"), recording, epoch, rig.frames(1.3..2.5));
            send_frames(&rig.path("frames"), recording, epoch, rig.frames(3.5..5.4));
        });
        play(0.0..4.2);
        // Pulled out, and back after a tenth of a second.
        std::thread::sleep(Duration::from_millis(100));
        play(4.3..5.6);
    });
    std::thread::sleep(Duration::from_millis(300));
    flying.ends_by("-TERM");
    let (report, said) = (rig.report(), rig.said());
    println!("{said}{:#}", report["sensors"]);
    let imu = &report["sensors"]["imu"];
    assert_eq!((&imu["opened"], &imu["lost"]), (&2.into(), &2.into()));
    let cameras = &report["sensors"]["cameras"];
    let missing = cameras["missing"].as_f64().unwrap();
    assert_eq!((&cameras["socket"]["connected"], &cameras["gaps"]), (&2.into(), &1.into()), "{cameras}");
    assert!((missing - FRAME_RATE_HZ).abs() <= 2.0, "{cameras}");
    for words in [
        "the IMU is missing",
        "the IMU is available",
        "no program sends frames yet",
        "the program that sent frames has disconnected",
    ] {
        assert!(said.contains(words), "'{words}' is missing in {said}");
    }
    assert!(report["completion"].as_f64().unwrap() > 0.5, "{report:#}");
    assert_eq!(report["hot_path_allocations"], 0);
}
