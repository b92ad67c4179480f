//! Plausibility of a flight's input: units, columns, extrinsics, sides, focal lengths.
//!
//! An estimator takes nonsense for motion and goes on. What is looked at here are the data alone, in a bounded number
//! of samples and of shrunken images from the beginning of a flight: the magnitudes of the inertial samples
//! ([`inertial`]), how gravity turns in them ([`gravity`]), the rotation that the images show against that of the gyroscope ([`rotation`]), and on which side
//! of a pair near things are shifted ([`stereo`]). [`Plausibility`] is a pure function of what it is given; a run
//! feeds it while it goes on. Nothing of it reaches an estimate.

pub mod gravity;
pub mod inertial;
pub mod rotation;
pub mod stereo;

pub use crate::finding::{Finding, UNITS_AND_COLUMNS};

use crate::exposure::Brightness;
use crate::health::HealthTally;
use crate::mounting;
use crate::thumbnail::{RotationFinder, Thumbnail};
use crate::timing::{self, Arrivals, Sensor};
use crate::verdict::Fitness;
use gravity::GravityTurns;
use inertial::Magnitudes;
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::{CameraModel, Config, ImuSample, Timestamp};
use plumbline_estimator::HealthBits;
use rotation::{RotationAgreement, RotationPair};
use std::collections::VecDeque;
use stereo::Sides;

/// Rotations that are looked at: fifteen seconds at 20 Hz.
pub(crate) const MAX_PAIRS: usize = 300;
/// Images agree on a rotation from this correlation on.
const MIN_CORRELATION: f64 = 0.7;
/// Frames further apart than this are no neighbours, s.
const MAX_GAP_S: f64 = 0.3;
/// Rotations that wait for their inertial samples.
const MAX_WAITING: usize = 64;
/// Inertial samples that are kept for them.
const MAX_RATES: usize = 4096;
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
/// Frames whose brightness is judged.
const MIN_BRIGHT: usize = 40;

/// Bits of gaps, which stamps that cannot be right seem to have.
const GAPS: HealthBits = HealthBits(HealthBits::IMU_GAP.0 | HealthBits::FRAME_GAP.0);

/// Finding about a reset.
pub const GIVEN_UP: &str = "the estimate was discarded";

/// A frame, shrunken.
#[derive(Clone, Debug)]
pub struct Glimpse {
    /// Measurement time by the camera's clock.
    pub stamp: Timestamp,
    /// Left and right image.
    pub images: [Thumbnail; 2],
    /// Images that arrived.
    pub valid: [bool; 2],
}

impl Glimpse {
    /// Room for a frame of these image sizes.
    #[must_use]
    pub fn new(sizes_px: [(usize, usize); 2]) -> Self {
        Self { stamp: Timestamp::MIN, images: sizes_px.map(Thumbnail::new), valid: [false; 2] }
    }
}

/// A rotation that images showed, before the inertial samples of its time are there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    pub(crate) from: Timestamp,
    pub(crate) to: Timestamp,
    pub(crate) rate_c: Vector3<f64>,
}

impl Seen {
    /// Angle of the rotation, rad.
    pub(crate) fn angle(&self) -> f64 {
        self.rate_c.norm() * self.to.seconds_since(self.from)
    }
}

/// Rotations of one camera, from one of its images to the next.
pub(crate) struct TurnFinder {
    finder: RotationFinder,
    last: Option<Timestamp>,
}

impl TurnFinder {
    pub(crate) fn new(model: CameraModel) -> Self {
        Self { finder: RotationFinder::new(model), last: None }
    }

    /// Takes the image of a frame; returns how the camera turned since the one before, as far as images agree on it.
    pub(crate) fn next(&mut self, stamp: Timestamp, image: Option<&Thumbnail>) -> Option<Seen> {
        let Some(image) = image else {
            self.finder.forget();
            self.last = None;
            return None;
        };
        let last = self.last.replace(stamp);
        let (rot_last_now, correlation) = self.finder.next(image)?;
        let from = last?;
        let dt_s = stamp.seconds_since(from);
        let is_neighbour = correlation >= MIN_CORRELATION && dt_s > 0.0 && dt_s < MAX_GAP_S;
        is_neighbour.then(|| Seen { from, to: stamp, rate_c: rot_last_now.scaled_axis() / dt_s })
    }
}

/// Evidence of the images alone, frame by frame.
pub(crate) struct Sight {
    left: Option<TurnFinder>,
    sides: Option<Sides>,
    pub(crate) brightness: Brightness,
}

impl Sight {
    /// Sight of the cameras of a configuration.
    pub(crate) fn new(config: &Config) -> Self {
        let left = config.camera.first();
        Self {
            left: left.map(|camera| TurnFinder::new(camera.model())),
            sides: Sides::new(config),
            brightness: Brightness::default(),
        }
    }

    /// Takes a frame; returns how the left camera turned since the one before, as far as images agree on it.
    pub(crate) fn add(&mut self, frame: &Glimpse) -> Option<Seen> {
        for (camera, image) in frame.images.iter().enumerate().filter(|(camera, _)| frame.valid[*camera]) {
            self.brightness.add(camera, image);
        }
        if let (Some(sides), [true, true]) = (&mut self.sides, frame.valid) {
            sides.add(frame.stamp, &frame.images);
        }
        self.left.as_mut()?.next(frame.stamp, frame.valid[0].then_some(&frame.images[0]))
    }
}

