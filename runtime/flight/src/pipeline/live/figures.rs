//! Counts and times of a live run only.

use super::Ended;
use crate::schedule::ladder::Rung;
use crate::schedule::times::{Percentiles, Times};
use serde::Serialize;
use std::collections::BTreeMap;

/// Timing of a live run.
#[derive(Clone, Debug, Serialize)]
pub struct LiveFigures {
    /// Releases of the tick.
    pub ticks: u64,
    /// Releases that passed unseen.
    pub ticks_missed: u64,
    /// Lateness of releases, ms.
    pub tick_late_ms: Percentiles,
    /// From the time of an inertial sample to its odometry, ms.
    pub sample_to_odometry_ms: Latency,
    /// Samples whose odometry came after the deadline of the tick.
    pub deadline_misses: u64,
    /// From the arrival of a frame to its being tracked, ms.
    pub frame_response_ms: Percentiles,
    /// Frames refused because a newer one was there.
    pub frames_shed: u64,
    /// Frames that the rung did not admit.
    pub frames_passed_over: u64,
    /// Frames tracked before all their inertial samples were there.
    pub frames_short_of_samples: u64,
    /// Frames that the source itself brought late.
    pub frames_late_at_source: u64,
    /// Largest lateness of a frame from the source, ms.
    pub frame_latest_at_source_ms: f64,
    /// Frames that the source passed over because they were overdue.
    pub frames_overdue_at_source: u64,
    /// Frames on each rung of the ladder.
    pub on_rung: BTreeMap<&'static str, u64>,
    /// Steps down the ladder.
    pub steps_down: u64,
    /// Steps up the ladder.
    pub steps_up: u64,
    /// Estimates that corrected the odometry later than the rule says.
    pub late_corrections: u64,
    /// Most entries that waited in each ring.
    pub queue_depth: BTreeMap<&'static str, usize>,
    /// Stalls that the watchdog named.
    pub stalls: u64,
    /// Tasks that ended by a fault of their own.
    pub deaths: u64,
    /// Fresh starts of the estimator after one.
    pub renewals: u64,
    /// Frames that were lost so.
    pub frames_lost: u64,
    /// Growth of the resident memory after the first minute, MB; none in a shorter run.
    pub memory_growth_mb: Option<f64>,
}

/// Percentiles of the latency that matters most.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Latency {
    /// Percentiles, ms.
    #[serde(flatten)]
    pub percentiles: Percentiles,
    /// The 99.9th percentile, ms.
    pub p999: f64,
}

impl Latency {
    fn of(times: &Times) -> Self {
        Self { percentiles: times.percentiles(), p999: times.quantile(0.999) }
    }
}

impl LiveFigures {
    pub(super) fn new(ended: &Ended) -> Self {
        let (tick, front, camera) = (&ended.tick.figures, &ended.front_end.figures, &ended.camera.figures);
        Self {
            ticks: tick.ticks,
            ticks_missed: tick.missed,
            tick_late_ms: tick.late_ms.percentiles(),
            sample_to_odometry_ms: Latency::of(&tick.latency_ms),
            deadline_misses: tick.deadline_misses,
            frame_response_ms: front.response_ms.percentiles(),
            frames_shed: front.shed,
            frames_passed_over: front.passed_over,
            frames_short_of_samples: front.short_of_samples,
            frames_late_at_source: camera.late,
            frame_latest_at_source_ms: camera.latest_ms,
            frames_overdue_at_source: camera.overdue,
            on_rung: Rung::ALL.map(|r| (r.name(), front.on_rung[usize::from(r.level())])).into(),
            steps_down: front.steps_down,
            steps_up: front.steps_up,
            late_corrections: ended.tick.stage.figures.late_corrections,
            queue_depth: [
                ("readings", tick.deepest),
                ("samples", front.deepest_samples),
                ("frames", front.deepest_frames),
                ("tracked frames", ended.window.deepest_frames),
            ]
            .into(),
            stalls: ended.watchdog.stalls,
            deaths: ended.watchdog.deaths,
            renewals: front.renewals,
            frames_lost: front.lost,
            memory_growth_mb: ended.watchdog.memory_growth_mb,
        }
    }
}
