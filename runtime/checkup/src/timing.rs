//! Rates, jitter and gaps, by the stamps and by the numbers of samples.

use crate::finding::Finding;
use crate::statistics::{median, quantile};
use crate::verdict::{Fitness, Measure};
use plumbline_config::Timestamp;

/// Fewest stamps that are judged.
const MIN_STAMPS: usize = 20;
/// An interval longer than so many usual ones is a gap.
const GAP: f64 = 1.5;
/// Deviation of the rate from the configured one, relative.
const RATE: (f64, f64) = (0.02, 0.1);
/// Share of samples that are missing.
const LOST: (f64, f64) = (0.001, 0.02);
/// Jitter against the interval, 99th percentile; estimators stamp by it, but drivers that jitter so mostly stamp by arrival.
const JITTER: (f64, f64) = (0.3, f64::INFINITY);
/// Jitter against the interval from which a flight is warned of it.
const WILD: f64 = 0.8;
/// Samples come in bursts where this share of the intervals is shorter than this share of the mean one.
const BUNCHED: (f64, f64) = (0.3, 0.25);
/// Stamps scatter where this share of the intervals is shorter than half of the mean one: long ones are then no gaps.
const SCATTERED: (f64, f64) = (0.05, 0.5);
/// Rates by the median and by the mean interval differ by this much where stamps are irregular, relative.
const IRREGULAR: f64 = 0.05;
/// Share of samples that run backwards or repeat a stamp.
const DISORDERED: f64 = 0.002;
/// Streams this far apart have no time in common, s.
const APART_S: f64 = 1.0;
/// Share of frames that lack an image.
const HALF_FRAMES: (f64, f64) = (0.005, 0.1);

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
}

impl Arrivals {
    /// Samples whose numbers do not matter, by their stamps.
    pub fn of(stamps: Vec<Timestamp>) -> Self {
        Self { stamps, ..Self::default() }
    }

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

/// Troubles of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    Rate,
    Loss,
    Disorder,
    Bursts,
    Jitter,
}

/// Figures of a stream, and the worst thing about it.
struct Stream {
    value: String,
    figures: Vec<(&'static str, f64)>,
    worst: Option<(Fitness, Trouble, Finding)>,
    /// Jitter against the interval, 99th percentile.
    jitter: f64,
}

/// Judges the stream of a sensor that is to deliver `nominal_hz` times a second.
pub fn judge(sensor: Sensor, arrivals: &Arrivals, nominal_hz: f64) -> Measure {
    let (name, device) = sensor.names();
    if arrivals.stamps.len() < MIN_STAMPS {
        let value = format!("{} samples arrived", arrivals.stamps.len());
        let cure = format!("check that `plumbline devices` lists {device}, and that data arrive");
        return Measure::new(
            name,
            Fitness::NotFit,
            value,
            cure,
            &[("samples", arrivals.stamps.len() as f64)],
        );
    }
    let stream = Stream::of(sensor, arrivals, nominal_hz);
    let (verdict, cure) = match stream.worst {
        Some((verdict, _, finding)) => (verdict, format!("{}: {}", finding.what, finding.advice())),
        None => (Fitness::Good, String::new()),
    };
    Measure::new(name, verdict, stream.value, cure, &stream.figures)
}

/// Finding about the stamps of a stream while a flight goes on: another rate or unit, a wrong order, bursts
/// or a wild jitter. Losses are reported elsewhere.
pub fn finding(sensor: Sensor, arrivals: &Arrivals, nominal_hz: f64) -> Option<Finding> {
    if arrivals.stamps.len() < MIN_STAMPS {
        return None;
    }
    let stream = Stream::of(sensor, arrivals, nominal_hz);
    let (verdict, trouble, finding) = stream.worst?;
    match trouble {
        Trouble::Rate | Trouble::Disorder | Trouble::Bursts => {
            (verdict == Fitness::NotFit).then_some(finding)
        }
        Trouble::Jitter => (stream.jitter > WILD).then(|| finding.mild()),
        Trouble::Loss => None,
    }
}

impl Sensor {
    /// Name of its measure, and of the device.
    fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::Imu => ("IMU timing", "the IMU"),
            Self::Cameras => ("camera timing", "the cameras"),
        }
    }
}

