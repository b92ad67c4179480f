//! Hours of `plumbline fly`, fed in real time by a serial line and the frame socket: memory, descriptors, the error of
//! stamps and the growth of the log stay as they were after the first minutes.
//!
//! A live flight takes its time from the host's monotonic clock, so hours take hours: `SOAK_MINUTES=120 make soak`.

use super::hardware_in_the_loop::Rig;
use crate::hardware::{Endless, Epoch, Microcontroller, Trouble, send_all};
use crate::local::children;
use crate::vehicle::{eventually, free_port};
use plumbline_config::ImuSample;
use plumbline_drivers::ImuSource as _;
use plumbline_flight::log::source::LogImu;
use plumbline_lab::evaluate::load_trajectory;
use plumbline_test_support::soak_minutes;
use std::io::Read as _;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Lap, its way back and the frame rate of the flight that is repeated.
const LAP_S: &str = "8";
const LAPS: &str = "7";
const FRAME_PERIOD_S: f64 = 0.05;
const SAMPLE_RATE_HZ: usize = 200;
/// Sampling period of what the processes use.
const LOOK: Duration = Duration::from_secs(10);
/// Share of the flight after which nothing may grow.
const SETTLED: f64 = 0.2;
/// Growth from then on that counts as noise of the allocator, MB.
const MAX_GROWTH_MB: f64 = 4.0;
/// Growth of the archive that the network process keeps for stations that come late, MB a minute: keyframes, up to 32 MB, and
/// the poses of half an hour.
const ARCHIVED_MB_A_MINUTE: f64 = 0.1;
/// Samples go on for so long after what is watched, s.
const END_S: f64 = 5.0;
/// Largest median error of the stamps of a minute, us.
const MAX_STAMP_ERROR_US: i64 = 200;

/// Resources of a process at a time.
#[derive(Clone, Copy, Debug, Default)]
struct Held {
    resident_mb: f64,
    descriptors: usize,
    threads: usize,
}

impl Held {
    fn of(process: u32) -> Self {
        let folder = |name: &str| Path::new("/proc").join(process.to_string()).join(name);
        let status = std::fs::read_to_string(folder("status")).unwrap();
        let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        let kb: f64 = resident.trim().trim_end_matches(" kB").parse().unwrap();
        let count = |name| std::fs::read_dir(folder(name)).unwrap().count();
        Self { resident_mb: kb / 1024.0, descriptors: count("fd"), threads: count("task") }
    }
}

/// Flight, its network process and its log at a time.
#[derive(Clone, Copy, Debug)]
struct Glance {
    minutes: f64,
    flight: Held,
    link: Held,
    log_mb: f64,
}

/// The shortest time after which the vehicle is where it was, a whole number of frames, s.
fn period_s(flight: &Path) -> f64 {
    let truth = load_trajectory(flight).unwrap();
    let (first, last) = (truth[0].stamp, truth[truth.len() - 1].stamp);
    let at = |s: f64| &truth[truth.partition_point(|p| p.stamp.seconds_since(first) < s - 1e-4)].pose;
    let length_s = last.seconds_since(first);
    let repeats = |period_s: f64| {
        let compared = (0..).map(|k| 0.25 * f64::from(k)).take_while(|t| t + period_s < length_s);
        compared.into_iter().all(|t| {
            let between = at(t).inverse() * at(t + period_s);
            between.translation.vector.norm() < 5e-3 && between.rotation.angle() < 5e-3
        })
    };
    let periods = (1..).map(|frames| f64::from(frames) * FRAME_PERIOD_S);
    let mut periods = periods.skip_while(|s| *s < 8.0).take_while(|s| s + 8.0 < length_s);
    periods.find(|s| repeats(*s)).expect("the flight repeats itself")
}

/// A flight on its way, ended with the test.
struct Flying(Child);

