//! Rates, jitter and gaps, by the stamps and by the numbers of samples.

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
/// Share of frames that lack an image.
const HALF_FRAMES: (f64, f64) = (0.005, 0.1);

/// Which sensor is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sensor {
    /// The inertial one.
    Imu,
    /// The cameras.
    Cameras,
}

/// When the samples of a sensor were measured, and their numbers.
#[derive(Clone, Debug, Default)]
pub struct Arrivals {
    /// Measurement times, as they came.
    pub stamps: Vec<Timestamp>,
    lost_by_number: u64,
    last: Option<u64>,
}

impl Arrivals {
    /// Takes a sample.
    pub fn push(&mut self, stamp: Timestamp, sequence: u64) {
        let last = self.last.replace(sequence);
        self.lost_by_number += last.map_or(0, |last| sequence.saturating_sub(last.saturating_add(1)));
        self.stamps.push(stamp);
    }
}

/// Judges the stream of a sensor that is to deliver `nominal_hz` times a second.
#[must_use]
pub fn judge(sensor: Sensor, arrivals: &Arrivals, nominal_hz: f64) -> Measure {
    let (name, key, device) = match sensor {
        Sensor::Imu => ("IMU timing", "imu.rate_hz", "the IMU"),
        Sensor::Cameras => ("camera timing", "camera.rate_hz", "the cameras"),
    };
    if arrivals.stamps.len() < MIN_STAMPS {
        let value = format!("{} samples came", arrivals.stamps.len());
        let cure = format!("see that {device} can be reached (`plumbline devices`) and deliver");
        return Measure::new(
            name,
            Fitness::NotFit,
            value,
            cure,
            &[("samples", arrivals.stamps.len() as f64)],
        );
    }
    let intervals: Vec<f64> = arrivals.stamps.windows(2).map(|pair| pair[1].seconds_since(pair[0])).collect();
    let disordered = intervals.iter().filter(|dt| **dt <= 0.0).count();
    let usual = median(&intervals);
    let rate = 1.0 / usual;
    let lost_by_time: f64 =
        intervals.iter().filter(|dt| **dt > GAP * usual).map(|dt| (dt / usual).round() - 1.0).sum();
    let lost = lost_by_time.max(arrivals.lost_by_number as f64);
    let share = lost / (lost + arrivals.stamps.len() as f64);
    let regular: Vec<f64> =
        intervals.iter().filter(|dt| **dt <= GAP * usual).map(|dt| (dt - usual).abs()).collect();
    let jitter = quantile(&regular, 0.99);
    let longest = quantile(&intervals, 1.0);
    let off = (rate / nominal_hz - 1.0).abs();
    let verdicts = [
        (
            Fitness::within(off, RATE.0, RATE.1),
            format!("set `{key}` to the rate that is delivered, or the sensor to {nominal_hz} Hz"),
        ),
        (
            Fitness::within(share, LOST.0, LOST.1),
            format!("look at cable, load and bandwidth: {device} lose samples, or the driver does"),
        ),
        (
            if disordered > 0 { Fitness::NotFit } else { Fitness::Good },
            "stamps run backwards: find out whose clock they are of".to_owned(),
        ),
        (
            Fitness::within(jitter / usual, JITTER.0, JITTER.1),
            "stamps are of the arrival, not of the measurement: use the sensor's own time or a trigger"
                .to_owned(),
        ),
    ];
    let worst = verdicts.into_iter().rev().max_by_key(|(verdict, _)| *verdict);
    let (verdict, cure) = worst.unwrap_or((Fitness::Good, String::new()));
    let value = format!(
        "{rate:.1} Hz, 99 % within {:.2} ms, longest interval {:.0} ms, {lost:.0} of {} missing",
        1e3 * jitter,
        1e3 * longest,
        lost + arrivals.stamps.len() as f64
    );
    let figures = [
        ("rate_hz", rate),
        ("jitter_p99_ms", 1e3 * jitter),
        ("longest_interval_ms", 1e3 * longest),
        ("missing", lost),
        ("disordered", disordered as f64),
    ];
    Measure::new(name, verdict, value, cure, &figures)
}

/// Judges how many frames have both images.
#[must_use]
pub fn judge_pairs(whole: u64, frames: usize) -> Measure {
    let half = frames as f64 - whole as f64;
    let share = half / (frames as f64).max(1.0);
    Measure::new(
        "stereo pairs",
        Fitness::within(share, HALF_FRAMES.0, HALF_FRAMES.1),
        format!("{whole} of {frames} frames have both images"),
        "trigger both cameras together, or see why one of them loses images",
        &[("frames", frames as f64), ("without_partner", half)],
    )
}
