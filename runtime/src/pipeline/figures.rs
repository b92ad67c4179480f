//! What a run counts and times.

use super::clock::Stopwatch;
use super::stages::{Cost, FrontStage, WindowStage};
use super::tick::TickStage;
use hdrhistogram::Histogram;
use plumbline_config::Timestamp;
use plumbline_estimator::{Estimate, FrameFigures, Stage, StageProbe};
use serde::{Deserialize, Serialize};

/// Times are recorded in microseconds up to ten seconds, to three digits; longer ones count as ten.
const MAX_US: u64 = 10_000_000;
/// Hand-out times are recorded in nanoseconds up to a tenth of a second.
const MAX_NS: u64 = 100_000_000;

/// Percentiles of a time, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Largest.
    pub max: f64,
    /// Mean.
    pub mean: f64,
}

/// A histogram of times in fixed memory.
#[derive(Clone, Debug)]
pub struct Times {
    histogram: Histogram<u64>,
    per_unit: f64,
    max: u64,
}

impl Times {
    fn new(max: u64, per_unit: f64) -> Self {
        let histogram =
            Histogram::new_with_max(max, 3).unwrap_or_else(|_| unreachable!("three digits are allowed"));
        Self { histogram, per_unit, max }
    }

    /// Of milliseconds.
    #[must_use]
    pub fn of_ms() -> Self {
        Self::new(MAX_US, 1e3)
    }

    /// Of microseconds.
    #[must_use]
    pub fn of_us() -> Self {
        Self::new(MAX_NS, 1e3)
    }

    /// Times recorded.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.histogram.len()
    }

    /// Adds one time.
    pub fn record(&mut self, time: f64) {
        let ticks = (time * self.per_unit).round().clamp(1.0, self.max as f64) as u64;
        self.histogram.saturating_record(ticks);
    }

    /// Adds the times of another of the same unit.
    pub fn add(&mut self, other: &Self) {
        // Fails only for values beyond the range, which is the same.
        let _ = self.histogram.add(&other.histogram);
    }

    /// The time that the share `q` of all does not exceed.
    #[must_use]
    pub fn quantile(&self, q: f64) -> f64 {
        if self.count() == 0 { 0.0 } else { self.histogram.value_at_quantile(q) as f64 / self.per_unit }
    }

    /// The percentiles, in the unit of the times.
    #[must_use]
    pub fn percentiles(&self) -> Percentiles {
        let h = &self.histogram;
        if h.is_empty() {
            return Percentiles::default();
        }
        let at = |q: f64| self.quantile(q);
        let (max, mean) = (h.max() as f64 / self.per_unit, h.mean() / self.per_unit);
        Percentiles { p50: at(0.5), p95: at(0.95), p99: at(0.99), max, mean }
    }
}

/// The time of each stage.
#[derive(Clone, Debug)]
pub struct StageTimes {
    running: [Option<Stopwatch>; Stage::ALL.len()],
    times: [Times; Stage::ALL.len()],
}

impl Default for StageTimes {
    fn default() -> Self {
        Self { running: [None; Stage::ALL.len()], times: std::array::from_fn(|_| Times::of_ms()) }
    }
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

/// Everything a run counts and times.
#[derive(Clone, Debug)]
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
    /// Time from an inertial sample to its odometry.
    pub handout_us: Times,
    /// Stages of a frame.
    pub stages: StageTimes,
    /// Sums over frames of points tracked and landmarks in the window.
    pub points: (u64, u64),
    /// Sums over frames of line segments.
    pub lines: LineMoments,
    /// Time offset at the end, s.
    pub time_offset_s: f64,
    first_frame: Option<Timestamp>,
    started: Stopwatch,
}

/// Sums over frames of the line segments of the left image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineMoments {
    /// Found.
    pub raw: u64,
    /// Long enough.
    pub kept: u64,
    /// After merging.
    pub merged: u64,
    /// Continuing a track.
    pub matched: u64,
    /// Line landmarks in the window.
    pub in_window: u64,
    /// Of these, along a direction of the structure.
    pub in_structure: u64,
    /// Images, of both cameras, whose budget was spent.
    pub cut_short: u64,
}

impl LineMoments {
    fn add(&mut self, figures: &FrameFigures) {
        self.raw += u64::from(figures.lines_raw);
        self.kept += u64::from(figures.lines_kept);
        self.merged += u64::from(figures.lines_merged);
        self.matched += u64::from(figures.lines_matched);
        self.in_window += u64::from(figures.lines_in_window);
        self.in_structure += u64::from(figures.lines_in_structure);
        self.cut_short += u64::from(figures.lines_cut_short);
    }
}

impl Default for Figures {
    fn default() -> Self {
        Self {
            frames: 0,
            frames_refused: 0,
            poses: 0,
            imu_refused: 0,
            resets: 0,
            hot_path_allocations: 0,
            first_pose_s: None,
            span_s: 0.0,
            wall_s: 0.0,
            frame_ms: Times::of_ms(),
            frame_cpu_ms: Times::of_ms(),
            handout_us: Times::of_us(),
            stages: StageTimes::default(),
            points: (0, 0),
            lines: LineMoments::default(),
            time_offset_s: 0.0,
            first_frame: None,
            started: Stopwatch::start(),
        }
    }
}

impl Figures {
    /// The run begins.
    pub fn start(&mut self) {
        self.started = Stopwatch::start();
    }

    /// The run is over.
    pub fn finish(&mut self) {
        self.wall_s = self.started.elapsed_ms() * 1e-3;
    }

    /// One frame was estimated.
    pub fn frame(&mut self, estimate: &Estimate, cost: Cost) {
        let stamp = estimate.stamp;
        let first = *self.first_frame.get_or_insert(stamp);
        self.frames += 1;
        self.span_s = stamp.seconds_since(first);
        self.frame_ms.record(cost.wall_ms);
        self.frame_cpu_ms.record(cost.cpu_ms);
        self.resets = estimate.reset_counter;
        self.time_offset_s = estimate.time_offset_s;
        if estimate.health.contains(plumbline_estimator::HealthBits::BAD_STAMP) {
            self.frames_refused += 1;
        }
        self.points.0 += u64::from(estimate.figures.points_tracked);
        self.points.1 += u64::from(estimate.figures.points_in_window);
        self.lines.add(&estimate.figures);
        if estimate.has_pose() {
            self.poses += 1;
            self.first_pose_s.get_or_insert(stamp.seconds_since(first));
        }
    }

    /// The stages have ended: takes what they counted and timed.
    pub fn add_stages(&mut self, front: &FrontStage, window: &WindowStage, tick: &TickStage) {
        for times in front.times().into_iter().chain([&window.times, &tick.figures.times]) {
            self.stages.add(times);
        }
        self.handout_us = tick.figures.handout_us.clone();
        self.imu_refused += front.imu_refused;
        self.hot_path_allocations += front.allocations + window.allocations + tick.figures.allocations;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_times() {
        let mut times = Times::of_ms();
        (1..=100).for_each(|k| times.record(f64::from(k)));
        let p = times.percentiles();
        assert!((p.p50 - 50.0).abs() < 0.1 && (p.p99 - 99.0).abs() < 0.1 && (p.max - 100.0).abs() < 0.1);
        times.record(1e9);
        assert!((times.percentiles().max - 10_000.0).abs() < 10.0);
    }
}
