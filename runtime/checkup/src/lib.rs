//! Fitness of a rig's sensors for flight by their data: a pure function of samples, images and configuration.
//!
//! [`Checkup`] is given what a minute of data brings, in any order between the sensors, and [`Checkup::report`] says for each
//! thing that can be wrong what was measured, how bad that is, and what to do:
//!
//! | module | measures |
//! |---|---|
//! | [`timing`] | rates, jitter, gaps and order of the stamps of both sensors |
//! | [`plausibility`] | units and columns that cannot be right, and the health bits of the flight: while it goes on, too |
//! | `images` | images that are black, burnt out, frozen, interlaced, or hold marks or bars |
//! | [`mounting`] | how the IMU is mounted in the vehicle, at rest and by a nod |
//! | `fit` | everything that a calibration consists of, by one fit of images and samples (points by `tracks`) |
//! | [`camera_imu`] | pose of the cameras on the IMU and time offset, to be written into a configuration |
//! | [`health`] | the health bits of a flight: a line at its end, and warnings |
//!
//! What stamps, units, images or sensors that fail show to be wrong is named first, and nothing is fitted through it. What the estimator
//! found to contradict each other as it flew is a consequence, and reported only where nothing else is wrong. A quantity that the data do
//! not hold is reported as not measured. There is no clock and no random number here: the same data give the same report.

pub mod camera_imu;
pub mod finding;
mod fit;
pub mod health;
mod images;
pub mod mounting;
pub mod plausibility;
mod rest;
mod statistics;
pub mod timing;
mod tracks;
pub mod verdict;

#[cfg(test)]
mod tests;

pub use plumbline_estimator::FrameInput;
pub use verdict::{Fitness, Measure};

use finding::UNITS_AND_COLUMNS;
use fit::judge::NOISE;
use fit::parts::CLOCK_RATE;
use health::CONTRADICTED;
use images::{FROZEN, ImageTests};
use plausibility::{GAPS, Plausibility, inertial};
use plumbline_config::{ImuSample, Timestamp, ValidConfig};
use plumbline_estimator::odometry::ResetReason;
use plumbline_estimator::{Estimator, HealthBits};
use std::cmp::Reverse;
use timing::{Arrivals, Sensor};
use tracks::Tracker;
use verdict::TOO_SHORT;

/// Inertial samples that are kept, and stamps of frames: five minutes at 1 kHz. Later ones are left out.
const MAX_SAMPLES: usize = 300_000;
/// Median quality of a flight whose calibration is not far off: an autopilot uses the estimate.
const USABLE: Option<i8> = Some(20);
/// Frames whose images are looked at: half a minute at 20 Hz.
const MAX_SEEN: u64 = 600;

/// Gathers what sensors deliver, flies it, and judges it.
pub struct Checkup {
    config: ValidConfig,
    data: Plausibility,
    estimator: Estimator,
    newest: Option<Timestamp>,
    resets: u32,
    /// Cameras that moved against the IMU, in a flight that was good until then.
    knocked: Option<Measure>,
    images: ImageTests,
    tracker: Option<Tracker>,
}

impl Checkup {
    /// For the rig of a configuration.
    pub fn new(config: &ValidConfig) -> Self {
        Self {
            config: config.clone(),
            data: Plausibility::with_room(config, false, MAX_SAMPLES),
            estimator: Estimator::new(config.setup()),
            newest: None,
            resets: 0,
            knocked: None,
            images: ImageTests::default(),
            tracker: Tracker::new(config),
        }
    }

    /// Stamps of a sensor, for what its driver reports of them.
    pub fn arrivals(&mut self, sensor: Sensor) -> &mut Arrivals {
        &mut self.data.arrivals[sensor as usize]
    }

    /// True if a frame of this stamp needs further samples before it is looked at.
    pub fn needs_samples(&self, stamp: Timestamp) -> bool {
        self.newest < Some(self.estimator.imu_needed_until(stamp))
    }

    /// Takes an inertial sample with its number in the sensor's stream.
    pub fn add_sample(&mut self, sequence: u64, sample: &ImuSample) {
        self.newest = self.newest.max(Some(sample.stamp));
        self.data.add_sample(sequence, sample);
        self.estimator.add_imu(sample);
    }

    /// Takes note of a frame that came.
    pub fn note_frame(&mut self, sequence: u64, stamp: Timestamp) {
        self.data.add_frame(sequence, stamp);
    }

