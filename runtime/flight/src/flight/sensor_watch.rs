//! Tells, while a flight goes on, which sensors are missing and which are back. A thread of normal priority asks their
//! drivers some times a second; nothing of it is on the way of a sample.

use super::sensors::LiveSensors;
use crate::schedule::worker::Worker;
use crate::sensor_board::{SensorBoard, SensorNews};
use parking_lot::Mutex;
use plumbline_drivers::ImuFigures;
use plumbline_drivers::clock::{StampDefect, StampFigures, StampProblem};
use plumbline_drivers::inertial::LinkFigures;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Drivers are asked this often.
const LOOK: Duration = Duration::from_millis(100);
/// A sensor that is there has to bring something within this time, and one that has brought something more within the second.
const PATIENCE: Duration = Duration::from_secs(3);
const SILENCE: Duration = Duration::from_millis(500);
/// Share of the samples of a second that may be unusable before it is reported, and share of those that repeat the one before
/// from which on it is.
const MAX_UNUSABLE: f64 = 0.1;
const MIN_STUCK: f64 = 0.6;
/// Looks over which bad stamps are counted: a second.
const STAMP_LOOKS: usize = 10;
/// Clock that frames are stamped by, as messages name it.
const FRAME_CLOCK: &str = "the middle of the exposure in ns of CLOCK_MONOTONIC";

/// Present faults of the sensors, one line each, for display.
#[derive(Clone, Debug, Default)]
pub struct SensorNotices(Arc<Mutex<Vec<String>>>);

impl SensorNotices {
    /// The notices.
    pub fn read(&self) -> Vec<String> {
        self.0.lock().clone()
    }

    /// Replaces the notices.
    pub fn set(&self, notices: &[String]) {
        notices.clone_into(&mut self.0.lock());
    }
}

/// Present faults of one sensor.
#[derive(Clone, Debug, Default)]
pub struct SensorTrouble {
    /// Reason why it brings nothing.
    pub missing: Option<String>,
    /// Defect of its stamps.
    pub stamps: Option<String>,
}

/// The thread that asks.
#[derive(Debug)]
pub struct SensorWatch {
    troubles: Arc<Mutex<[SensorTrouble; 2]>>,
    notices: SensorNotices,
    _worker: Worker,
}

impl SensorWatch {
    /// Starts it. What is wrong is logged, and posted on `board`.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn start(sensors: &LiveSensors, board: Option<SensorBoard>) -> std::io::Result<Self> {
        let (is_over, sensors) = (Arc::new(AtomicBool::new(false)), sensors.clone());
        let theirs = Arc::clone(&is_over);
        let notices = SensorNotices::default();
        let shown = notices.clone();
        let troubles = Arc::<Mutex<[SensorTrouble; 2]>>::default();
        let found = Arc::clone(&troubles);
        let stop = move || is_over.store(true, Ordering::Relaxed);
        let worker = Worker::start("sensor-watch", stop, move || {
            let mut told = Told::default();
            while !theirs.load(Ordering::Relaxed) {
                let news = told.look(&sensors);
                shown.set(&news.notices);
                *found.lock() = told.troubles();
                if let Some(board) = &board {
                    board.post(news);
                }
                std::thread::sleep(LOOK);
            }
        })?;
        Ok(Self { troubles, notices, _worker: worker })
    }

    /// Present faults of the sensors.
    pub fn notices(&self) -> SensorNotices {
        self.notices.clone()
    }

    /// Faults of the inertial sensor and of the cameras at the last check.
    pub fn troubles(&self) -> [SensorTrouble; 2] {
        self.troubles.lock().clone()
    }
}

/// Faults reported so far.
#[derive(Default)]
struct Told {
    cameras: [Option<String>; 2],
    imu: Option<String>,
    bringing: Bringing,
    stamps: [Option<String>; 2],
    frame_looks: StampLooks,
}

impl Told {
    fn look(&mut self, sensors: &LiveSensors) -> SensorNews {
        let troubles = sensors.cameras.monitor.trouble();
        for ((told, now), name) in self.cameras.iter_mut().zip(troubles).zip(["left", "right"]) {
            let back = || format!("the {name} camera is available");
            tell(told, now, back);
        }
        let figures = sensors.imu.monitor.read();
        let trouble = imu_trouble(&figures, &mut self.bringing, Instant::now());
        let name = &sensors.imu.name;
        let words = trouble.map(|words| format!("{name}: {words} (driver.imu)"));
        tell(&mut self.imu, words, || format!("{name}: the IMU is available"));
        let (frames, problem) = sensors.cameras.monitor.stamps();
        let is_bad = self.frame_looks.are_bad(frames);
        let problem = problem.filter(|_| is_bad);
        let camera = &sensors.cameras.name;
        let words = problem.map(|problem| frame_stamps(camera, &problem));
        tell(&mut self.stamps[0], words, || format!("{camera}: stamps of the frames are good again"));
        let samples = figures.stamps();
        let words = figures.stamp_problem.map(|problem| sample_stamps(name, &problem, &sensors.sample_clock));
        tell(&mut self.stamps[1], words, || format!("{name}: stamps of the samples are good again"));
        SensorNews { notices: self.notices(), frames, samples }
    }

