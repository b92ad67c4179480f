//! Fitness of a rig's sensors for flight by their data: a pure function of samples, images and configuration.
//!
//! [`Checkup`] is given what a minute of data brings, in any order between the sensors, and [`Checkup::report`] says for each
//! thing that can be wrong what was measured, how bad that is, and what to do:
//!
//! | module | measures |
//! |---|---|
//! | [`timing`] | rates, jitter, gaps and order of the stamps of both sensors |
//! | [`plausibility`] | units and columns that cannot be right; of a flight too, while it goes on |
//! | `images` | images that are dark, burnt out, repeated, frozen, interlaced, or hold marks or bars |
//! | [`inertial`] | gravity and bias at rest, noise, stuck and saturated axes |
//! | [`mounting`] | how the IMU is mounted in the vehicle, at rest and by a nod |
//! | `fit` | everything that a calibration consists of, by one fit of images and samples (points by `tracks`) |
//! | [`camera_imu`] | pose of the cameras on the IMU and time offset, to be written into a configuration |
//! | [`health`] | the health bits of a flight: a line at its end, and warnings |
//!
//! What stamps, units or images alone show to be wrong is named first, and nothing is fitted through it. A quantity that the data do
//! not hold is reported as not measured. There is no clock and no random number here: the same data give the same report.

pub mod camera_imu;
pub mod finding;
mod fit;
pub mod health;
mod images;
pub mod inertial;
pub mod mounting;
pub mod plausibility;
mod statistics;
pub mod timing;
mod tracks;
pub mod verdict;

#[cfg(test)]
mod tests;

pub use verdict::{Fitness, Measure};

use images::ImageTests;
use plausibility::inertial::{nonsense, repeats};
use plumbline_config::{Config, ImageView, ImuSample, Timestamp};
use timing::{Arrivals, Sensor};
use tracks::Tracker;

/// Inertial samples that are kept: five minutes at 1 kHz. Later ones are left out.
const MAX_SAMPLES: usize = 300_000;
/// Frames whose stamps are kept.
const MAX_FRAMES: usize = 60_000;
/// Frames whose images are looked at: half a minute at 20 Hz.
const MAX_SEEN: usize = 600;

/// One frame as it comes: images that did not arrive are `None`.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Counts frames of the sensor; a jump is a loss.
    pub sequence: u64,
    /// Measurement time by the camera's clock.
    pub stamp: Timestamp,
    /// Left and right image.
    pub images: [Option<ImageView<'a>>; 2],
}

/// Gathers what sensors deliver, and judges it.
pub struct Checkup {
    config: Config,
    samples: Vec<ImuSample>,
    sequences: Vec<u64>,
    frames: Arrivals,
    /// Frames with both images, where both are configured.
    whole: u64,
    seen: usize,
    images: ImageTests,
    tracker: Option<Tracker>,
    /// Troubles reported by the drivers of IMU and cameras.
    troubles: [Option<String>; 2],
    refused_samples: u64,
    /// Samples and frames out of order or of the same stamp.
    disordered: [u64; 2],
}

impl Checkup {
    /// For the rig of a configuration.
    pub fn new(config: &Config) -> Self {
        Self {
            config: config.clone(),
            samples: Vec::new(),
            sequences: Vec::new(),
            frames: Arrivals::default(),
            whole: 0,
            seen: 0,
            images: ImageTests::default(),
            tracker: Tracker::new(config),
            troubles: [None, None],
            refused_samples: 0,
            disordered: [0; 2],
        }
    }

    /// Takes what the driver of a live sensor reports: why it is missing, or what is wrong with its stamps. Of several reports
    /// the first is kept.
    pub fn tell_trouble(&mut self, sensor: Sensor, words: &str) {
        self.troubles[sensor as usize].get_or_insert_with(|| words.to_owned());
    }

    /// Takes the number of inertial samples that the driver of a live sensor dropped as impossible.
    pub fn tell_refused(&mut self, samples: u64) {
        self.refused_samples = samples;
    }

    /// Takes the number of samples or frames that a driver put right or refused, since their stamps ran backwards or repeated.
    pub fn tell_disordered(&mut self, sensor: Sensor, count: u64) {
        self.disordered[sensor as usize] = count;
    }

    /// Takes an inertial sample with its number in the sensor's stream.
    pub fn add_sample(&mut self, sequence: u64, sample: &ImuSample) {
        if self.samples.len() < MAX_SAMPLES && sample.is_finite() {
            self.samples.push(*sample);
            self.sequences.push(sequence);
        }
    }

    /// Takes a frame.
    pub fn add_frame(&mut self, frame: &Frame<'_>) {
        let arrived = [0, 1].map(|camera| frame.images[camera].is_some());
        self.note_frame(frame.sequence, frame.stamp, arrived);
        self.look_at(frame);
    }