impl Stream {
    fn of(sensor: Sensor, arrivals: &Arrivals, nominal_hz: f64) -> Self {
        let intervals: Vec<f64> =
            arrivals.stamps.windows(2).map(|pair| pair[1].seconds_since(pair[0])).collect();
        let backwards = intervals.iter().filter(|dt| **dt <= 0.0).count();
        let disordered = backwards as u64 + arrivals.disordered;
        let (middle, mean) = (median(&intervals), mean_interval(&arrivals.stamps));
        let close = intervals.iter().filter(|dt| **dt < BUNCHED.1 * mean).count();
        let has_bursts = backwards == 0 && close as f64 > BUNCHED.0 * intervals.len() as f64;
        // Where stamps scatter, the median interval is not the usual one.
        let off = |interval: f64| (1.0 / (interval * nominal_hz) - 1.0).abs();
        let short = intervals.iter().filter(|dt| **dt < SCATTERED.1 * mean).count();
        let is_scattered = short as f64 > SCATTERED.0 * intervals.len() as f64;
        let is_irregular =
            is_scattered || (mean / middle - 1.0).abs() > IRREGULAR && off(mean) < 0.5 * off(middle);
        let is_even = !has_bursts && !is_irregular;
        let usual = if is_even { middle } else { mean };
        let rate = 1.0 / usual;
        let gaps = intervals.iter().filter(|dt| is_even && **dt > GAP * usual);
        let lost_by_time: f64 = gaps.map(|dt| (dt / usual).round() - 1.0).sum();
        let refused = arrivals.refused as f64;
        let lost = (lost_by_time.max(arrivals.lost_by_number as f64) - refused).max(0.0);
        let share = lost / (lost + arrivals.stamps.len() as f64);
        let regular: Vec<f64> =
            intervals.iter().filter(|dt| **dt <= GAP * usual).map(|dt| (dt - usual).abs()).collect();
        let jitter = quantile(&regular, 0.99);
        let longest = quantile(&intervals, 1.0);
        let refused = if refused > 0.0 { format!(", {refused:.0} refused") } else { String::new() };
        let value = format!(
            "{rate:.1} Hz, 99 % within {:.2} ms, longest interval {:.0} ms, {lost:.0} of {} missing{refused}",
            1e3 * jitter,
            1e3 * longest,
            lost + (arrivals.stamps.len() as u64 + arrivals.refused) as f64
        );
        let disorder = if backwards > 0 {
            Fitness::NotFit
        } else {
            Fitness::within(disordered as f64 / arrivals.stamps.len() as f64, 0.0, DISORDERED)
        };
        let bursts = if has_bursts { Fitness::NotFit } else { Fitness::Good };
        let value = match disordered {
            0 => value,
            n => format!("{value}, {n} out of order or of the same stamp"),
        };
        let verdicts = [
            (bursts, Trouble::Bursts),
            (Fitness::within(off(usual), RATE.0, RATE.1), Trouble::Rate),
            (Fitness::within(share, LOST.0, LOST.1), Trouble::Loss),
            (disorder, Trouble::Disorder),
            (Fitness::within(jitter / usual, JITTER.0, JITTER.1), Trouble::Jitter),
        ];
        let worst = verdicts.into_iter().rev().max_by_key(|(verdict, _)| *verdict);
        let worst = worst.filter(|(verdict, _)| *verdict > Fitness::Good);
        let worst = worst.map(|(verdict, trouble)| {
            (verdict, trouble, trouble.finding(sensor, &value, (rate, nominal_hz)))
        });
        let figures = vec![
            ("rate_hz", rate),
            ("jitter_p99_ms", 1e3 * jitter),
            ("longest_interval_ms", 1e3 * longest),
            ("missing", lost),
            ("disordered", disordered as f64),
        ];
        Self { value, figures, worst, jitter: jitter / usual }
    }
}

impl Trouble {
    fn finding(self, sensor: Sensor, value: &str, (rate_hz, nominal_hz): (f64, f64)) -> Finding {
        let (_, device) = sensor.names();
        let key = match sensor {
            Sensor::Imu => "imu.rate_hz",
            Sensor::Cameras => "camera.0.rate_hz",
        };
        let factor = rate_hz / nominal_hz;
        let is_near = |too_fast: f64| factor > too_fast / UNIT_FACTOR && factor < too_fast * UNIT_FACTOR;
        let unit = UNITS.iter().find(|(_, too_fast)| is_near(*too_fast));
        let (what, cause, cure) = match (self, unit) {
            (Self::Rate, Some((unit, _))) => (
                format!("stamps of {device} are not in nanoseconds"),
                format!("that they are in {unit}"),
                "write them in nanoseconds".to_owned(),
            ),
            (Self::Rate, None) => (
                format!("another rate of {device} than the configured one"),
                format!(
                    "that the sensor is set to another rate than {nominal_hz} Hz, or that its clock runs {:.3} times as fast as it should",
                    1.0 / factor
                ),
                format!("set `{key}` to the rate that is delivered, or the sensor to {nominal_hz} Hz"),
            ),
            (Self::Loss, _) => (
                format!("samples of {device} are missing"),
                "a cable, load or bandwidth".to_owned(),
                format!("look at {device} and the driver: one of them may lose samples"),
            ),
            (Self::Disorder, _) => (
                format!("stamps of {device} run backwards"),
                "a clock that was set while it recorded (NTP), or stamps of several clocks".to_owned(),
                "stamp by one clock that is never set, such as CLOCK_MONOTONIC; two stretches of this recording are mixed into each other"
                    .to_owned(),
            ),
            (Self::Bursts, _) => (
                format!("samples of {device} {BURSTS}"),
                "that several arrive together and are stamped on arrival".to_owned(),
                "stamp each sample when it is measured: the sensor's own time, or its counter with the rate".to_owned(),
            ),
            (Self::Jitter, _) => (
                format!("stamps of {device} {JITTER_WORD}"),
                "stamps of the arrival, not of the measurement".to_owned(),
                "use the sensor's own time or a trigger".to_owned(),
            ),
        };
        Finding::new(what, value, cause, cure)
    }
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

/// Judges how many frames have both images.
pub fn judge_pairs(whole: u64, frames: usize) -> Measure {
    let half = frames as f64 - whole as f64;
    let share = half / (frames as f64).max(1.0);
    Measure::new(
        "stereo pairs",
        Fitness::within(share, HALF_FRAMES.0, HALF_FRAMES.1),
        format!("{whole} of {frames} frames have both images"),
        "trigger both cameras together, or see which images are missing (of a recording: cam0/data.csv and cam1/data.csv)",
        &[("frames", frames as f64), ("without_partner", half)],
    )
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
        Arrivals::of(kept.map(|(_, stamp)| stamp).collect())
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
