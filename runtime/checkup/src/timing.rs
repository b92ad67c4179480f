//! Rates, jitter and gaps, by the stamps and by the numbers of samples.

use crate::finding::Finding;
use crate::statistics::quantile;
use crate::verdict::{Fitness, Measure};
use plumbline_config::Timestamp;

/// Fewest stamps that are judged.
const MIN_STAMPS: usize = 20;
/// An interval longer than so many usual ones is a gap.
const GAP: f64 = 1.5;
/// Intervals vary, and none is a gap, where the middle half of them spreads by this share of the median.
const VARIES: f64 = 0.1;
/// Deviation of the rate from the configured one, relative.
const RATE: (f64, f64) = (0.02, 0.1);
/// Share of samples that are missing.
const LOST: (f64, f64) = (0.001, 0.02);
/// Jitter of inertial samples against the interval, 99th percentile, from which stamps are those of the arrival.
const JITTER: f64 = 0.8;
/// Samples come in bursts where this share of the intervals is shorter than this share of the mean one.
const BUNCHED: (f64, f64) = (0.3, 0.25);
/// Share of samples that run backwards or repeat a stamp.
const DISORDERED: f64 = 0.002;
/// Streams this far apart have no time in common, s.
const APART_S: f64 = 1.0;

/// Name of the measure of the inertial samples' stamps, and key of their rate.
pub(crate) const IMU_TIMING: &str = "IMU timing";
pub(crate) const IMU_RATE: &str = "imu.rate_hz";

/// Finding about samples that several arrive at once.
pub const BURSTS: &str = "come in bursts";

/// Word for stamps that scatter.
pub const JITTER_WORD: &str = "jitter";

/// Sensor that is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {
    /// The inertial one.
    Imu,
    /// The cameras.
    Cameras,
}

/// Stamps of a sensor's samples, and their numbers.
#[derive(Clone, Debug, Default)]
pub struct Arrivals {
    /// Measurement times, as they came.
    pub stamps: Vec<Timestamp>,
    lost_by_number: u64,
    last: Option<u64>,
    /// Samples that came and that the driver refused, as impossible or by their stamps: they are not missing.
    pub refused: u64,
    /// Samples out of order, or of a stamp that was there already, that the driver put right or refused.
    pub disordered: u64,
    /// Report of the driver of a live sensor: why it is missing, or what is wrong with its stamps.
    pub trouble: Option<String>,
}

impl Arrivals {
    /// Takes a sample.
    pub fn push(&mut self, stamp: Timestamp, sequence: u64) {
        let last = self.last.replace(sequence);
        self.lost_by_number += last.map_or(0, |last| sequence.saturating_sub(last.saturating_add(1)));
        self.stamps.push(stamp);
    }
}

/// Units that nanoseconds are mistaken for, and by how much a rate then is too high.
const UNITS: [(&str, f64); 3] = [("microseconds", 1e3), ("milliseconds", 1e6), ("seconds", 1e9)];
/// A rate within this factor of one in another unit is in that unit.
const UNIT_FACTOR: f64 = 3.0;

