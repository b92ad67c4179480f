//! The magnitudes of inertial samples: gravity is always there, and nobody turns at twenty radians a second for long.

use super::Finding;
use crate::statistics::quantile;
use nalgebra::Vector3;
use plumbline_config::{ImuSample, median};

/// Median of the specific force in any flight, m/s^2; gravity alone is 9.8.
const SPECIFIC_FORCE_M_S2: std::ops::Range<f64> = 6.5..15.0;
/// Median of the specific force in any flight, in units of gravity, and in thousandths of it.
const SPECIFIC_FORCE_G: std::ops::Range<f64> = 0.6..1.6;
const SPECIFIC_FORCE_MG: std::ops::Range<f64> = 600.0..1600.0;
/// Gravity in other units is steady: the mean as a vector against that of the magnitudes, and the least twentieth of the
/// magnitudes against their median.
const STEADY: (f64, f64) = (0.7, 0.6);
/// Median of an accelerometer that measures nothing at all, m/s^2.
const NOTHING_M_S2: f64 = 1e-6;
/// Share of zeros among the samples of a sensor that has no reading for some of them, longest mean length of their runs, and fewest runs.
const ALTERNATING: std::ops::Range<f64> = 0.05..0.97;
const MAX_RUN: usize = 8;
const MIN_RUNS: usize = 10;
/// Share of samples that repeat the one before.
const REPEATED: f64 = 0.1;
/// Median of the rotation rate beyond which nothing flies: a whole turn each second, rad/s.
const MAX_MEDIAN_RATE_RAD_S: f64 = std::f64::consts::TAU;

/// Samples of a mean, in which vibration averages out, half a second at 200 Hz; fewer are not judged.
const MEAN_OF: usize = 100;
/// Columns and units that cannot be right.
pub fn nonsense(samples: &[ImuSample]) -> Vec<Finding> {
    let sum = |samples: &[ImuSample]| samples.iter().map(|sample| sample.accel).sum::<Vector3<f64>>();
    let means = samples.chunks_exact(MEAN_OF).map(|chunk| sum(chunk).norm() / MEAN_OF as f64);
    let rates = samples.iter().map(|sample| sample.gyro.norm());
    let (Some(accel), Some(gyro)) = (median(means), median(rates)) else { return Vec::new() };
    let mut findings = Vec::new();
    if let Some(finding) = filled(samples) {
        findings.push(finding);
    } else if SPECIFIC_FORCE_M_S2.contains(&gyro) && accel < 0.5 * SPECIFIC_FORCE_M_S2.start {
        findings.push(Finding::new(
            "the gyroscope measures gravity and the accelerometer does not",
            format!("medians: gyroscope {gyro:.2}, accelerometer {accel:.3}"),
            "that the columns of gyroscope and accelerometer are swapped",
            "write the columns as gyroscope x y z [rad/s], accelerometer x y z [m/s^2]",
        ));
    } else {
        if !SPECIFIC_FORCE_M_S2.contains(&accel) {
            // Gravity in any unit has nearly constant length and direction.
            let forces: Vec<f64> = samples.iter().map(|sample| sample.accel.norm()).collect();
            let is_steady = sum(samples).norm() >= STEADY.0 * forces.iter().sum::<f64>()
                && quantile(&forces, 0.05) >= STEADY.1 * accel;
            findings.push(not_gravity(accel, is_steady));
        }
        if gyro > MAX_MEDIAN_RATE_RAD_S {
            findings.push(Finding::new(
                "the gyroscope turns faster than a vehicle can",
                format!("median rate {gyro:.1} rad/s"),
                "that it is in degrees a second",
                "multiply it by pi/180: rad/s is expected",
            ));
        }
    }
    findings.iter_mut().for_each(|finding| finding.explains_all = true);
    findings
}

/// Rows in which one of the two sensors is zero, and measures in others: zeros and measurements alternate.
fn filled(samples: &[ImuSample]) -> Option<Finding> {
    let told = |name: &str, value: fn(&ImuSample) -> Vector3<f64>| {
        let is_zero = |sample: &ImuSample| value(sample) == Vector3::zeros();
        let zeros = samples.iter().filter(|sample| is_zero(sample)).count();
        let runs = samples.windows(2).filter(|pair| is_zero(&pair[1]) && !is_zero(&pair[0])).count();
        let is_filled = ALTERNATING.contains(&(zeros as f64 / samples.len() as f64))
            && runs * MAX_RUN > zeros
            && runs > MIN_RUNS;
        is_filled.then(|| format!("the {name} is exactly zero in {zeros} of {} samples", samples.len()))
    };
    let told: Vec<String> =
        [told("gyroscope", |s| s.gyro), told("accelerometer", |s| s.accel)].into_iter().flatten().collect();
    (!told.is_empty()).then(|| {
        Finding::new(
            "samples without a measurement are filled with zeros",
            told.join(", "),
            "two sensors of different rates in one table or topic, with zeros where one of them has no reading",
            "record gyroscope and accelerometer on topics of their own, or interpolate one to the times of the other \
             (realsense-ros: unite_imu_method = 2)",
        )
    })
}

/// Samples that are bit for bit the one before, in runs that are too short for a sensor that is stuck.
pub fn repeats(samples: &[ImuSample]) -> Option<Finding> {
    let mut run = 0;
    let is_repeated = |pair: &&[ImuSample]| {
        run = if (pair[0].gyro, pair[0].accel) == (pair[1].gyro, pair[1].accel) { run + 1 } else { 0 };
        (1..=MAX_RUN).contains(&run)
    };
    let repeated = samples.windows(2).filter(is_repeated).count();
    let is_much = samples.len() >= MEAN_OF && repeated as f64 > REPEATED * samples.len() as f64;
    is_much.then(|| {
        Finding::new(
            "samples of the IMU repeat",
            format!("{repeated} of {} are bit for bit the one before", samples.len()),
            "a driver that hands out each reading twice, or at a rate above that of the sensor",
            "read the sensor at its own rate, and set `imu.rate_hz` to it",
        )
        .mild()
    })
}

fn not_gravity(accel: f64, is_steady: bool) -> Finding {
    let (cause, cure) = if accel < NOTHING_M_S2 {
        (
            "that its columns are empty: a driver that fills them with zeros",
            "record the accelerometer too, in the same rows as the gyroscope",
        )
    } else if accel < SPECIFIC_FORCE_M_S2.start && (!is_steady || accel < SPECIFIC_FORCE_G.start) {
        (
            "that gravity is not in the samples: linear acceleration, from which a filter has taken it out",
            "deliver the raw specific force with gravity in it, m/s^2",
        )
    } else if SPECIFIC_FORCE_G.contains(&accel) {
        ("that it is in units of gravity (g)", "multiply it by 9.80665: m/s^2 is expected")
    } else if SPECIFIC_FORCE_MG.contains(&accel) {
        ("that it is in thousandths of gravity (mg)", "multiply it by 0.00980665: m/s^2 is expected")
    } else {
        (
            "another unit, or columns that are not those of the accelerometer",
            "write it in m/s^2, gravity included",
        )
    };
    let evidence = format!("median magnitude {accel:.3}, gravity is 9.8 m/s^2");
    Finding::new("the accelerometer does not measure gravity", evidence, cause, cure)
}