    /// Faults of the inertial sensor and of the cameras.
    fn troubles(&self) -> [SensorTrouble; 2] {
        let [frames, samples] = self.stamps.clone();
        let [left, right] = &self.cameras;
        [
            SensorTrouble { missing: self.imu.clone(), stamps: samples },
            SensorTrouble { missing: left.clone().or_else(|| right.clone()), stamps: frames },
        ]
    }

    /// Present faults.
    fn notices(&self) -> Vec<String> {
        let all = self.cameras.iter().chain([&self.imu]).chain(&self.stamps);
        all.flatten().cloned().collect()
    }
}

/// Message about the stamps of frames.
fn frame_stamps(camera: &str, problem: &StampProblem) -> String {
    let done = match problem.defect {
        StampDefect::Repeated => "dropped",
        _ => "stamped by their arrival",
    };
    format!(
        "{camera}: {}: such frames are {done}; send time.monotonic_ns() or clock_gettime(CLOCK_MONOTONIC) of the \
         exposure (docs/own-sensors.md)",
        problem.words(FRAME_CLOCK)
    )
}

/// Message about the stamps of samples.
fn sample_stamps(imu: &str, problem: &StampProblem, expected: &str) -> String {
    format!(
        "{imu}: {}: such samples are dropped; send the sensor's own time, which increases with every sample, in that \
         unit (docs/own-sensors.md) (driver.imu)",
        problem.words(expected)
    )
}

/// Stamps of the looks of the last second.
#[derive(Default)]
struct StampLooks {
    counts: [(u64, u64); STAMP_LOOKS],
    next: usize,
    is_bad: bool,
}

impl StampLooks {
    /// True if at least half of the stamps of the last second are of no use.
    fn are_bad(&mut self, figures: StampFigures) -> bool {
        let now = (figures.used, figures.bad());
        let before = std::mem::replace(&mut self.counts[self.next], now);
        self.next = (self.next + 1) % STAMP_LOOKS;
        let bad = now.1.saturating_sub(before.1);
        // Frames stamped by their arrival are handed out too.
        let good = (now.0.saturating_sub(before.0)).saturating_sub(bad);
        // While nothing comes the verdict stands.
        if bad > 0 || good > 0 {
            self.is_bad = bad > 0 && bad >= good;
        }
        self.is_bad
    }
}

/// Logs what has changed: trouble as a warning, its end as information. Another count alone is no change.
fn tell(told: &mut Option<String>, now: Option<String>, back: impl FnOnce() -> String) {
    match (&*told, &now) {
        (before, Some(words)) if is_news(before.as_deref(), words) => tracing::warn!("{words}"),
        (Some(_), None) => tracing::info!("{}", back()),
        _ => {}
    }
    *told = now;
}

fn is_news(before: Option<&str>, now: &str) -> bool {
    before.is_none_or(|before| !without_digits(before).eq(without_digits(now)))
}

fn without_digits(words: &str) -> impl Iterator<Item = char> {
    words.chars().filter(|c| !c.is_ascii_digit())
}

/// Progress of the samples: their counts, and the time since which nothing came.
#[derive(Default)]
struct Bringing {
    samples: u64,
    settling: u64,
    since: Option<Instant>,
    /// Counts of the looks of the last second: samples, those that make no sense, and those that repeat.
    looks: [[u64; 3]; STAMP_LOOKS],
    next: usize,
    /// Samples that made no sense, and that were out of order, when good ones came last.
    malformed: u64,
    disordered: u64,
}

impl Bringing {
    /// Samples of the last second, those of it that make no sense, and those that repeat.
    fn of_the_last_second(&mut self, figures: &ImuFigures) -> [u64; 3] {
        let now = [figures.samples, figures.malformed + figures.watch.impossible, figures.watch.stuck];
        let before = std::mem::replace(&mut self.looks[self.next], now);
        self.next = (self.next + 1) % STAMP_LOOKS;
        std::array::from_fn(|k| now[k].saturating_sub(before[k]))
    }
}