    /// Takes note that a frame came, and which of its images, for one whose images there is no time to look at.
    pub fn note_frame(&mut self, sequence: u64, stamp: Timestamp, arrived: [bool; 2]) {
        if self.frames.stamps.len() < MAX_FRAMES {
            self.frames.push(stamp, sequence);
            let wanted = self.config.camera.len().min(2);
            self.whole += u64::from(arrived[..wanted].iter().all(|is_there| *is_there));
        }
    }

    /// Looks at the images of a frame that was taken note of.
    pub fn look_at(&mut self, frame: &Frame<'_>) {
        if self.has_seen_enough() {
            return;
        }
        self.seen += 1;
        self.images.add(frame.stamp, &frame.images);
        if let Some(tracker) = &mut self.tracker {
            tracker.add(frame.sequence, frame.stamp, &frame.images);
        }
    }

    /// True if no further images are looked at.
    pub fn has_seen_enough(&self) -> bool {
        self.seen == MAX_SEEN
    }

    /// Measurements so far with their verdicts: first what is wrong.
    pub fn report(&self) -> Vec<Measure> {
        let config = &self.config;
        let (imu, frames) = self.arrivals();
        let refused = inertial::refused(self.refused_samples, self.samples.len());
        let clocks = timing::two_clocks(&imu.stamps, &frames.stamps);
        let wrong = nonsense(&self.samples).into_iter().chain(refused).chain(clocks);
        let mut measures: Vec<Measure> = wrong.map(finding::Finding::into_measure).collect();
        let has_nonsense = !measures.is_empty();
        measures.extend(self.timing(&imu, &frames));
        measures.extend(repeats(&self.samples).map(finding::Finding::into_measure));
        let images = self.images.judge(&self.samples, config.camera.len());
        let is_bad = |measure: &Measure| measure.verdict == Fitness::NotFit;
        let is_spoilt = has_nonsense || measures.iter().chain(&images).any(is_bad);
        measures.extend(images);
        measures.extend(inertial::axes(&self.samples, &config.imu));
        let mut of_samples = inertial::noise(&self.samples, &config.imu);
        let tracks = self.tracker.as_ref().map(Tracker::tracks);
        let rest = match tracks.filter(|tracks| !tracks.keys.is_empty()) {
            Some(tracks) => inertial::rest_seen(&self.samples, &tracks.moving()),
            None => inertial::rest(&self.samples),
        };
        of_samples.extend(inertial::at_rest(&rest, config));
        of_samples.extend(mounting::judge(&self.samples, &rest, config));
        if has_nonsense || self.samples.is_empty() {
            of_samples.iter_mut().for_each(Measure::spoil);
        }
        measures.extend(of_samples);
        let fitted = tracks.map_or_else(Vec::new, |tracks| match is_spoilt {
            true => fit::judge::spoilt(config),
            false => fit::judge::judge(config, tracks, &self.samples),
        });
        measures.extend(fitted);
        // The images as they lie explain more than any calibration.
        measures.sort_by_key(|measure| measure.verdict != Fitness::NotFit);
        measures
    }

    /// Arrivals of samples and frames.
    fn arrivals(&self) -> (Arrivals, Arrivals) {
        let mut imu = Arrivals::default();
        imu.refused = self.refused_samples;
        for (sample, sequence) in self.samples.iter().zip(&self.sequences) {
            imu.push(sample.stamp, *sequence);
        }
        let mut frames = self.frames.clone();
        [imu.disordered, frames.disordered] = self.disordered;
        (imu, frames)
    }

    /// Measures of the stamps, and of frames with both images.
    fn timing(&self, imu: &Arrivals, frames: &Arrivals) -> Vec<Measure> {
        let config = &self.config;
        let frame_rate_hz = config.camera.first().map_or(0.0, |camera| camera.rate_hz);
        let mut measures = vec![
            timing::judge(Sensor::Imu, imu, config.imu.rate_hz),
            timing::judge(Sensor::Cameras, frames, frame_rate_hz),
        ];
        for (measure, trouble) in measures.iter_mut().zip(&self.troubles) {
            if let Some(words) = trouble {
                (measure.verdict, measure.cure) = (Fitness::NotFit, words.clone());
            }
        }
        measures.extend(
            (config.camera.len() == 2).then(|| timing::judge_pairs(self.whole, self.frames.stamps.len())),
        );
        measures
    }
}

/// Value and cure of a measure that something else makes worthless.
pub(crate) const NAMED_ABOVE: (&str, &str) = ("not judged", "correct the problems above, then measure again");
