//! Plausibility of a flight's input, while it goes on: units, columns, stamps, mounting, and the health bits.
//!
//! What is looked at are a bounded number of samples from the beginning ([`inertial`]) and the stamps. What images and samples say
//! of each other the estimator judges, in its health bits. [`Plausibility`] is a pure function of what it is given; nothing of it
//! reaches an estimate.

pub mod inertial;

pub use crate::finding::{Finding, UNITS_AND_COLUMNS};

use crate::health::HealthTally;
use crate::mounting;
use crate::timing::{self, Arrivals, Sensor};
use plumbline_config::{Config, ImuSample, Timestamp};
use plumbline_estimator::HealthBits;

/// Frames after which a camera that never delivered is missed.
const MISSED_AFTER: u64 = 40;
/// Resets whose reasons are told.
const MAX_RESETS: usize = 16;
/// Stamps that are looked at: twenty seconds at 200 Hz.
const MAX_STAMPS: usize = 4000;
/// Samples whose rate is judged: half a second.
const MIN_JUDGED: usize = 100;

/// Bits of gaps, which stamps that cannot be right seem to have.
const GAPS: HealthBits = HealthBits(HealthBits::IMU_GAP.0 | HealthBits::FRAME_GAP.0);

/// Finding about a reset.
pub const GIVEN_UP: &str = "the estimate was discarded";

/// Gathers what the data say, and judges it.
pub struct Plausibility {
    config: Config,
    /// The first samples, in which the vehicle may rest, and the first stamps of frames.
    samples: Vec<ImuSample>,
    frames: Vec<Timestamp>,
    health: HealthTally,
    is_live: bool,
    right_images: u64,
    resets: Vec<Finding>,
}

impl Plausibility {
    /// For flights of a configuration; in a live one frames must come in time.
    pub fn new(config: &Config, is_live: bool) -> Self {
        Self {
            config: config.clone(),
            samples: Vec::with_capacity(MAX_STAMPS),
            frames: Vec::with_capacity(MAX_STAMPS),
            health: HealthTally::default(),
            is_live,
            right_images: 0,
            resets: Vec::new(),
        }
    }

    /// Takes an inertial sample.
    pub fn add_sample(&mut self, sample: &ImuSample) {
        if self.samples.len() < MAX_STAMPS && sample.is_finite() {
            self.samples.push(*sample);
        }
    }

    /// Takes the stamp of a frame.
    pub fn add_frame(&mut self, stamp: Timestamp) {
        if self.frames.len() < MAX_STAMPS {
            self.frames.push(stamp);
        }
    }

    /// Takes the health bits of a frame.
    pub fn add_estimate(&mut self, health: HealthBits) {
        self.health.add(health);
        self.right_images +=
            u64::from(self.config.camera.len() > 1 && !health.contains(HealthBits::RIGHT_MISSING));
    }

    /// Takes the reason of a reset.
    pub fn add_reset(&mut self, reason: &str) {
        if self.resets.len() < MAX_RESETS {
            let reset = Finding::new(
                GIVEN_UP,
                reason,
                "a sensor or images that fail, or a motion that they do not support; soon after the start, wrong units or a wrong calibration",
                "look at the other warnings, and run `plumbline doctor` on the data",
            );
            self.resets.push(reset.mild());
        }
    }

    /// Stamps that cannot be right.
    fn stamp_findings(&self) -> Vec<Finding> {
        let stamps: Vec<Timestamp> = self.samples.iter().map(|sample| sample.stamp).collect();
        // In virtual time samples and frames are not handed out in step.
        let clocks = timing::two_clocks(&stamps, &self.frames).filter(|_| self.is_live);
        let [samples, frames] = [stamps, self.frames.clone()].map(Arrivals::of);
        let camera_hz = self.config.camera.first().map_or(0.0, |camera| camera.rate_hz);
        let of_samples = timing::finding(Sensor::Imu, &samples, self.config.imu.rate_hz);
        let of_samples = of_samples.filter(|_| self.samples.len() >= MIN_JUDGED);
        let of_frames = timing::finding(Sensor::Cameras, &frames, camera_hz);
        of_samples.into_iter().chain(of_frames).chain(clocks).collect()
    }

    /// Findings by all data so far, or about the whole flight at its end, the most probable cause first.
    pub fn findings(&self, is_over: bool) -> Vec<Finding> {
        let mut findings = self.stamp_findings();
        let mut known = if findings.is_empty() { HealthBits::default() } else { GAPS };
        if findings.is_empty() {
            findings = inertial::nonsense(&self.samples);
            // All that health bits and resets say then is a consequence.
            if !findings.is_empty() {
                return findings;
            }
            let at_rest = mounting::finding(&self.samples, &self.config);
            findings.extend(
                at_rest.or_else(|| inertial::upside_down(&self.samples, self.config.vehicle.rot_v_b())),
            );
        }
        findings.extend(inertial::repeats(&self.samples));
        let frames = self.health.frames;
        let is_missing = self.config.camera.len() > 1 && frames >= MISSED_AFTER && self.right_images == 0;
        if is_missing {
            let cure = if self.is_live { CONNECT } else { COPY };
            findings.push(missing_camera(&format!("none in {frames} frames"), cure));
            known.insert(HealthBits::RIGHT_MISSING);
        }
        findings.extend(self.health.findings(is_over, known));
        findings.extend(self.resets.iter().cloned());
        findings
    }
}

/// Cure for a missing live camera.
const CONNECT: &str = "connect it, or remove the second [[camera]] from the configuration";
/// Cure for a camera that a recording lacks.
pub const COPY: &str = "copy cam1 too, or remove the second [[camera]] from the configuration, as `plumbline replay --mono` does";

/// The right camera of the configuration delivers nothing.
pub fn missing_camera(evidence: &str, cure: &str) -> Finding {
    Finding::new(
        "the configuration has two cameras, but no image of cam1 arrives",
        evidence,
        "a camera that is not connected, or a data set without its folder cam1",
        cure,
    )
    .mild()
}
