//! Counts and times of a live run only.

use super::Ended;
use super::drivers::CameraFigures;
use super::front_end::FrontEndFigures;
use super::tick::TickTaskFigures;
use super::watchdog_thread::WatchdogFigures;
use serde::Serialize;
use std::collections::BTreeMap;

/// Counts and times of a live run: those of its tasks, in one table.
#[derive(Clone, Debug, Serialize)]
pub struct LiveFigures {
    /// The tick.
    #[serde(flatten)]
    pub tick: TickTaskFigures,
    /// The front-end.
    #[serde(flatten)]
    pub front_end: FrontEndFigures,
    /// The source of frames.
    #[serde(flatten)]
    pub camera: CameraFigures,
    /// The watchdog.
    #[serde(flatten)]
    pub watchdog: WatchdogFigures,
    /// Estimates that corrected the odometry later than the rule says.
    pub late_corrections: u64,
    /// Most entries that waited in each ring.
    pub queue_depth: BTreeMap<&'static str, usize>,
}

impl LiveFigures {
    pub(super) fn new(ended: &Ended) -> Self {
        let (tick, front_end) = (ended.tick.figures.clone(), ended.front_end.figures.clone());
        let depths = [
            ("readings", tick.deepest),
            ("samples", front_end.deepest_samples),
            ("frames", front_end.deepest_frames),
            ("tracked frames", ended.window.deepest_frames),
        ];
        Self {
            tick,
            front_end,
            camera: ended.camera.figures,
            watchdog: ended.watchdog,
            late_corrections: ended.tick.stage.figures.late_corrections,
            queue_depth: depths.into(),
        }
    }
}
