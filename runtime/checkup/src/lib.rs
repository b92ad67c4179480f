//! Fitness of a rig's sensors for flight by their data: a pure function of samples, images and configuration.
//!
//! [`Checkup`] is given what a minute of data brings, in any order between the sensors, and [`Checkup::report`] says for each
//! thing that can be wrong what was measured, how bad that is, and what to do:
//!
//! | module | measures |
//! |---|---|
//! | [`timing`] | rates, jitter and gaps of both sensors |
//! | [`inertial`] | gravity, bias of the gyroscope, stuck and saturated axes |
//! | `failing` | inertial sensors that fail with noise, by the motion that images show |
//! | [`mounting`] | how the IMU is mounted in the vehicle, at rest and by a nod |
//! | [`vibration`] | level and lines of the spectrum, and what they may be aliases of |
//! | [`exposure`] | dark and burnt-out images, blur by rotation |
//! | [`pair`], [`lag`] | epipolar error left to right, by matches that know nothing of the calibration; a camera late by frames |
//! | [`scale`] | the scale of the pair of cameras against that of the accelerometer |
//! | `repeats` | samples and images that are bit for bit those before |
//! | `frozen` | cameras that deliver one image again and again, with noise |
//! | [`motion`], [`agreement`] | time offset and rotation between camera and IMU, by the rotation that images show |
//! | [`health`] | the health bits of a flight: a line at its end, and warnings |
//! | [`plausibility`] | units, columns, axes and sides that cannot be right; of a flight too, while it goes on |
//!
//! A quantity that the data do not hold is reported as not measured, and is no verdict. There is no clock and
//! no random number here: the same data give the same report.

pub mod agreement;
pub mod exposure;
mod failing;
mod fft;
pub mod finding;
mod frozen;
pub mod health;
pub mod inertial;
pub mod lag;
pub mod late_camera;
pub mod motion;
pub mod mounting;
pub mod pair;
pub mod plausibility;
mod repeats;
pub mod scale;
mod statistics;
pub mod thumbnail;
pub mod timing;
pub mod verdict;
pub mod vibration;

#[cfg(test)]
mod tests;

pub use verdict::{CheckupReport, Fitness, Measure};

use agreement::Turn;
use failing::Failure;
use frozen::{Frozen, Views};
use inertial::{Axes, Rest};
use lag::LagFinder;
use late_camera::Lag;
use motion::MotionFinder;
use pair::{PairFigures, PairMatcher};
use plausibility::gravity::{self, GravityTurns};
use plausibility::inertial::Magnitudes;
use plausibility::rotation::{IN_DEGREES, OTHER_AXES};
use plausibility::{Finding, Glimpse, Seen, Sight};
use plumbline_config::options::image_sizes;
use plumbline_config::{Config, ImageView, ImuSample, Timestamp};
use repeats::Repeats;
use timing::Arrivals;

/// Inertial samples that are kept: five minutes at 1 kHz. Later ones are left out.
const MAX_SAMPLES: usize = 300_000;
/// Frames whose stamps are kept.
const MAX_FRAMES: usize = 60_000;
/// Frames whose images are looked at: half a minute at 20 Hz, each a hundredth of a second of work.
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
    glimpse: Glimpse,
    sight: Sight,
    rotations: Vec<Seen>,
    views: Views,
    matcher: Option<PairMatcher>,
    pairs: PairFigures,
    lag: Option<LagFinder>,
    repeats: Repeats,
    motion: Option<MotionFinder>,
    turns: Vec<Turn>,
    exposure_s: Option<f64>,
    /// Troubles reported by the drivers of IMU and cameras.
    troubles: [Option<String>; 2],
    refused_samples: u64,
    /// Samples and frames out of order or of the same stamp.
    disordered: [u64; 2],
}

/// What images show, without those that are frozen.
struct Shown {
    frozen: Frozen,
    rotations: Vec<Seen>,
    turns: Vec<Turn>,
    pairs: PairFigures,
    lag: Option<Lag>,
    repeats: Repeats,
}

/// Findings that cannot be right, and the measurements that they spoil.
struct Nonsense {
    findings: Vec<Finding>,
    are_samples_wrong: bool,
    are_columns_wrong: bool,
    /// Inertial sensors that fail.
    failures: Vec<Failure>,
}

