//! Counts and times of a run.

use super::clock::Stopwatch;
use crate::schedule::times::{Percentiles, Times};
use plumbline_checkup::health::HealthTally;
use plumbline_config::Timestamp;
use plumbline_estimator::{Estimate, FrameFigures, Stage, StageProbe};
use plumbline_record::fields::Record as _;

/// Computation of a frame, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// Wall time.
    pub wall_ms: f64,
    /// Processor time of the thread that led.
    pub cpu_ms: f64,
}

impl Cost {
    /// The sum of both.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self { wall_ms: self.wall_ms + other.wall_ms, cpu_ms: self.cpu_ms + other.cpu_ms }
    }
}

/// The time of each stage.
#[derive(Clone, Debug, Default)]
pub struct StageTimes {
    running: [Option<Stopwatch>; Stage::ALL.len()],
    times: [Times; Stage::ALL.len()],
}

impl StageTimes {
    /// Every stage with its percentiles, ms.
    pub fn all(&self) -> impl Iterator<Item = (Stage, Percentiles)> + '_ {
        Stage::ALL.into_iter().map(|stage| (stage, self.times[stage as usize].percentiles()))
    }

    /// Adds the times of another.
    pub fn add(&mut self, other: &Self) {
        for (mine, theirs) in self.times.iter_mut().zip(&other.times) {
            mine.add(theirs);
        }
    }
}

impl StageProbe for StageTimes {
    fn begin(&mut self, stage: Stage) {
        self.running[stage as usize] = Some(Stopwatch::start());
    }

    fn end(&mut self, stage: Stage) {
        if let Some(watch) = self.running[stage as usize].take() {
            self.times[stage as usize].record(watch.elapsed_ms());
        }
    }
}

/// Counts and times of a run.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    /// Frames taken.
    pub frames: u64,
    /// Frames whose stamp was not later than the one before.
    pub frames_refused: u64,
    /// Frames with a pose.
    pub poses: u64,
    /// Inertial samples refused.
    pub imu_refused: u64,
    /// Resets.
    pub resets: u32,
    /// First value of the reset counter.
    pub first_reset_counter: u32,
    /// Allocations and frees while estimating, after the warm-up.
    pub hot_path_allocations: u64,
    /// Data time from the first image to the first pose, s.
    pub first_pose_s: Option<f64>,
    /// Data time of all frames, s.
    pub span_s: f64,
    /// Wall time of the run, s.
    pub wall_s: f64,
    /// Wall time of each frame's computation.
    pub frame_ms: Times,
    /// Processor time of each frame's computation.
    pub frame_cpu_ms: Times,
    /// Time from an inertial sample to its odometry, microseconds.
    pub handout_us: Times,
    /// Stages of a frame.
    pub stages: StageTimes,
    /// Frames with each health bit, and qualities from the first pose on.
    pub health: HealthTally,
    /// Time offset at the end, s.
    pub time_offset_s: f64,
    /// Sums over frames of the counts in [`FrameFigures`].
    counts: [u64; FrameFigures::FIELDS.len()],
    first_frame: Option<Timestamp>,
    started: Option<Stopwatch>,
}

impl Figures {
    /// The run begins.
    pub fn start(&mut self) {
        self.started = Some(Stopwatch::start());
    }

    /// The run is over.
    pub fn finish(&mut self) {
        self.wall_s = self.started.map_or(0.0, |started| started.elapsed_ms() * 1e-3);
    }

    /// Means per frame of the counts in [`FrameFigures`] whose names begin with `prefix`, by the rest of their names.
    pub fn means(&self, prefix: &str) -> impl Iterator<Item = (&'static str, f64)> {
        let frames = self.frames.max(1) as f64;
        let counts = FrameFigures::FIELDS.iter().zip(self.counts);
        counts.filter_map(move |(field, sum)| {
            Some((field.about.name.strip_prefix(prefix)?, sum as f64 / frames))
        })
    }

    /// One frame was estimated.
    pub fn frame(&mut self, estimate: &Estimate, cost: Cost) {
        self.frames += 1;
        self.health.add(estimate.health);
        if estimate.is_refused() {
            // Its stamp is not one to reckon with.
            self.frames_refused += 1;
            return;
        }
        let stamp = estimate.stamp;
        let first = *self.first_frame.get_or_insert(stamp);
        self.span_s = stamp.seconds_since(first);
        self.frame_ms.record(cost.wall_ms);
        self.frame_cpu_ms.record(cost.cpu_ms);
        self.resets = estimate.reset_counter.wrapping_sub(self.first_reset_counter);
        self.time_offset_s = estimate.time_offset_s;
        for (sum, field) in self.counts.iter_mut().zip(FrameFigures::FIELDS) {
            *sum += (field.get)(&estimate.figures).whole() as u64;
        }
        if estimate.has_pose() {
            self.poses += 1;
            self.first_pose_s.get_or_insert(stamp.seconds_since(first));
        }
        if self.first_pose_s.is_some() {
            self.health.add_quality(estimate.quality);
        }
    }
}