/// Rotations of the images with the mean rate of the gyroscope at the same times.
pub(crate) fn agreement_of(config: &Config, seen: &[Seen], samples: &[ImuSample]) -> RotationAgreement {
    let mut agreement = RotationAgreement::of(config);
    for Seen { from, to, rate_c } in seen {
        let begin = samples.partition_point(|sample| sample.stamp <= *from);
        let end = samples.partition_point(|sample| sample.stamp <= *to).max(begin);
        let within = &samples[begin..end];
        if !within.is_empty() {
            let sum: Vector3<f64> = within.iter().map(|sample| sample.gyro).sum();
            agreement.add(RotationPair { rate_c: *rate_c, gyro_b: sum / within.len() as f64 });
        }
    }
    agreement
}

/// Units, columns, axes and sides that cannot be right, the most probable cause first: doctor, replay and a flight say the
/// same.
pub(crate) fn nonsense(
    magnitudes: &Magnitudes,
    (gravity, rot_v_b): (&GravityTurns, Option<UnitQuaternion<f64>>),
    agreement: &RotationAgreement,
    (sight, is_frozen): (&Sight, &dyn Fn(Timestamp) -> bool),
) -> Vec<Finding> {
    let mut findings = magnitudes.nonsense();
    if findings.is_empty() {
        findings.extend(agreement.finding());
    }
    if findings.is_empty() {
        findings.extend(gravity.finding(rot_v_b).or_else(|| gravity.upside_down(rot_v_b)));
    }
    if findings.is_empty() {
        findings.extend(sight.sides.as_ref().and_then(|sides| sides.finding(is_frozen)));
    }
    findings
}

/// Gathers what the data say, and judges it.
pub struct Plausibility {
    cameras: usize,
    rates_hz: [f64; 2],
    magnitudes: Magnitudes,
    gravity: GravityTurns,
    rot_v_b: Option<UnitQuaternion<f64>>,
    arrivals: [Arrivals; 2],
    sight: Sight,
    agreement: RotationAgreement,
    waiting: VecDeque<Seen>,
    rates: VecDeque<(Timestamp, Vector3<f64>)>,
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
            gravity: GravityTurns::default(),
            rot_v_b: config.vehicle.rot_v_b(),
            arrivals: Default::default(),
            sight: Sight::new(config),
            agreement: RotationAgreement::of(config),
            waiting: VecDeque::with_capacity(MAX_WAITING),
            rates: VecDeque::with_capacity(MAX_RATES),
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

    /// True if further frames would be of no use.
    #[must_use]
    pub fn has_seen_enough(&self) -> bool {
        self.agreement.len() >= MAX_PAIRS
    }

    /// Takes an inertial sample.
    pub fn add_sample(&mut self, sample: &ImuSample) {
        self.magnitudes.add(sample);
        self.gravity.add(sample);
        self.note(Sensor::Imu, sample.stamp);
        if self.first.len() < MAX_STAMPS {
            self.first.push(*sample);
        }
        if self.has_seen_enough() {
            return;
        }
        if self.rates.len() == MAX_RATES {
            self.rates.pop_front();
        }
        self.rates.push_back((sample.stamp, sample.gyro));
        self.pair_up();
    }

    /// Takes a frame.
    pub fn add_frame(&mut self, frame: &Glimpse) {
        if self.has_seen_enough() {
            return;
        }
        self.note(Sensor::Cameras, frame.stamp);
        let Some(seen) = self.sight.add(frame) else { return };
        if self.waiting.len() == MAX_WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back(seen);
        self.pair_up();
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

    /// Joins rotations of the images with the mean rate of the gyroscope at the same time.
    fn pair_up(&mut self) {
        let newest = self.rates.back().map_or(Timestamp::MIN, |(stamp, _)| *stamp);
        while self.waiting.front().is_some_and(|seen| seen.to <= newest) {
            let Some(Seen { from, to, rate_c }) = self.waiting.pop_front() else { break };
            while self.rates.front().is_some_and(|(stamp, _)| *stamp <= from) {
                self.rates.pop_front();
            }
            let within = self.rates.iter().take_while(|(stamp, _)| *stamp <= to);
            let (sum, count) =
                within.fold((Vector3::zeros(), 0.0), |(sum, n), (_, gyro)| (sum + gyro, n + 1.0));
            if count > 0.0 {
                self.agreement.add(RotationPair { rate_c, gyro_b: sum / count });
            }
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
            let sight = (&self.sight, &(|_| false) as &dyn Fn(Timestamp) -> bool);
            findings = nonsense(&self.magnitudes, (&self.gravity, self.rot_v_b), &self.agreement, sight);
        }
        if findings.is_empty() {
            findings.extend(mounting::finding(&self.first, &self.config));
        }
        findings.extend(self.magnitudes.repeats());
        let exposure = self.sight.brightness.judge();
        if self.sight.brightness.frames() >= MIN_BRIGHT && exposure.verdict == Fitness::NotFit {
            findings.push(Finding::of_measure(exposure));
        }
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

#[cfg(test)]
mod tests;