impl Drop for Flying {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Size of a log with its further parts, which lie beside it, MB.
fn size_mb(log: &Path) -> f64 {
    let files = std::fs::read_dir(log.parent().unwrap()).unwrap().map(|entry| entry.unwrap());
    let parts = files.filter(|file| file.path().extension().is_some_and(|extension| extension == "mcap"));
    parts.map(|file| file.metadata().unwrap().len() as f64 * 1e-6).sum()
}

/// Resources of both processes and size of the log over `minutes`.
fn watch(flying: &mut Flying, [log, said]: [&Path; 2], minutes: f64) -> Vec<Glance> {
    let (start, process) = (Instant::now(), flying.0.id());
    let mut glances = Vec::new();
    while start.elapsed().as_secs_f64() < 60.0 * minutes {
        std::thread::sleep(LOOK);
        assert!(
            flying.0.try_wait().unwrap().is_none(),
            "the flight has ended: {}",
            std::fs::read_to_string(said).unwrap()
        );
        let link = children(process).first().copied().expect("the network process is there");
        let log_mb = size_mb(log);
        let minutes = start.elapsed().as_secs_f64() / 60.0;
        let glance = Glance { minutes, flight: Held::of(process), link: Held::of(link), log_mb };
        println!("{glance:?}");
        glances.push(glance);
    }
    glances
}

/// Median error of the stamps of each minute, us, by the samples of the log. Values tell which sample it is, so that an
/// error of whole periods does not pass for none.
fn stamp_errors_us(log: &Path, endless: &Endless, epoch: Epoch) -> Vec<i64> {
    let bits = |s: &ImuSample| [s.gyro, s.accel].map(|v| [v.x, v.y, v.z].map(|x| (x as f32).to_bits()));
    let first_ns = endless.reading(0).sample.stamp.as_nanos();
    let period_ns = 1_000_000_000 / SAMPLE_RATE_HZ as i64;
    let (mut imu, mut errors) = (LogImu::open(log).unwrap(), Vec::<Vec<i64>>::new());
    while let Some(reading) = imu.next_reading().unwrap() {
        let data_ns = epoch.data(reading.sample.stamp.as_nanos());
        let k = (data_ns - first_ns + period_ns / 2) / period_ns;
        let truth = endless.reading(usize::try_from(k).unwrap()).sample;
        assert_eq!(bits(&reading.sample), bits(&truth), "sample {k} is stamped as another");
        let minute = usize::try_from(k).unwrap() / (60 * SAMPLE_RATE_HZ);
        errors.resize_with(errors.len().max(minute + 1), Vec::new);
        errors[minute].push((data_ns - truth.stamp.as_nanos()).abs() / 1000);
    }
    let median = |mut us: Vec<i64>| {
        us.sort_unstable();
        us.get(us.len() / 2).copied().unwrap_or(0)
    };
    errors.into_iter().map(median).collect()
}

/// A part of the flight, given as shares of its time.
fn part(glances: &[Glance], shares: [f64; 2]) -> &[Glance] {
    let end = glances[glances.len() - 1].minutes;
    let [from, to] = shares.map(|share| glances.partition_point(|g| g.minutes < share * end));
    &glances[from..to]
}

/// A process holds no more at the end than when it had settled.
fn assert_settled(name: &str, max_growth_mb: f64, glances: &[Glance], held: impl Fn(&Glance) -> Held) {
    let resident_mb = |shares| {
        let part = part(glances, shares);
        part.iter().map(|g| held(g).resident_mb).sum::<f64>() / part.len() as f64
    };
    let [settled, end] = [resident_mb([SETTLED, SETTLED + 0.2]), resident_mb([0.8, 1.0])];
    println!("{name}: {settled:.1} MB settled, {end:.1} MB at the end");
    assert!(end - settled <= max_growth_mb, "{name} has grown by {:.1} MB", end - settled);
    for (what, count) in
        [("descriptors", (|h| h.descriptors) as fn(Held) -> usize), ("threads", |h| h.threads)]
    {
        let counts = || part(glances, [SETTLED, 1.0]).iter().map(|g| count(held(g)));
        let (fewest, most) = (counts().min().unwrap(), counts().max().unwrap());
        println!("{name}: {fewest} to {most} {what}");
        assert_eq!(fewest, most, "{what} of the {name}");
    }
}

/// The log grows by as much in each part of the flight.
fn assert_steady_log(glances: &[Glance]) {
    let mb_a_minute = |shares| {
        let part = part(glances, shares);
        let (first, last) = (part[0], part[part.len() - 1]);
        (last.log_mb - first.log_mb) / (last.minutes - first.minutes)
    };
    let [settled, end] = [mb_a_minute([SETTLED, 0.6]), mb_a_minute([0.6, 1.0])];
    println!("log: {settled:.2} MB a minute settled, {end:.2} MB at the end");
    assert!((end / settled - 1.0).abs() < 0.1, "{settled} {end}");
}

/// Ends what plays the sensors, whatever becomes of the test.
struct Ends<'a>(&'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Reads the local socket until the flight ends, as a program on the vehicle does.
fn read_local(path: &Path) {
    let mut reader = None;
    eventually("the local socket is there", Duration::from_secs(20), || {
        reader = UnixStream::connect(path).ok();
        reader.is_some()
    });
    let (mut reader, mut bytes) = (reader.unwrap(), vec![0; 1 << 16]);
    while reader.read(&mut bytes).is_ok_and(|count| count > 0) {}
}

#[test]
#[ignore = "takes minutes or hours: make soak"]
fn soak_memory_descriptors_stamps_and_log_stay_flat_over_a_long_flight() {
    let minutes = f64::from(soak_minutes());
    let rig = Rig::simulated(&["--start", "2", "--duration", LAP_S, "--laps", LAPS, "--scale", "0.3"]);
    let period_s = period_s(&rig.path("flight"));
    println!("a round takes {period_s:.2} s");
    let [log, local, report, imu, frames, said] =
        ["flight.mcap", "local", "report.json", "imu", "frames", "said"].map(|name| rig.path(name));
    let set = |setting: String| ["--set".to_owned(), setting];
    let more = [
        set("estimator.lines.enabled=false".into()),
        set("recorder.images=\"none\"".into()),
        // The index of a file is kept until it is full.
        set("recorder.max_file_mb=32".into()),
        set("runtime.idle_latency_us=50".into()),
        set(format!("local.path=\"{}\"", local.display())),
        ["--listen".into(), format!("tcp/127.0.0.1:{}", free_port())],
        ["--record".into(), log.display().to_string()],
    ];
    let mut imu = Microcontroller::plugged_in(&imu);
    let mut flying = Flying(rig.commands(more.concat())().spawn().unwrap());
    let epoch = Epoch::in_ms(&rig.recording, 700);
    let endless = Endless::new(rig.recording, period_s);
    let seconds = 60.0 * minutes + END_S;
    let [samples, images] = [1.0 / SAMPLE_RATE_HZ as f64, FRAME_PERIOD_S].map(|s| (seconds / s) as usize);
    let is_over = AtomicBool::new(false);
    let go_on = |_: &usize| !is_over.load(Ordering::Relaxed);
    let glances = std::thread::scope(|scope| {
        let _ends = Ends(&is_over);
        scope.spawn(|| read_local(&local));
        scope.spawn(|| {
            let readings = (0..samples).take_while(go_on).map(|k| (k, endless.reading(k)));
            imu.play_all(epoch, readings, &Trouble::none())
        });
        scope.spawn(|| {
            let each = |k| {
                let (stamp, frame) = endless.frame(k);
                (k, stamp, frame)
            };
            send_all(&frames, endless.recording().sizes_px, epoch, (0..images).take_while(go_on).map(each));
        });
        let glances = watch(&mut flying, [&log, &said], minutes);
        assert!(Command::new("kill").args(["-INT", &flying.0.id().to_string()]).status().unwrap().success());
        assert!(flying.0.wait().unwrap().success());
        glances
    });
    let report = crate::json(report);
    let errors_us = stamp_errors_us(&log, &endless, epoch);
    println!("median error of the stamps in each minute, us: {errors_us:?}");
    println!("{:#}\n{:#}", report["live"], report["sensors"]);
    assert_settled("flight", MAX_GROWTH_MB, &glances, |g| g.flight);
    let archived_mb = ARCHIVED_MB_A_MINUTE * minutes;
    assert_settled("network process", MAX_GROWTH_MB + archived_mb, &glances, |g| g.link);
    assert_steady_log(&glances);
    assert!(errors_us.iter().skip(1).all(|us| *us <= MAX_STAMP_ERROR_US), "{errors_us:?}");
    assert_eq!(report["hot_path_allocations"], 0);
    assert_eq!(report["resets"], 0);
    assert!(report["completion"].as_f64().unwrap() > 0.9, "{}", report["completion"]);
}