impl Checkup {
    /// For the rig of a configuration.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        Self {
            config: config.clone(),
            samples: Vec::new(),
            sequences: Vec::new(),
            frames: Arrivals::default(),
            whole: 0,
            seen: 0,
            glimpse: Glimpse::new(image_sizes(&config.camera)),
            sight: Sight::new(config),
            rotations: Vec::new(),
            views: Views::new(config),
            matcher: PairMatcher::new(config),
            pairs: PairFigures::default(),
            lag: LagFinder::new(config),
            repeats: Repeats::default(),
            motion: MotionFinder::new(config),
            turns: Vec::new(),
            exposure_s: None,
            troubles: [None, None],
            refused_samples: 0,
            disordered: [0; 2],
        }
    }

    /// Takes note of the exposure that the cameras' driver tells, s: it counts, and not the configured one.
    pub fn tell_exposure(&mut self, exposure_s: f64) {
        self.exposure_s = Some(exposure_s).filter(|exposure_s| exposure_s.is_finite() && *exposure_s > 0.0);
    }

    /// Takes what the driver of a live sensor reports: why it is missing, or what is wrong with its stamps. Of several reports
    /// the first is kept.
    pub fn tell_trouble(&mut self, sensor: timing::Sensor, words: &str) {
        self.troubles[sensor as usize].get_or_insert_with(|| words.to_owned());
    }

    /// Takes the number of inertial samples that the driver of a live sensor dropped as impossible.
    pub fn tell_refused(&mut self, samples: u64) {
        self.refused_samples = samples;
    }

    /// Takes the number of samples or frames that a driver put right or refused, since their stamps ran backwards or repeated.
    pub fn tell_disordered(&mut self, sensor: timing::Sensor, count: u64) {
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

    /// Looks at the images of a frame that was taken note of. Such of another size than the configuration's are not seen.
    pub fn look_at(&mut self, frame: &Frame<'_>) {
        if self.has_seen_enough() {
            return;
        }
        self.seen += 1;
        self.repeats.add(&frame.images);
        self.glimpse.stamp = frame.stamp;
        for (camera, image) in frame.images.iter().enumerate() {
            self.glimpse.valid[camera] =
                image.as_ref().is_some_and(|image| self.glimpse.images[camera].take_view(image));
        }
        let seen = self.sight.add(&self.glimpse);
        self.views.add(&self.glimpse, seen);
        if self.rotations.len() < plausibility::MAX_PAIRS {
            self.rotations.extend(seen);
        }
        let (Some(matcher), [Some(left), Some(right)]) = (&mut self.matcher, &frame.images) else { return };
        if !matcher.find(left, right) {
            return;
        }
        self.pairs.add(frame.stamp, matcher.matches());
        if let Some(lag) = &mut self.lag {
            lag.add(frame.stamp, [left, right], matcher.matches().iter().map(|found| found.epipolar_px));
        }
        if let Some(motion) = &mut self.motion {
            self.turns.extend(motion.next(frame.stamp, matcher.left(), matcher.matches()));
        }
    }

    /// True if no further images are looked at.
    #[must_use]
    pub fn has_seen_enough(&self) -> bool {
        self.seen == MAX_SEEN
    }

    /// Measurements so far with their verdicts.
    #[must_use]
    pub fn report(&self) -> CheckupReport {
        let (imu, shown) = (self.arrivals(), self.shown());
        let rest = inertial::rest(&self.samples, &shown.turns);
        let turns = GravityTurns::of(&self.samples);
        let nonsense = self.nonsense(&shown, &rest, &turns, &imu);
        let consequences = self.consequences(&shown, &nonsense, &imu);
        let Nonsense { findings, failures, are_columns_wrong, .. } = nonsense;
        let clocks = timing::two_clocks(&imu.stamps, &self.frames.stamps);
        let mut measures: Vec<Measure> =
            clocks.into_iter().chain(findings).map(Finding::into_measure).collect();
        measures.extend(shown.frozen.judge());
        measures.extend(self.timing(&imu));
        measures.extend(shown.repeats.judge(&self.samples));
        let axes = Axes::of(&self.samples, &self.config.imu, failing::moved(&self.samples));
        measures.extend(failing::judge(&axes, &failures));
        measures.extend(self.inertial(&rest, (!are_columns_wrong).then_some(&turns)));
        measures.extend(self.cameras(&shown));
        // What is left of a recording whose images freeze may be too little.
        let is_too_little = |measure: &Measure| {
            !shown.frozen.is_none()
                && measure.verdict <= Fitness::Uncertain
                && (OF_BOTH.contains(&measure.name) || OF_IMAGES.contains(&measure.name))
        };
        let is_consequence =
            |measure: &Measure| consequences.contains(&measure.name) || is_too_little(measure);
        for measure in measures.iter_mut().filter(|measure| is_consequence(measure)) {
            measure.verdict = Fitness::NotMeasured;
            measure.cure = NAMED_ABOVE.into();
        }
        CheckupReport { measures }
    }

    /// What images show, without those that are frozen.
    fn shown(&self) -> Shown {
        let frozen = self.views.frozen(&self.samples, &self.config);
        let is_frozen = |stamp: Timestamp| frozen.covers(stamp);
        let rotations = self.rotations.iter().copied().filter(|seen| !frozen.touches(seen.from, seen.to));
        let turns = self.turns.iter().copied().filter(|turn| !frozen.touches(turn.from, turn.to));
        Shown {
            rotations: rotations.collect(),
            turns: turns.collect(),
            pairs: self.pairs.without(&is_frozen),
            lag: self.lag.as_ref().and_then(|lag| lag.lag(&is_frozen)),
            repeats: self.repeats.without([0, 1].map(|camera| frozen.exact(camera))),
            frozen,
        }
    }

    /// Arrivals of the samples.
    fn arrivals(&self) -> Arrivals {
        let mut imu = Arrivals::default();
        imu.refused = self.refused_samples;
        imu.disordered = self.disordered[timing::Sensor::Imu as usize];
        for (sample, sequence) in self.samples.iter().zip(&self.sequences) {
            imu.push(sample.stamp, *sequence);
        }
        imu
    }

    /// Findings that cannot be right, and sensors that fail by what images show.
    fn nonsense(&self, shown: &Shown, rest: &Rest, turns: &GravityTurns, imu: &Arrivals) -> Nonsense {
        let config = &self.config;
        let comparable = if self.are_images_wrong(shown, imu) { &[] } else { &shown.turns[..] };
        let mut failures = failing::failures(comparable, &self.samples, config);
        let mut magnitudes = Magnitudes::default();
        self.samples.iter().for_each(|sample| magnitudes.add(sample));
        let agreement = plausibility::agreement_of(config, &shown.rotations, &self.samples);
        let is_frozen = |stamp: Timestamp| shown.frozen.covers(stamp);
        let (gravity, sight) = ((turns, config.vehicle.rot_v_b()), (&self.sight, &is_frozen as _));
        let mut findings = plausibility::nonsense(&magnitudes, gravity, &agreement, sight);
        // At rest the mounting says it, with its angles.
        findings.retain(|finding| finding.what != gravity::UPSIDE_DOWN || rest.seconds == 0.0);
        failing::reconcile(&mut failures, &mut findings);
        let refused = inertial::refused(self.refused_samples, self.samples.len());
        // What is left of such samples does not tell how gravity turns.
        findings.retain(|finding| refused.is_none() || finding.what != gravity::DISAGREE);
        let refused = refused.filter(|_| findings.is_empty());
        let are_samples_wrong = refused.is_some()
            || magnitudes.nonsense().iter().any(|finding| findings.contains(finding))
            || findings.iter().any(|finding| finding.what == IN_DEGREES);
        let are_columns_wrong =
            findings.iter().any(|finding| [OTHER_AXES, gravity::DISAGREE].contains(&finding.what.as_str()));
        findings.extend(refused);
        Nonsense { findings, are_samples_wrong, are_columns_wrong, failures }
    }

    /// Measures of the stamps, and of frames with both images.
    fn timing(&self, imu: &Arrivals) -> Vec<Measure> {
        let config = &self.config;
        let frame_rate_hz = config.camera.first().map_or(0.0, |camera| camera.rate_hz);
        let mut frames = self.frames.clone();
        frames.disordered = self.disordered[timing::Sensor::Cameras as usize];
        let mut measures = vec![
            timing::judge(timing::Sensor::Imu, imu, config.imu.rate_hz),
            timing::judge(timing::Sensor::Cameras, &frames, frame_rate_hz),
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

    /// Measures of the inertial sensor and of its mounting; how gravity turns where `turns` tells it.
    fn inertial(&self, rest: &Rest, turns: Option<&GravityTurns>) -> Vec<Measure> {
        let config = &self.config;
        let mut measures: Vec<Measure> = turns.map(GravityTurns::judge).into_iter().collect();
        let [gravity, bias] = inertial::at_rest(rest, config);
        let [mounting, heading] = mounting::judge(&self.samples, rest, config);
        measures.extend([gravity, mounting, heading, bias]);
        measures.extend(vibration::judge(&self.samples, &config.imu));
        measures
    }

    /// Measures of the images, and of cameras against each other and against the inertial sensor.
    fn cameras(&self, shown: &Shown) -> Vec<Measure> {
        let config = &self.config;
        let mut measures =
            vec![self.sight.brightness.judge(), exposure::blur(&self.samples, config, self.exposure_s)];
        measures.extend(self.matcher.as_ref().map(|_| shown.pairs.judge(config, shown.lag.as_ref())));
        if self.motion.is_some() {
            let agreed = agreement::judge(&shown.turns, &self.samples, config);
            let focal = agreed.iter().find(|measure| measure.name == agreement::FOCAL_NAME);
            let focal = focal.map_or(Fitness::NotMeasured, |measure| measure.verdict);
            measures.extend(agreed);
            measures.push(scale::judge(&shown.turns, &self.samples, config, focal));
        }
        if config.camera.len() == 1 {
            let missing = |name| {
                Measure::missing(
                    name,
                    "it takes two cameras, and the configuration has one",
                    "nothing to do where the vehicle has one camera: calibrate it with care (docs/calibration.md)",
                )
            };
            measures.extend(OF_PAIRS.map(missing));
        }
        measures
    }

    /// True if images repeat, are of different moments or are measured through a wrong lens model, or the
    /// stamps of either stream are mixed up. Comparisons of images and samples are then no measurement.
    fn are_images_wrong(&self, shown: &Shown, imu: &Arrivals) -> bool {
        let limit_px = f64::from(self.config.estimator.points.max_epipolar_px);
        let rate_hz = self.config.camera.first().map_or(0.0, |camera| camera.rate_hz);
        let mut frames = self.frames.clone();
        frames.disordered = self.disordered[timing::Sensor::Cameras as usize];
        shown.repeats.is_grave()
            || shown.lag.is_some()
            || shown.pairs.is_lens_in_doubt(limit_px)
            || timing::is_mixed_up(timing::Sensor::Imu, imu, self.config.imu.rate_hz)
            || timing::is_mixed_up(timing::Sensor::Cameras, &frames, rate_hz)
    }

    /// Measures that come out wrong while a sensor is missing or its stamps, units, columns or sides are wrong: their cures
    /// would mislead.
    fn consequences(&self, shown: &Shown, wrong: &Nonsense, imu: &Arrivals) -> Vec<&'static str> {
        let (no_samples, no_frames) = (self.samples.is_empty(), self.frames.stamps.is_empty());
        let is_both = !wrong.findings.is_empty()
            || self.troubles.iter().any(Option::is_some)
            || (no_samples || no_frames || self.are_images_wrong(shown, imu));
        let samples = OF_SAMPLES.into_iter().filter(|_| wrong.are_samples_wrong || no_samples);
        let images = OF_IMAGES.into_iter().filter(|_| no_frames);
        let columns = OF_COLUMNS.into_iter().filter(|_| wrong.are_columns_wrong);
        let both = OF_BOTH.into_iter().filter(|_| is_both);
        samples.chain(images).chain(columns).chain(both).chain(failing::spoiled(&wrong.failures)).collect()
    }
}

/// Cure of a measure that something else makes worthless.
pub const NAMED_ABOVE: &str = "correct the problems above, then measure again";

/// Measures that need two cameras.
const OF_PAIRS: [&str; 6] =
    ["stereo pairs", "epipolar error", "time offset", "camera-IMU rotation", "focal length", scale::NAME];
/// Measures of the inertial samples alone.
const OF_SAMPLES: [&str; 10] = [
    "IMU axes",
    inertial::UNMOVED_NAME,
    gravity::NAME,
    "gravity",
    mounting::NAME,
    mounting::HEADING_NAME,
    "gyroscope bias",
    "vibration of the accelerometer",
    "vibration of the gyroscope",
    "blur",
];
/// Measures of the images alone.
const OF_IMAGES: [&str; 3] = ["stereo pairs", "exposure", "epipolar error"];
/// Measures of the columns of the inertial samples.
const OF_COLUMNS: [&str; 3] = [gravity::NAME, mounting::NAME, mounting::HEADING_NAME];
/// Measures of images and samples together.
const OF_BOTH: [&str; 4] = ["time offset", "camera-IMU rotation", "focal length", scale::NAME];
