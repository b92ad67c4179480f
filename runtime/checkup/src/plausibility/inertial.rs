//! The magnitudes of inertial samples: gravity is always there, and nobody turns at twenty radians a second for long.

use super::Finding;
use crate::statistics::quantile;
use nalgebra::Vector3;
use plumbline_config::{ImuSample, median};

/// Samples that are looked at: twenty seconds at 200 Hz.
const MAX_SAMPLES: usize = 4000;
/// Fewest samples that are judged.
const MIN_SAMPLES: usize = 100;
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
/// Median of the rotation rate beyond which nothing flies, rad/s.
const MAX_MEDIAN_RATE_RAD_S: f64 = 20.0;

/// Magnitudes of the first samples.
#[derive(Clone, Debug)]
pub struct Magnitudes {
    accel: Vec<f64>,
    gyro: Vec<f64>,
    /// Sum of the specific forces.
    force: Vector3<f64>,
}

impl Default for Magnitudes {
    fn default() -> Self {
        let room = || Vec::with_capacity(MAX_SAMPLES);
        Self { accel: room(), gyro: room(), force: Vector3::zeros() }
    }
}

impl Magnitudes {
    /// Takes a sample.
    pub fn add(&mut self, sample: &ImuSample) {
        if self.accel.len() < MAX_SAMPLES && sample.is_finite() {
            self.accel.push(sample.accel.norm());
            self.gyro.push(sample.gyro.norm());
            self.force += sample.accel;
        }
    }

    /// Columns and units that cannot be right.
    #[must_use]
    pub fn nonsense(&self) -> Vec<Finding> {
        let medians = [&self.accel, &self.gyro].map(|values| median(values.iter().copied()));
        let [Some(accel), Some(gyro)] = medians else { return Vec::new() };
        if self.accel.len() < MIN_SAMPLES {
            return Vec::new();
        }
        if SPECIFIC_FORCE_M_S2.contains(&gyro) && accel < 0.5 * SPECIFIC_FORCE_M_S2.start {
            return vec![Finding::new(
                "the gyroscope measures gravity and the accelerometer does not",
                format!("medians: gyroscope {gyro:.2}, accelerometer {accel:.3}"),
                "that the columns of gyroscope and accelerometer are swapped",
                "write the columns as gyroscope x y z [rad/s], accelerometer x y z [m/s^2]",
            )];
        }
        let mut findings = Vec::new();
        if !SPECIFIC_FORCE_M_S2.contains(&accel) {
            findings.push(not_gravity(accel, self.is_steady(accel)));
        }
        if gyro > MAX_MEDIAN_RATE_RAD_S {
            findings.push(super::rotation::in_degrees(&format!("median rate {gyro:.1}")));
        }
        findings
    }

    /// Whether the accelerometer, whose median magnitude is `accel`, measures a vector of nearly constant length and direction, as
    /// gravity is in any unit.
    fn is_steady(&self, accel: f64) -> bool {
        let sum: f64 = self.accel.iter().sum();
        self.force.norm() >= STEADY.0 * sum && quantile(&self.accel, 0.05) >= STEADY.1 * accel
    }
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
