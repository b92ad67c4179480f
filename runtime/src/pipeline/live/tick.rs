//! The task of the tick: at every release, what is due becomes odometry. Only the inertial driver goes before it.

use super::super::tick::TickStage;
use super::shared::Shared;
use crate::schedule::ring::{Reader, Writer};
use crate::schedule::tasks::TaskId;
use crate::schedule::ticker::{Monotonic, Ticker};
use crate::schedule::times::Times;
use plumbline_drivers::ImuReading;
use plumbline_estimator::Estimate;

/// Releases are this much after the grid of the samples, so that each finds the sample of its own time, ns.
const PHASE_NS: i64 = 150_000;

/// What the task counts and times.
pub struct TickTaskFigures {
    /// Releases.
    pub ticks: u64,
    /// Releases that passed unseen.
    pub missed: u64,
    /// Readings whose odometry was later than the task's deadline.
    pub deadline_misses: u64,
    /// How late releases were, ms.
    pub late_ms: Times,
    /// From the time of a reading to its odometry, ms.
    pub latency_ms: Times,
    /// Most readings that waited.
    pub deepest: usize,
}

/// What the task leaves.
pub struct TickEnd {
    pub stage: TickStage,
    pub figures: TickTaskFigures,
}

/// The tick as a task.
pub struct TickTask {
    stage: TickStage,
    readings: Reader<ImuReading>,
    corrections: Reader<Estimate>,
    samples: Writer<ImuReading>,
    figures: TickTaskFigures,
}

impl TickTask {
    pub fn new(
        stage: TickStage,
        readings: Reader<ImuReading>,
        corrections: Reader<Estimate>,
        samples: Writer<ImuReading>,
    ) -> Self {
        let figures = TickTaskFigures {
            ticks: 0,
            missed: 0,
            deadline_misses: 0,
            late_ms: Times::of_ms(),
            latency_ms: Times::of_ms(),
            deepest: 0,
        };
        Self { stage, readings, corrections, samples, figures }
    }

    /// Ticks until the readings end.
    pub fn run(mut self, shared: &Shared<'_>) -> TickEnd {
        let first = shared.origin.due.plus_nanos(PHASE_NS);
        let mut ticker = Ticker::new(first, shared.table.row(TaskId::Tick).period);
        while !shared.is_stopped() && !self.readings.is_closed() {
            let release = ticker.wait();
            shared.heartbeats.busy(TaskId::Tick);
            self.figures.ticks += 1;
            self.figures.missed += release.missed;
            self.figures.late_ms.record(release.late_ms);
            self.take_due(shared);
        }
        self.figures.deepest = self.readings.deepest();
        TickEnd { stage: self.stage, figures: self.figures }
    }

    /// Takes every reading that is due.
    fn take_due(&mut self, shared: &Shared<'_>) {
        while let Some(estimate) = self.corrections.pop() {
            self.stage.correct_later(estimate);
        }
        let deadline_ms = shared.table.row(TaskId::Tick).deadline.as_secs_f64() * 1e3;
        while let Some(reading) = self.readings.peek().copied()
            && shared.due(reading.sample.stamp) <= Monotonic::now()
        {
            self.readings.pop();
            self.stage.take(&reading);
            let latency_ms = Monotonic::now().ms_since(shared.due(reading.sample.stamp));
            self.figures.latency_ms.record(latency_ms);
            self.figures.deadline_misses += u64::from(latency_ms > deadline_ms);
            // Full, it is a minute behind: the front-end is gone, and has been named by the watchdog.
            let _ = self.samples.push(reading);
        }
    }
}
