//! The magnitudes of inertial samples: gravity is always there, and nobody turns at twenty radians a second for long.

use super::Finding;
use crate::mounting::UPSIDE_DOWN_CAUSE;
use crate::statistics::quantile;
use nalgebra::{UnitQuaternion, Vector3};
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
/// Share of zeros among the samples of a sensor that has no reading for some of them, longest mean length of their runs, and fewest runs.
const ALTERNATING: std::ops::Range<f64> = 0.05..0.97;
const MAX_RUN: u64 = 8;
const MIN_RUNS: u64 = 10;
/// Share of samples that repeat the one before.
const REPEATED: f64 = 0.1;
/// Median of the rotation rate beyond which nothing flies: a whole turn each second, rad/s.
const MAX_MEDIAN_RATE_RAD_S: f64 = std::f64::consts::TAU;

/// Samples of a mean, in which vibration averages out: half a second at 200 Hz.
const MEAN_OF: usize = 100;
/// Cosine of the angle between the mean force and the vehicle's vertical beyond which it is upside down, and samples that it takes.
const DOWN: (f64, usize) = (-0.8, 1000);

/// Finding about an accelerometer that does not measure gravity; cures where gravity is taken out, and where the unit is unknown.
pub const NOT_GRAVITY: &str = "the accelerometer does not measure gravity";
pub(crate) const WITH_GRAVITY: &str = "deliver the raw specific force with gravity in it, m/s^2";
pub(crate) const ANOTHER_UNIT: &str = "write it in m/s^2, gravity included";

/// Magnitudes of the first samples.
#[derive(Clone, Debug)]
pub struct Magnitudes {
    accel: Vec<f64>,
    gyro: Vec<f64>,
    /// Magnitudes of the means of the specific force, and the sum of the present one.
    means: Vec<f64>,
    mean: Vector3<f64>,
    /// Sum of the specific forces.
    force: Vector3<f64>,
    zeros: [Zeros; 2],
    last: Option<ImuSample>,
    /// Length of the present run of samples that repeat, and samples in short runs.
    run: u64,
    repeated: u64,
}

/// Samples of one sensor that are exactly zero, and the runs that they come in.
#[derive(Clone, Copy, Debug, Default)]
struct Zeros {
    samples: u64,
    runs: u64,
    is_within: bool,
}

impl Zeros {
    fn add(&mut self, is_zero: bool) {
        self.samples += u64::from(is_zero);
        self.runs += u64::from(is_zero && !self.is_within);
        self.is_within = is_zero;
    }

    /// True if zeros and measurements alternate among `all` samples.
    fn alternate(&self, all: u64) -> bool {
        let share = self.samples as f64 / all.max(1) as f64;
        (ALTERNATING.start..ALTERNATING.end).contains(&share)
            && self.runs * MAX_RUN > self.samples
            && self.runs > MIN_RUNS
    }
}

impl Default for Magnitudes {
    fn default() -> Self {
        let room = || Vec::with_capacity(MAX_SAMPLES);
        Self {
            accel: room(),
            gyro: room(),
            means: Vec::with_capacity(MAX_SAMPLES / MEAN_OF),
            mean: Vector3::zeros(),
            force: Vector3::zeros(),
            zeros: [Zeros::default(); 2],
            last: None,
            run: 0,
            repeated: 0,
        }
    }
}

impl Magnitudes {
    /// Takes a sample.
    pub fn add(&mut self, sample: &ImuSample) {
        if self.accel.len() < MAX_SAMPLES && sample.is_finite() {
            self.accel.push(sample.accel.norm());
            self.gyro.push(sample.gyro.norm());
            self.force += sample.accel;
            self.mean += sample.accel / MEAN_OF as f64;
            if self.accel.len().is_multiple_of(MEAN_OF) {
                self.means.push(std::mem::take(&mut self.mean).norm());
            }
            self.zeros[0].add(sample.gyro == Vector3::zeros());
            self.zeros[1].add(sample.accel == Vector3::zeros());
            let is_same =
                self.last.is_some_and(|last| last.gyro == sample.gyro && last.accel == sample.accel);
            self.run = if is_same { self.run + 1 } else { 0 };
            self.repeated += u64::from((1..=MAX_RUN).contains(&self.run));
            self.last = Some(*sample);
        }
    }

    /// Columns and units that cannot be right.
    #[must_use]
    pub fn nonsense(&self) -> Vec<Finding> {
        let medians = [&self.means, &self.gyro].map(|values| median(values.iter().copied()));
        let [Some(accel), Some(gyro)] = medians else { return Vec::new() };
        if self.accel.len() < MIN_SAMPLES {
            return Vec::new();
        }
        if let Some(finding) = self.filled() {
            return vec![finding];
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
            findings.push(Finding::new(
                "the gyroscope turns faster than a vehicle can",
                format!("median rate {gyro:.1} rad/s"),
                "that it is in degrees a second",
                "multiply it by pi/180: rad/s is expected",
            ));
        }
        findings
    }

    /// Gravity that points upwards in the vehicle for five seconds.
    pub(super) fn upside_down(&self, rot_v_b: Option<UnitQuaternion<f64>>) -> Option<Finding> {
        let up_v = (rot_v_b? * self.force).try_normalize(1e-6)?;
        (self.accel.len() >= DOWN.1 && up_v.z < DOWN.0).then(|| {
            Finding::new(
                "gravity points upwards in the vehicle",
                format!("mean force at {:.0} degrees from upwards", up_v.z.acos().to_degrees()),
                UPSIDE_DOWN_CAUSE,
                "correct `vehicle.imu_to_vehicle_deg`, or the signs of the accelerometer",
            )
        })
    }

    /// Rows in which one of the two sensors is zero, and measures in others.
    fn filled(&self) -> Option<Finding> {
        let all = self.accel.len() as u64;
        let told: Vec<String> = ["gyroscope", "accelerometer"]
            .iter()
            .zip(&self.zeros)
            .filter(|(_, zeros)| zeros.alternate(all))
            .map(|(name, zeros)| format!("the {name} is exactly zero in {} of {all} samples", zeros.samples))
            .collect();
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
    #[must_use]
    pub fn repeats(&self) -> Option<Finding> {
        let all = self.accel.len();
        let is_much = all >= MIN_SAMPLES && self.repeated as f64 > REPEATED * all as f64;
        is_much.then(|| {
            Finding::new(
                "samples of the IMU repeat",
                format!("{} of {all} are bit for bit the one before", self.repeated),
                "a driver that hands out each reading twice, or at a rate above that of the sensor",
                "read the sensor at its own rate, and set `imu.rate_hz` to it",
            )
            .mild()
        })
    }

    /// True if the accelerometer, whose median magnitude is `accel`, measures a vector of nearly constant
    /// length and direction, as gravity is in any unit.
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
            WITH_GRAVITY,
        )
    } else if SPECIFIC_FORCE_G.contains(&accel) {
        ("that it is in units of gravity (g)", "multiply it by 9.80665: m/s^2 is expected")
    } else if SPECIFIC_FORCE_MG.contains(&accel) {
        ("that it is in thousandths of gravity (mg)", "multiply it by 0.00980665: m/s^2 is expected")
    } else {
        ("another unit, or columns that are not those of the accelerometer", ANOTHER_UNIT)
    };
    let evidence = format!("median magnitude {accel:.3}, gravity is 9.8 m/s^2");
    Finding::new(NOT_GRAVITY, evidence, cause, cure)
}
