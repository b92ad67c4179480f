//! The executor of virtual time: as fast as it goes, in the order that the rule gives.
//!
//! Frame `k + 1` is tracked while the window solves frame `k`, on two threads or in turn: the front-end never
//! sees what the other finds until both are done. Readings beyond the frame that is being solved wait until
//! its estimate can correct them.

use super::figures::Figures;
use super::stages::{Cost, FrontStage, Job, WindowStage};
use super::tap::Tap;
use super::team::Team;
use super::tick::{CORRECTION_DELAY_NS, TickStage};
use super::{Control, Outcome, RunError, RunOptions, Sink, Streams, sizes_of};
use crate::schedule::ladder::Rung;
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_drivers::{DriverError, ImuReading, ImuSource, Prefetch, StereoFrame, StereoSource};
use plumbline_estimator::{Estimate, Feedback, Fork};
use std::collections::VecDeque;

/// Readings that wait for an estimate, at most: then the window does not wait for another frame.
const MAX_WAITING: usize = 256;

/// One estimator over one pair of streams.
pub struct InOrder<'a> {
    front: FrontStage,
    window: WindowStage,
    tick: TickStage,
    figures: Figures,
    team: &'a Team,
    /// The frame that the window has yet to solve, if `is_in_flight`.
    in_flight: Job,
    is_in_flight: bool,
    /// Room for the frame after it.
    next: Job,
    feedback: Feedback,
    waiting: VecDeque<ImuReading>,
    newest_imu: Timestamp,
}

impl<'a> InOrder<'a> {
    /// Everything allocated for the configuration.
    #[must_use]
    pub fn new(config: &ValidConfig, team: &'a Team, tap: &dyn Tap) -> Self {
        Self {
            front: FrontStage::new(config, tap.another()),
            window: WindowStage::new(config, tap.another()),
            tick: TickStage::new(config, tap.another()),
            figures: Figures::default(),
            team,
            in_flight: Job::new(config),
            is_in_flight: false,
            next: Job::new(config),
            feedback: Feedback::new(config.setup()),
            waiting: VecDeque::with_capacity(MAX_WAITING),
            newest_imu: Timestamp::MIN,
        }
    }

    /// Runs both streams to their end, or until `control` says so.
    ///
    /// # Errors
    /// When a driver cannot go on.
    pub fn run(
        mut self,
        config: &ValidConfig,
        Streams { mut imu, stereo }: Streams,
        options: &RunOptions,
        control: &Control,
        sink: &mut dyn Sink,
    ) -> Result<Outcome, RunError> {
        let sizes_px = sizes_of(config);
        let mut stereo: Box<dyn StereoSource> = match options.threads {
            0 | 1 => stereo,
            _ => Box::new(Prefetch::new(stereo, sizes_px, config.driver.image_queue)?),
        };
        let mut frame = StereoFrame::new(sizes_px);
        self.figures.start();
        while !control.is_stopped() && stereo.next_frame(&mut frame)? {
            let needed = self.front.needed_until(frame.stamp);
            self.feed(imu.as_mut(), needed, sink)?;
            if let Some(kind) = control.take_reset() {
                self.front.reset(kind, frame.sequence);
            }
            self.step(Some(&frame), sink);
            self.front.release(&mut frame);
        }
        self.step(None, sink);
        self.feed(imu.as_mut(), Timestamp::MAX, sink)?;
        self.figures.finish();
        self.figures.add_stages(&self.front, &self.window, &self.tick);
        self.figures.hot_path_allocations += self.team.allocations();
        Ok(Outcome {
            figures: self.figures,
            estimate_digest: self.window.digest(),
            odometry_digest: self.tick.digest(),
            faults: (imu.faults(), stereo.faults()),
            live: None,
        })
    }

    /// Takes readings until one reaches `needed`.
    fn feed(
        &mut self,
        imu: &mut dyn ImuSource,
        needed: Timestamp,
        sink: &mut dyn Sink,
    ) -> Result<(), DriverError> {
        while self.newest_imu < needed {
            let Some(reading) = imu.next_reading()? else { break };
            self.newest_imu = self.newest_imu.max(reading.sample.stamp);
            self.front.add(&reading);
            self.tick_or_wait(reading, sink);
        }
        Ok(())
    }

    /// A reading is ticked when no estimate that would correct it is still to come.
    fn tick_or_wait(&mut self, reading: ImuReading, sink: &mut dyn Sink) {
        if self.waiting.len() == MAX_WAITING {
            self.step(None, sink);
        }
        self.waiting.push_back(reading);
        self.tick_waiting(sink);
    }

    fn tick_waiting(&mut self, sink: &mut dyn Sink) {
        let until =
            self.is_in_flight.then(|| self.in_flight.tracked.time.stamp.plus_nanos(CORRECTION_DELAY_NS));
        while let Some(reading) = self.waiting.front()
            && until.is_none_or(|until| reading.sample.stamp < until)
        {
            if let Some(odometry) = self.tick.take(reading) {
                sink.odometry(&odometry);
            }
            self.waiting.pop_front();
        }
    }

    /// Tracks `frame` while the window solves the one before it.
    fn step(&mut self, frame: Option<&StereoFrame>, sink: &mut dyn Sink) {
        let Self { front, window, feedback, in_flight, is_in_flight, next, team, .. } = self;
        let mut solved: Option<(Estimate, Cost)> = None;
        team.join(
            &mut || {
                if let Some(frame) = frame {
                    front.track(frame, Rung::Full, *team, next);
                }
            },
            &mut || solved = is_in_flight.then(|| window.solve(&in_flight.tracked, feedback)),
        );
        if let Some((estimate, cost)) = solved {
            self.front.apply_feedback(&self.feedback);
            self.finish(estimate, cost, sink);
        }
        std::mem::swap(&mut self.in_flight, &mut self.next);
        self.is_in_flight = frame.is_some();
        self.tick_waiting(sink);
    }

    fn finish(&mut self, estimate: Estimate, cost: Cost, sink: &mut dyn Sink) {
        let cost = cost.plus(self.in_flight.cost);
        self.figures.frame(&estimate, cost);
        sink.estimate(&estimate, cost.wall_ms);
        self.tick.correct_later(estimate);
    }
}