    /// Looks at the images of a frame: live sensors may bring more than there is time for.
    pub fn look_at(&mut self, frame: &FrameInput<'_>) {
        if self.data.health.frames == MAX_SEEN {
            return;
        }
        let (sequence, flown) = (frame.sequence.unwrap_or(0), self.estimator.add_frame(frame));
        if let Some(tracker) = &mut self.tracker {
            tracker.add(sequence, frame.stamp, &frame.images);
        }
        self.images.add(frame.stamp, &frame.images, flown.health);
        self.data.add_estimate(flown.health);
        let is_new = std::mem::replace(&mut self.resets, flown.reset_counter) != flown.reset_counter;
        // A start that is tried again is none.
        let reason = self.estimator.reset_reason().filter(|why| is_new && **why != ResetReason::StartRefused);
        if let Some(reason) = reason {
            let is_knock =
                matches!(reason, ResetReason::Jump(_)) && self.data.health.median_quality() >= USABLE;
            if is_knock && self.knocked.is_none() {
                let value = format!("{reason} (frame {sequence})");
                self.knocked = Some(Measure::not_fit(FLIGHT, value, reason.cure()));
            }
            self.data.add_reset(&format!("frame {sequence}: {reason}"), reason.cure());
        }
        flown.has_pose().then(|| self.data.health.add_quality(flown.quality));
    }

    /// Frames that came.
    pub fn frames(&self) -> usize {
        self.data.arrivals[1].stamps.len()
    }

    /// Measurements so far with their verdicts: first what is wrong.
    pub fn report(&self) -> Vec<Measure> {
        let (config, data, samples) = (&self.config, &self.data, &self.data.samples);
        let wrong = inertial::nonsense(samples).into_iter().chain(data.two_clocks());
        let mut measures: Vec<Measure> =
            wrong.map(|finding| finding.into_measure_of(UNITS_AND_COLUMNS)).collect();
        let has_nonsense = !measures.is_empty();
        measures.extend(self.knocked.clone().filter(|_| !has_nonsense));
        let timing = [Sensor::Imu, Sensor::Cameras].map(|sensor| {
            timing::judge(sensor, &data.arrivals[sensor as usize], data.nominal_hz()[sensor as usize])
        });
        // Samples at another rate are fitted as they are stamped: the fit says whether their clock or the configuration is wrong.
        let is_of_rate = timing[0].cure.contains(timing::IMU_RATE);
        measures.extend(timing);
        measures.extend(self.images.judge(config.camera.len()));
        let is_wrong = |measure: &Measure| measure.verdict == Fitness::NotFit;
        let flown = if has_nonsense { Vec::new() } else { data.of_flight(true, KNOWN) };
        let flown = flown.into_iter().map(|finding| finding.into_measure_of(FLIGHT));
        let (failing, poor): (Vec<_>, Vec<_>) = flown.partition(is_wrong);
        measures.extend(failing);
        let mut mounting = mounting::judge(samples, config);
        let is_of_rate = |measure: &Measure| is_of_rate && measure.name == timing::IMU_TIMING;
        let is_spoilt = measures.iter().any(|m| is_wrong(m) && !is_of_rate(m));
        if has_nonsense || samples.is_empty() {
            mounting = mounting.map(|measure| Measure::missing(measure.name, NAMED_ABOVE.0, NAMED_ABOVE.1));
        }
        let mut fitted = match self.tracker.as_ref().map(|tracker| &tracker.found) {
            None => Vec::new(),
            Some(_) if is_spoilt => fit::judge::spoilt(config),
            Some(tracks) => fit::judge::judge(config, tracks, samples),
        };
        if fitted.first().is_some_and(|cause| cause.name == CLOCK_RATE && is_wrong(cause)) {
            measures.retain(|measure| !is_of_rate(measure));
        }
        let contradicted = if is_spoilt { Vec::new() } else { data.contradicted() };
        match fitted.iter_mut().find(|m| m.verdict > Fitness::Good && m.name != NOISE) {
            // What a flight shows is worse than a standard deviation has it.
            Some(cause) if !contradicted.is_empty() => cause.verdict = Fitness::NotFit,
            None if !is_spoilt => measures.extend(contradicted.into_iter().chain(poor)),
            _ => {}
        }
        measures.extend(mounting);
        measures.extend(fitted);
        // The images as they lie explain more than any calibration.
        let is_late = |measure: &Measure| measure.verdict <= Fitness::Good && measure.name != TOO_SHORT;
        measures.sort_by_key(|measure| (is_late(measure), Reverse(measure.verdict.max(Fitness::Good))));
        measures
    }
}

/// Bits of a flight that other measures report.
const KNOWN: HealthBits = HealthBits(GAPS.0 | CONTRADICTED.0 | FROZEN[0].0 | FROZEN[1].0);
/// Name of the measures of what the flight itself showed.
pub const FLIGHT: &str = "flight";
/// Value and cure of a measure that something else makes worthless.
pub(crate) const NAMED_ABOVE: (&str, &str) = ("not judged", "correct the problems above, then measure again");
