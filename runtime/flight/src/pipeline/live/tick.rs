//! The task of the tick: at every release, what is due becomes odometry. Only the inertial driver goes before it.
//!
//! Releases follow the grid of a recording; live sensors have grids of their own, and a reading releases the tick.

use super::super::tick::TickStage;
use super::shared::RunState;
use crate::schedule::ring::{Bell, Reader, Writer};
use crate::schedule::tasks::TaskId;
use crate::schedule::ticker::{Monotonic, Ticker};
use crate::schedule::times::Times;
use plumbline_drivers::ImuReading;
use plumbline_estimator::Estimate;
use serde::Serialize;
use std::time::Duration;

/// Releases are this much after the grid of the samples, so that each finds the sample of its own time, ns.
const PHASE_NS: i64 = 150_000;

/// A tick that answers requests sleeps on its bell until so long before a release: from then on on the release itself, which
/// is more exact.
const BEFORE_RELEASE: Duration = Duration::from_micros(300);

/// Counts and times of the task.
#[derive(Clone, Debug, Default, Serialize)]
pub struct TickTaskFigures {
    /// Releases.
    pub ticks: u64,
    /// Releases that passed unseen.
    pub ticks_missed: u64,
    /// Readings whose odometry was later than the task's deadline.
    pub deadline_misses: u64,
    /// Lateness of releases, ms.
    pub tick_late_ms: Times,
    /// From the time of a reading to its odometry, ms.
    pub sample_to_odometry_ms: Times,
    /// Most readings that waited.
    #[serde(skip)]
    pub deepest: usize,
}

/// Result of the task.
pub struct TickEnd {
    pub stage: TickStage,
    pub figures: TickTaskFigures,
}

/// The tick as a task.
pub struct TickTask {
    stage: TickStage,
    rings: TickRings,
    /// Arrival of the last reading.
    arrived: Monotonic,
    figures: TickTaskFigures,
}

/// Rings between the tick and the other tasks.
pub struct TickRings {
    pub readings: Reader<ImuReading>,
    pub corrections: Reader<Estimate>,
    /// To the front-end.
    pub samples: Writer<ImuReading>,
    /// Rung by the writers of the readers.
    pub bell: Bell,
}

impl TickTask {
    pub fn new(stage: TickStage, rings: TickRings) -> Self {
        Self { stage, rings, arrived: Monotonic::now(), figures: TickTaskFigures::default() }
    }

    /// Ticks until the readings end.
    pub fn run(mut self, shared: &RunState<'_>) -> TickEnd {
        if let Some(instants) = self.stage.instants() {
            self.rings.bell.listen();
            instants.ring_with(&self.rings.bell);
        }
        match shared.is_of_sensors() {
            true => self.tick_on_arrival(shared),
            false => self.tick_on_grid(shared),
        }
        self.stage.finish_instants();
        self.figures.deepest = self.rings.readings.deepest();
        TickEnd { stage: self.stage, figures: self.figures }
    }

    fn tick_on_grid(&mut self, shared: &RunState<'_>) {
        let first = shared.pace.origin.due.plus_nanos(PHASE_NS);
        let mut ticker = Ticker::new(first, shared.table.row(TaskId::Tick).period);
        while !shared.is_stopped() && !self.rings.readings.is_closed() {
            self.answer_until(&ticker, shared);
            let release = ticker.wait();
            shared.heartbeats.busy(TaskId::Tick);
            self.figures.ticks += 1;
            self.figures.ticks_missed += release.missed;
            self.figures.tick_late_ms.record(release.late_ms);
            self.take_due(shared);
        }
    }

    /// Wakes up for every reading, and once a period without: the watchdog, and systemd, hear of it while the sensor is
    /// away.
    fn tick_on_arrival(&mut self, shared: &RunState<'_>) {
        self.rings.bell.listen();
        let period = shared.table.row(TaskId::Tick).period;
        while !shared.is_stopped() && !self.rings.readings.is_closed() {
            let (TickRings { bell, readings, .. }, instants) = (&self.rings, self.stage.instants());
            let is_asked = || instants.is_some_and(|instants| instants.is_waiting());
            let _ = bell.wait(period, || (readings.peek().is_some() || is_asked()).then_some(()));
            shared.heartbeats.busy(TaskId::Tick);
            self.figures.ticks += 1;
            self.take_due(shared);
            self.stage.show_blind(Monotonic::now().0.saturating_sub(self.arrived.0));
        }
    }

    /// Answers what is asked for before the next release.
    fn answer_until(&mut self, ticker: &Ticker, shared: &RunState<'_>) {
        while let Some(instants) = self.stage.instants()
            && let Some(patience) = ticker.until_next().checked_sub(BEFORE_RELEASE)
            && self.rings.bell.wait(patience, || instants.is_waiting().then_some(())).is_some()
        {
            shared.heartbeats.busy(TaskId::Tick);
            self.stage.serve_instants();
        }
    }

    /// Takes every reading that is due, and what does not follow the one before: nothing waits for a stamp that is wrong.
    fn take_due(&mut self, shared: &RunState<'_>) {
        while let Some(estimate) = self.rings.corrections.pop() {
            self.stage.correct_later(estimate);
        }
        let deadline_ms = shared.table.row(TaskId::Tick).deadline.as_secs_f64() * 1e3;
        while let Some(reading) = self.rings.readings.peek().copied()
            && (shared.is_of_sensors()
                || shared.due(reading.sample.stamp) <= Monotonic::now()
                || !self.stage.expects(&reading))
        {
            self.rings.readings.pop();
            self.arrived = Monotonic::now();
            self.stage.take(&reading);
            let latency_ms = Monotonic::now().ms_since(shared.due(reading.sample.stamp));
            self.figures.sample_to_odometry_ms.record(latency_ms);
            self.figures.deadline_misses += u64::from(latency_ms > deadline_ms);
            // Full, it is a minute behind: the front-end is gone, and has been named by the watchdog.
            let _ = self.rings.samples.push(reading);
        }
        self.stage.serve_instants();
    }
}