/// Warning of `malformed` samples without sensible values beside `samples` good ones.
fn unusable(malformed: u64, samples: u64) -> String {
    format!(
        "{malformed} of {} samples of the IMU in a second are unusable (NaN, infinite or beyond its range) and were dropped; \
         check the sensor, its supply and its driver",
        malformed + samples
    )
}

/// Samples whose times did not increase: in the data, or by the sensor's own clock.
fn out_of_order(figures: &ImuFigures) -> u64 {
    figures.disordered + figures.clock.refused
}

/// Reason why the inertial sensor brings nothing, if it does not.
fn imu_trouble(figures: &ImuFigures, bringing: &mut Bringing, now: Instant) -> Option<String> {
    let since = *bringing.since.get_or_insert(now);
    let is_moving = (figures.samples, figures.settling) != (bringing.samples, bringing.settling);
    // The driver's first word may take a moment.
    let is_unknown = figures.link == LinkFigures::default();
    if is_unknown && now - since < LOOK * 5 {
        return None;
    }
    let [samples, malformed, stuck] = bringing.of_the_last_second(figures);
    if is_moving || !(figures.link.is_open || is_unknown) {
        (bringing.samples, bringing.settling, bringing.since) =
            (figures.samples, figures.settling, Some(now));
        (bringing.malformed, bringing.disordered) =
            (figures.malformed + figures.watch.impossible, out_of_order(figures));
    }
    if !figures.link.is_open {
        let why = figures.link.last_error.map(std::io::Error::from_raw_os_error);
        let why = why.map_or_else(String::new, |error| format!(" ({error})"));
        return Some(format!("the IMU is missing{why}; waiting for it"));
    }
    let is_unusable = malformed > 0 && malformed as f64 > MAX_UNUSABLE * (samples + malformed) as f64;
    let patience = if figures.samples > 0 { SILENCE } else { PATIENCE };
    if is_moving || now - since < patience {
        // Until it has brought something it counts as missing.
        let is_stuck = stuck as f64 > MIN_STUCK * samples as f64;
        return match (is_unusable, is_stuck) {
            (true, _) => Some(unusable(malformed, samples)),
            (false, true) => {
                Some("the IMU repeats the same values; check the sensor and the program that reads it".into())
            }
            (false, false) => None,
        };
    }
    if figures.malformed + figures.watch.impossible > bringing.malformed {
        return Some(
            "the IMU sends samples that are all unusable (NaN, infinite or beyond its range); check the sensor, its supply \
             and its driver"
                .into(),
        );
    }
    if out_of_order(figures) > bringing.disordered {
        return Some(
            "the IMU sends samples whose times do not increase: it repeats itself, or its clock stands still; check the \
             sensor and the program that sends them"
                .into(),
        );
    }
    let framing = &figures.framing;
    Some(match figures.lacking {
        Some(lacking) => format!("the data of the IMU contain no samples: {lacking}"),
        None if framing.bytes == 0 => "the IMU sends nothing; check its wires and its output settings".to_owned(),
        None if framing.frames == 0 => {
            "the data of the IMU contain no frame of driver.imu.protocol; check the protocol and the baud rate"
                .to_owned()
        }
        None => "the IMU has stopped sending samples".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_drivers::clock::TimeUnitName;
    use plumbline_drivers::inertial::FramingFigures;

    #[test]
    fn another_count_of_the_same_trouble_is_no_news() {
        let count = |n: u64| format!("imu: {}", unusable(n, 200 - n));
        assert!(is_news(None, &count(22)) && !is_news(Some(&count(22)), &count(143)));
        assert!(is_news(Some(&count(22)), "imu: the IMU has stopped sending samples"));
    }

    #[test]
    fn a_sensor_that_is_away_or_says_nothing_is_told_of_with_the_cure() {
        let (mut bringing, start) = (Bringing::default(), Instant::now());
        let mut trouble = |figures: ImuFigures, s: f64| {
            imu_trouble(&figures, &mut bringing, start + Duration::from_secs_f64(s))
        };
        let away = ImuFigures {
            link: LinkFigures { last_error: Some(2), ..LinkFigures::default() },
            ..ImuFigures::default()
        };
        let there = |samples, bytes, frames| ImuFigures {
            samples,
            link: LinkFigures { is_open: true, ..LinkFigures::default() },
            framing: FramingFigures { bytes, frames, ..FramingFigures::default() },
            ..ImuFigures::default()
        };
        assert_eq!(trouble(ImuFigures::default(), 0.0), None);
        assert!(trouble(away, 0.0).is_some_and(|words| words.contains("No such file")));
        assert_eq!(trouble(there(0, 0, 0), 1.0), None);
        assert!(trouble(there(0, 0, 0), 4.0).is_some_and(|words| words.contains("wires")));
        assert!(trouble(there(0, 99, 0), 4.1).is_some_and(|words| words.contains("driver.imu.protocol")));
        assert_eq!(trouble(there(1, 200, 5), 4.2), None);
        assert_eq!(trouble(there(1, 200, 5), 4.6), None);
        assert!(trouble(there(1, 200, 5), 4.8).is_some_and(|words| words.contains("stopped")));
    }

    /// Looks ten times a second at a sensor of 200 Hz; what is told of it after so many looks of a fault.
    fn told_after(looks: u32, mut fault: impl FnMut(&mut ImuFigures)) -> Option<String> {
        let (mut bringing, start) = (Bringing::default(), Instant::now());
        let mut figures = ImuFigures {
            link: LinkFigures { is_open: true, ..LinkFigures::default() },
            ..ImuFigures::default()
        };
        figures.framing = FramingFigures { bytes: 9, frames: 9, ..FramingFigures::default() };
        let mut told = None;
        for look in 0..30 + looks {
            match look < 30 {
                true => figures.samples += 20,
                false => fault(&mut figures),
            }
            told = imu_trouble(&figures, &mut bringing, start + LOOK * look);
            assert!(look >= 30 || told.is_none(), "a sound sensor is no trouble");
        }
        told
    }

    #[test]
    fn a_sensor_that_dies_repeats_or_sends_nonsense_is_told_within_a_second() {
        for (fault, words) in [
            ((|_| ()) as fn(&mut ImuFigures), "stopped sending samples"),
            (|figures| figures.malformed += 20, "all unusable (NaN"),
            (|figures| figures.watch.impossible += 20, "all unusable (NaN"),
            (|figures| figures.disordered += 20, "do not increase"),
            (|figures| figures.clock.refused += 20, "do not increase"),
            (
                |figures| {
                    figures.samples += 20;
                    figures.watch.stuck += 20;
                },
                "repeats the same values",
            ),
            (
                |figures| {
                    figures.samples += 10;
                    figures.malformed += 10;
                },
                "samples of the IMU in a second are unusable",
            ),
        ] {
            let told = told_after(7, fault).unwrap_or_default();
            assert!(told.contains(words), "{words}: {told}");
        }
    }

    #[test]
    fn a_few_samples_that_make_no_sense_are_no_trouble() {
        let few = |figures: &mut ImuFigures| {
            figures.samples += 19;
            figures.malformed += 1;
        };
        assert_eq!(told_after(20, few), None);
    }

    #[test]
    fn bad_stamps_of_frames_are_told_while_they_come_and_not_for_one_frame() {
        let mut looks = StampLooks::default();
        let found = StampProblem { defect: StampDefect::Zero, stamp: 0, now_ns: 7 };
        let figures = |used, restamped| StampFigures { used, restamped, refused: 0 };
        // Two frames a look.
        let good: Vec<_> = (1..30).map(|k| looks.are_bad(figures(2 * k, 1))).collect();
        assert!(!good[10..].contains(&true), "{good:?}");
        assert!((1..=10).any(|k| looks.are_bad(figures(60 + 2 * k, 1 + 2 * k))));
        assert!(!(1..=10).map(|k| looks.are_bad(figures(80 + 2 * k, 21))).last().unwrap());
        let words = frame_stamps("/run/frames", &found);
        assert!(words.contains("stamps are 0") && words.contains("CLOCK_MONOTONIC"), "{words}");
    }

    #[test]
    fn stamps_of_samples_are_named_with_the_unit_that_is_expected() {
        let found =
            StampProblem { defect: StampDefect::Unit(TimeUnitName::Millis), stamp: 15_321_136, now_ns: 7 };
        let words =
            sample_stamps("serial:///dev/imu:921600", &found, "the time of measurement in nanoseconds");
        let expected = "stamps such as 15321136 are in milliseconds, where the time of measurement in nanoseconds is expected";
        assert!(words.contains(expected) && words.contains("such samples are dropped"), "{words}");
    }

    #[test]
    fn troubles_are_those_of_the_sensor_that_has_them() {
        let told = Told {
            cameras: [None, Some("right is away".into())],
            stamps: [None, Some("samples in us".into())],
            ..Told::default()
        };
        let [imu, cameras] = told.troubles();
        assert_eq!((imu.missing, imu.stamps.as_deref()), (None, Some("samples in us")));
        assert_eq!((cameras.missing.as_deref(), cameras.stamps), (Some("right is away"), None));
    }

    #[test]
    fn what_is_missing_is_told_once() {
        let mut told = None;
        for now in [Some("gone"), Some("gone"), None, None] {
            tell(&mut told, now.map(str::to_owned), || "back".to_owned());
            assert_eq!(told.as_deref(), now);
        }
    }
}
