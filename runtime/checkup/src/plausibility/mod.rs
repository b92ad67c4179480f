//! Plausibility of a flight's input, while it goes on: units, columns, stamps, mounting, and the health bits.
//!
//! What is looked at are a bounded number of samples from the beginning ([`inertial`]) and the stamps. What images and samples say
//! of each other the estimator judges, in its health bits. [`Plausibility`] is a pure function of what it is given; nothing of it
//! reaches an estimate.

pub mod inertial;

pub use crate::finding::{Finding, UNITS_AND_COLUMNS};

use crate::FLIGHT;
use crate::health::{CONTRADICTED, HealthTally};
use crate::mounting;
use crate::timing::{self, Arrivals, Sensor};
use crate::verdict::{Fitness, Measure};
use plumbline_config::{Config, ImuSample, Timestamp};
use plumbline_estimator::HealthBits;

/// Resets whose reasons are told.
const MAX_RESETS: usize = 16;
/// Stamps that are looked at: twenty seconds at 200 Hz.
const MAX_STAMPS: usize = 4000;
/// Samples whose rate is judged: half a second.
const MIN_JUDGED: usize = 100;

/// Bits of gaps, which stamps that cannot be right seem to have.
pub(crate) const GAPS: HealthBits = HealthBits(HealthBits::IMU_GAP.0 | HealthBits::FRAME_GAP.0);

/// Cure of a contradiction that no calibration explains.
const APART: &str = "look at the mounts of cameras and IMU, and at what fills the view; to tell these apart, turn it by hand about all three \
                     axes and move it to and fro for ten seconds each, with texture in view";

/// Finding about a reset.
pub const GIVEN_UP: &str = "the estimate was discarded";

/// Gathers what the data say, and judges it.
pub struct Plausibility {
    config: Config,
    /// The first samples, in which the vehicle may rest, and arrivals of samples and frames.
    pub(crate) samples: Vec<ImuSample>,
    pub(crate) arrivals: [Arrivals; 2],
    room: usize,
    pub(crate) health: HealthTally,
    is_live: bool,
    resets: Vec<Finding>,
}

impl Plausibility {
    /// For flights of a configuration; in a live one frames must come in time.
    pub fn new(config: &Config, is_live: bool) -> Self {
        Self::with_room(config, is_live, MAX_STAMPS)
    }

    /// For so many samples, and as many frames.
    pub(crate) fn with_room(config: &Config, is_live: bool, room: usize) -> Self {
        Self {
            config: config.clone(),
            samples: Vec::with_capacity(MAX_STAMPS),
            arrivals: Default::default(),
            room,
            health: HealthTally::default(),
            is_live,
            resets: Vec::new(),
        }
    }

    /// Takes an inertial sample with its number in the sensor's stream.
    pub fn add_sample(&mut self, sequence: u64, sample: &ImuSample) {
        if self.samples.len() < self.room && sample.is_finite() {
            self.samples.push(*sample);
            self.arrivals[0].push(sample.stamp, sequence);
        }
    }

    /// Takes the number and the stamp of a frame.
    pub fn add_frame(&mut self, sequence: u64, stamp: Timestamp) {
        if self.arrivals[1].stamps.len() < self.room {
            self.arrivals[1].push(stamp, sequence);
        }
    }

    /// Takes the health bits of a frame.
    pub fn add_estimate(&mut self, health: HealthBits) {
        self.health.add(health);
    }

    /// Takes the reason of a reset, and its cure.
    pub fn add_reset(&mut self, reason: &str, cure: &str) {
        if self.resets.len() < MAX_RESETS {
            self.resets.push(Finding::new(GIVEN_UP, reason, "", cure).mild());
        }
    }

    /// Samples and frames of different times.
    pub(crate) fn two_clocks(&self) -> Option<Finding> {
        timing::two_clocks(&self.arrivals[0].stamps, &self.arrivals[1].stamps)
    }

    /// Rates that a configuration has, of samples and frames.
    pub(crate) fn nominal_hz(&self) -> [f64; 2] {
        [self.config.imu.rate_hz, self.config.camera.first().map_or(0.0, |camera| camera.rate_hz)]
    }

    /// Stamps that cannot be right.
    fn stamp_findings(&self) -> Vec<Finding> {
        // In virtual time samples and frames are not handed out in step.
        let clocks = self.two_clocks().filter(|_| self.is_live);
        let ([samples, frames], [imu_hz, camera_hz]) = (&self.arrivals, self.nominal_hz());
        let of_samples = timing::finding(Sensor::Imu, samples, imu_hz);
        let of_samples = of_samples.filter(|_| self.samples.len() >= MIN_JUDGED);
        let of_frames = timing::finding(Sensor::Cameras, frames, camera_hz);
        of_samples.into_iter().chain(of_frames).chain(clocks).collect()
    }

    /// Findings by all data so far, or about the whole flight at its end, the most probable cause first.
    pub fn findings(&self, is_over: bool) -> Vec<Finding> {
        let mut findings = self.stamp_findings();
        let known = if findings.is_empty() { HealthBits::default() } else { GAPS };
        if findings.is_empty() {
            findings = inertial::nonsense(&self.samples);
            // All that health bits and resets say then is a consequence.
            if !findings.is_empty() {
                return findings;
            }
            findings.extend(mounting::finding(&self.samples, &self.config));
        }
        findings.extend(self.of_flight(is_over, known));
        findings.extend(self.resets.iter().cloned());
        findings
    }

    /// Findings by the flight, beside these bits, which are explained elsewhere.
    pub(crate) fn of_flight(&self, is_over: bool, known: HealthBits) -> Vec<Finding> {
        let repeats = inertial::repeats(&self.samples).into_iter();
        repeats.chain(self.health.findings(is_over, known)).collect()
    }

    /// What the flight found to contradict each other, and why it was started anew.
    pub(crate) fn contradicted(&self) -> Vec<Measure> {
        let bits = self.health.findings(true, HealthBits(!CONTRADICTED.0));
        let measure = |finding: Finding| {
            let cure =
                if finding.cure.contains("plumbline doctor") { APART.to_owned() } else { finding.cure };
            let finding = Finding { cure, fitness: Fitness::NotFit, ..finding };
            finding.into_measure_of(FLIGHT)
        };
        self.resets.iter().cloned().chain(bits).map(measure).collect()
    }
}

/// The right camera of the configuration delivers nothing.
pub fn missing_camera(evidence: &str) -> Finding {
    Finding::new(
        "the configuration has two cameras, but no image of cam1 arrives",
        evidence,
        "a data set without its folder cam1",
        "copy cam1 too, or remove the second [[camera]] from the configuration, as `plumbline replay --mono` does",
    )
}
