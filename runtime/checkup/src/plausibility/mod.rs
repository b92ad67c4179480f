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
use inertial::Magnitudes;
use plumbline_config::{Config, ImuSample, Timestamp};
use plumbline_estimator::HealthBits;

/// Frames after which a camera that never delivered is missed.
const MISSED_AFTER: u64 = 40;
/// A live flight that loses more than one frame in so many is told.
const LOST_ONE_IN: u64 = 50;
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
    cameras: usize,
    rates_hz: [f64; 2],
    magnitudes: Magnitudes,
    arrivals: [Arrivals; 2],
    health: HealthTally,
    lost_frames: u64,
    last_sequence: Option<u64>,
    is_live: bool,
    right_images: u64,
    resets: Vec<Finding>,
    /// The first samples, in which the vehicle may rest.
    first: Vec<ImuSample>,
    config: Config,
}

impl Plausibility {
    /// For flights of a configuration; in a live one frames must come in time.
    #[must_use]
    pub fn new(config: &Config, is_live: bool) -> Self {
        Self {
            cameras: config.camera.len(),
            rates_hz: [config.imu.rate_hz, config.camera.first().map_or(0.0, |camera| camera.rate_hz)],
            magnitudes: Magnitudes::default(),
            arrivals: Default::default(),
            health: HealthTally::default(),
            lost_frames: 0,
            last_sequence: None,
            is_live,
            right_images: 0,
            resets: Vec::new(),
            first: Vec::with_capacity(MAX_STAMPS),
            config: config.clone(),
        }
    }

    /// Takes an inertial sample.
    pub fn add_sample(&mut self, sample: &ImuSample) {
        self.magnitudes.add(sample);
        self.note(Sensor::Imu, sample.stamp);
        if self.first.len() < MAX_STAMPS {
            self.first.push(*sample);
        }
    }

    /// Takes the stamp of a frame.
    pub fn add_frame(&mut self, stamp: Timestamp) {
        self.note(Sensor::Cameras, stamp);
    }

    fn note(&mut self, sensor: Sensor, stamp: Timestamp) {
        let arrivals = &mut self.arrivals[sensor as usize];
        if arrivals.stamps.len() < MAX_STAMPS {
            arrivals.push_stamp(stamp);
        }
    }

    /// Takes what an estimate says of the frame with this sequence number.
    pub fn add_estimate(&mut self, sequence: u64, health: HealthBits) {
        self.health.add(health);
        let last = self.last_sequence.replace(sequence);
        self.lost_frames += last.map_or(0, |last| sequence.saturating_sub(last.saturating_add(1)));
        self.right_images += u64::from(self.cameras > 1 && !health.contains(HealthBits::RIGHT_MISSING));
    }

    /// Takes the reason of a reset.
    pub fn add_reset(&mut self, reason: &str) {
        if self.resets.len() < MAX_RESETS {
            self.resets.push(Finding::new(
                GIVEN_UP,
                reason,
                "a sensor or images that fail, or a motion that they do not support; soon after the start, wrong units or a wrong calibration",
                "look at the other warnings, and run `plumbline doctor` on the data",
            ));
        }
    }

    /// Stamps that cannot be right.
    fn stamp_findings(&self) -> Vec<Finding> {
        let [samples, frames] = &self.arrivals;
        let [imu_hz, camera_hz] = self.rates_hz;
        let timing = [
            timing::finding(Sensor::Imu, samples, imu_hz).filter(|_| samples.stamps.len() >= MIN_JUDGED),
            timing::finding(Sensor::Cameras, frames, camera_hz),
        ];
        // In virtual time samples and frames are not handed out in step.
        let clocks = timing::two_clocks(&samples.stamps, &frames.stamps).filter(|_| self.is_live);
        timing.into_iter().flatten().chain(clocks).collect()
    }

    /// Findings by all data so far, the most probable cause first.
    #[must_use]
    pub fn findings(&self) -> Vec<Finding> {
        self.findings_of(false)
    }

    /// Findings about the whole flight, at its end.
    #[must_use]
    pub fn final_findings(&self) -> Vec<Finding> {
        self.findings_of(true)
    }

    fn findings_of(&self, is_over: bool) -> Vec<Finding> {
        let mut findings = self.stamp_findings();
        let are_stamps_wrong = !findings.is_empty();
        if findings.is_empty() {
            findings = self.magnitudes.nonsense();
        }
        if findings.is_empty() {
            let at_rest = mounting::finding(&self.first, &self.config);
            findings.extend(at_rest.or_else(|| self.magnitudes.upside_down(self.config.vehicle.rot_v_b())));
        }
        findings.extend(self.magnitudes.repeats());
        let is_right_missing =
            self.cameras > 1 && self.health.frames >= MISSED_AFTER && self.right_images == 0;
        // A camera that never delivers is named below.
        let mut known = HealthBits::default();
        if is_right_missing {
            known.insert(HealthBits::RIGHT_MISSING);
        }
        if are_stamps_wrong {
            known.insert(GAPS);
        }
        findings.extend(self.health.findings(is_over, known));
        if is_right_missing {
            findings.push(missing_camera(
                &format!("none in {} frames", self.health.frames),
                if self.is_live { CONNECT } else { COPY },
            ));
        }
        let all = self.health.frames + self.lost_frames;
        if self.is_live && self.health.frames >= MISSED_AFTER && self.lost_frames * LOST_ONE_IN > all {
            findings.push(Finding::new(
                "frames are lost",
                format!("{} of {all}", self.lost_frames),
                "a renderer, disk or processor that does not keep up with the camera",
                "take load off this computer, or give smaller images",
            ));
        }
        findings.extend(self.resets.iter().cloned());
        findings
    }
}

/// Cure for a missing live camera.
const CONNECT: &str = "connect it, or remove the second [[camera]] from the configuration";
/// Cure for a camera that a recording lacks.
pub const COPY: &str = "copy cam1 too, or remove the second [[camera]] from the configuration, as `plumbline replay --mono` does";

/// The right camera of the configuration delivers nothing.
#[must_use]
pub fn missing_camera(evidence: &str, cure: &str) -> Finding {
    Finding::new(
        "the configuration has two cameras, but no image of cam1 arrives",
        evidence,
        "a camera that is not connected, or a data set without its folder cam1",
        cure,
    )
    .mild()
}