/// Figures of a stream, and the worst thing about it, with whether a flight warns of it.
struct Stream {
    value: String,
    figures: [(&'static str, f64); 5],
    worst: Option<(bool, Finding)>,
}

/// Judges the stream of a sensor that is to deliver `nominal_hz` times a second.
pub fn judge(sensor: Sensor, arrivals: &Arrivals, nominal_hz: f64) -> Measure {
    let (name, device, _) = sensor.names();
    let samples = arrivals.stamps.len();
    let mut measure = if samples < MIN_STAMPS {
        let cure = format!("check that `plumbline devices` lists {device}, and that data arrive");
        let value = format!("{samples} samples arrived");
        Measure::new(name, Fitness::NotFit, value, cure, &[("samples", samples as f64)])
    } else {
        let Stream { value, figures, worst } = Stream::of(sensor, arrivals, nominal_hz);
        let (verdict, cure) = worst.map_or((Fitness::Good, String::new()), |(_, finding)| {
            (finding.fitness, format!("{}: {}", finding.what, finding.advice()))
        });
        Measure::new(name, verdict, value, cure, &figures)
    };
    if let Some(words) = &arrivals.trouble {
        (measure.verdict, measure.cure) = (Fitness::NotFit, words.clone());
    }
    measure
}

/// Finding about the stamps of a stream while a flight goes on: another rate or unit, a wrong order, bursts
/// or a wild jitter. Losses are reported elsewhere.
pub fn finding(sensor: Sensor, arrivals: &Arrivals, nominal_hz: f64) -> Option<Finding> {
    let stream = (arrivals.stamps.len() >= MIN_STAMPS).then(|| Stream::of(sensor, arrivals, nominal_hz))?;
    stream.worst.filter(|(is_told, _)| *is_told).map(|(_, finding)| finding)
}

impl Sensor {
    /// Name of its measure, of the device, and of the key of its rate.
    fn names(self) -> (&'static str, &'static str, &'static str) {
        match self {
            Self::Imu => (IMU_TIMING, "the IMU", IMU_RATE),
            Self::Cameras => ("camera timing", "the cameras", "camera.0.rate_hz"),
        }
    }
}

impl Stream {
    fn of(sensor: Sensor, arrivals: &Arrivals, nominal_hz: f64) -> Self {
        let count = arrivals.stamps.len() as f64;
        let intervals: Vec<f64> =
            arrivals.stamps.windows(2).map(|pair| pair[1].seconds_since(pair[0])).collect();
        let backwards = intervals.iter().filter(|dt| **dt <= 0.0).count();
        let disordered = backwards as u64 + arrivals.disordered;
        let (middle, mean) = (quantile(&intervals, 0.5), mean_interval(&arrivals.stamps));
        let close = intervals.iter().filter(|dt| **dt < BUNCHED.1 * mean).count();
        let has_bursts = backwards == 0 && close as f64 > BUNCHED.0 * intervals.len() as f64;
        let spread = quantile(&intervals, 0.75) - quantile(&intervals, 0.25);
        let is_even = !has_bursts && spread < VARIES * middle;
        let usual = if is_even { middle } else { mean };
        let rate = 1.0 / usual;
        let gaps = intervals.iter().filter(|dt| is_even && **dt > GAP * usual);
        let lost_by_time: f64 = gaps.map(|dt| (dt / usual).round() - 1.0).sum();
        let refused = arrivals.refused as f64;
        let lost = (lost_by_time.max(arrivals.lost_by_number as f64) - refused).max(0.0);
        let regular: Vec<f64> =
            intervals.iter().filter(|dt| **dt <= GAP * usual).map(|dt| (dt - usual).abs()).collect();
        let (jitter, longest) = (quantile(&regular, 0.99), quantile(&intervals, 1.0));
        let mut value = format!(
            "{rate:.1} Hz, 99 % within {:.2} ms, longest interval {:.0} ms, {lost:.0} of {} missing",
            1e3 * jitter,
            1e3 * longest,
            lost + count + refused
        );
        if refused > 0.0 {
            value += &format!(", {refused:.0} refused");
        }
        if disordered > 0 {
            value += &format!(", {disordered} out of order or of the same stamp");
        }
        let (factor, is_imu) = (rate / nominal_hz, sensor == Sensor::Imu);
        let most = if is_imu || unit(factor).is_some() { RATE.1 } else { f64::INFINITY };
        let order = if backwards > 0 { f64::INFINITY } else { disordered as f64 / count };
        let verdicts = [
            Fitness::within(if is_imu { jitter / usual } else { 0.0 }, JITTER, f64::INFINITY),
            Fitness::within(order, 0.0, DISORDERED),
            Fitness::within(lost / (lost + count), LOST.0, LOST.1),
            Fitness::within((factor - 1.0).abs(), RATE.0, most),
            if has_bursts { Fitness::NotFit } else { Fitness::Good },
        ];
        // Losses are reported elsewhere, and what is mild but jitter.
        let is_told = |k: usize| k == 0 || k != 2 && verdicts[k] == Fitness::NotFit;
        let findings = words(sensor, factor, nominal_hz).into_iter().enumerate();
        let findings = findings.map(|(k, [what, cause, cure])| {
            let finding = Finding::new(what, value.clone(), cause, cure);
            (is_told(k), Finding { fitness: verdicts[k], ..finding })
        });
        // Of equals the last one explains the others.
        let worst = findings.max_by_key(|(_, finding)| finding.fitness);
        let figures = [
            ("rate_hz", rate),
            ("jitter_p99_ms", 1e3 * jitter),
            ("longest_interval_ms", 1e3 * longest),
            ("missing", lost),
            ("disordered", disordered as f64),
        ];
        Self { value, figures, worst: worst.filter(|(_, finding)| finding.fitness > Fitness::Good) }
    }
}

/// Unit that nanoseconds were mistaken for, where a rate is so many times the configured one.
fn unit(factor: f64) -> Option<&'static str> {
    let is_near = |too_fast: f64| factor > too_fast / UNIT_FACTOR && factor < too_fast * UNIT_FACTOR;
    UNITS.iter().find(|(_, too_fast)| is_near(*too_fast)).map(|(unit, _)| *unit)
}

/// What may be wrong with a stream whose rate is so many times the configured one, with cause and cure: jitter, order, loss, rate, bursts.
fn words(sensor: Sensor, factor: f64, nominal_hz: f64) -> [[String; 3]; 5] {
    let (_, device, key) = sensor.names();
    let of_rate = match unit(factor) {
        Some(unit) => [
            format!("stamps of {device} are not in nanoseconds"),
            format!("that they are in {unit}"),
            "write them in nanoseconds".into(),
        ],
        None => [
            format!("another rate of {device} than the configured one"),
            format!(
                "that the sensor is set to another rate than {nominal_hz} Hz, or that its clock runs {:.3} times as fast as it should",
                1.0 / factor
            ),
            format!("set `{key}` to the rate that is delivered, or the sensor to {nominal_hz} Hz"),
        ],
    };
    [
        [
            format!("stamps of {device} {JITTER_WORD}"),
            "stamps of the arrival, not of the measurement".into(),
            "use the sensor's own time or a trigger".into(),
        ],
        [
            format!("stamps of {device} run backwards"),
            "a clock that was set while it recorded (NTP), or stamps of several clocks".into(),
            "stamp by one clock that is never set, such as CLOCK_MONOTONIC; two stretches of this recording are mixed into each other".into(),
        ],
        [
            format!("samples of {device} are missing"),
            "a cable, load or bandwidth".into(),
            format!("look at {device} and the driver: one of them may lose samples"),
        ],
        of_rate,
        [
            format!("samples of {device} {BURSTS}"),
            "that several arrive together and are stamped on arrival".into(),
            "stamp each sample when it is measured: the sensor's own time, or its counter with the rate".into(),
        ],
    ]
}

/// Mean interval of stamps from the first to the last one, s.
fn mean_interval(stamps: &[Timestamp]) -> f64 {
    let ends = stamps.iter().min().zip(stamps.iter().max());
    ends.map_or(f64::NAN, |(first, last)| last.seconds_since(*first)) / (stamps.len().max(2) - 1) as f64
}

/// Finding: frames and samples are stamped by different clocks.
pub fn two_clocks(samples: &[Timestamp], frames: &[Timestamp]) -> Option<Finding> {
    let span = |stamps: &[Timestamp]| Some((*stamps.iter().min()?, *stamps.iter().max()?));
    let ((sample_a, sample_b), (frame_a, frame_b)) = (span(samples)?, span(frames)?);
    let are_enough = samples.len() >= MIN_STAMPS && frames.len() >= MIN_STAMPS;
    let is_apart = frame_a.seconds_since(sample_b) > APART_S || sample_a.seconds_since(frame_b) > APART_S;
    (are_enough && is_apart).then(|| {
        Finding::new(
            "frames and inertial samples are of different times",
            format!("frames from {frame_a} to {frame_b} s, samples from {sample_a} to {sample_b} s"),
            "stamps of two clocks",
            "stamp both by one clock",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stamps at 200 Hz, each off by up to so many ms, sorted; without every so manyth.
    fn scattered(by_ms: f64, without: usize) -> Arrivals {
        let mut state = 7_u64;
        let mut stamps: Vec<Timestamp> = (0..2_000_i64)
            .map(|k| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let share = (state >> 33) as f64 / f64::from(1_u32 << 31) * 2.0 - 1.0;
                Timestamp::from_nanos(1_000_000_000 + 5_000_000 * k + (share * by_ms * 1e6) as i64)
            })
            .collect();
        stamps.sort_unstable();
        let kept = stamps.into_iter().enumerate().filter(|(k, _)| k % without != without - 1);
        Arrivals { stamps: kept.map(|(_, stamp)| stamp).collect(), ..Arrivals::default() }
    }

    #[test]
    fn stamps_that_scatter_are_told_and_are_no_loss() {
        let finding = |by_ms, without| finding(Sensor::Imu, &scattered(by_ms, without), 200.0);
        for by_ms in [3.5, 4.0, 5.0] {
            let words = finding(by_ms, usize::MAX).expect("it is told").to_string();
            assert!(
                words.contains("stamps of the IMU jitter") && words.contains(" 0 of 2000 missing"),
                "{words}"
            );
        }
        assert_eq!(finding(0.5, usize::MAX), None);
        let lossy = judge(Sensor::Imu, &scattered(0.3, 10), 200.0);
        assert!(
            lossy.value.contains("199 of 1999 missing") || lossy.value.contains("200 of 2000 missing"),
            "{}",
            lossy.value
        );
    }
}
