//! The executor of virtual time: as fast as it goes, in the order that the rule gives.
//!
//! Frame `k + 1` is tracked while the window solves frame `k`, on two threads or in turn: the front-end never
//! sees what the other finds until both are done. Readings beyond the frame that is being solved wait until
//! its estimate can correct them.

use super::listener::{Producer, Subscriber};
use super::places::{PlaceChoice, PlacesStage};
use super::stages::{self, FrontStage, Job, WindowStage};
use super::team::Team;
use super::tick::{CORRECTION_DELAY_NS, TickStage};
use super::{Control, DriverFaults, Outcome, PlacesEnd, RunError, RunOptions, Streams};
use crate::schedule::ladder::Rung;
use plumbline_config::options::image_sizes;
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_drivers::{DriverError, ImuReading, ImuSource, Prefetch, StereoFrame, StereoSource};
use plumbline_estimator::places::{PlaceJob, PlaceMap};
use plumbline_estimator::{Estimate, Feedback, Fork};
use std::collections::VecDeque;

/// Readings that wait for an estimate, at most: then the window does not wait for another frame.
const MAX_WAITING: usize = 256;

/// One estimator over one pair of streams.
pub struct InOrder<'a> {
    front: FrontStage,
    window: WindowStage,
    tick: TickStage,
    team: &'a Team,
    /// The frame that the window has yet to solve, if `is_in_flight`.
    in_flight: Job,
    is_in_flight: bool,
    /// Room for the frame after it.
    next: Job,
    feedback: Feedback,
    places: Option<Places>,
    /// Readings that wait, each with the newest time that is believed of them.
    waiting: VecDeque<(ImuReading, Timestamp)>,
    /// Readings in a frame's time.
    readings_per_frame: usize,
    newest_imu: Timestamp,
}

/// The map, with room for a frame on its way there.
struct Places {
    stage: PlacesStage,
    choice: PlaceChoice,
    job: PlaceJob,
}

impl<'a> InOrder<'a> {
    /// Everything allocated for the configuration. The map goes on with the keyframes of `known`.
    #[must_use]
    pub fn new(
        config: &ValidConfig,
        known: Option<PlaceMap>,
        team: &'a Team,
        subscriber: &mut dyn Subscriber,
    ) -> Self {
        let stage = PlacesStage::new(config, known, subscriber.listener(Producer::Places));
        Self {
            places: stage.map(|stage| Places {
                stage,
                choice: PlaceChoice::default(),
                job: PlaceJob::new(config.setup()),
            }),
            front: FrontStage::new(config, subscriber.listener(Producer::FrontEnd)),
            window: WindowStage::new(config, subscriber.listener(Producer::Window)),
            tick: TickStage::new(config, subscriber.listener(Producer::Tick)),
            team,
            in_flight: Job::new(config),
            is_in_flight: false,
            next: Job::new(config),
            feedback: Feedback::new(config.setup()),
            waiting: VecDeque::with_capacity(MAX_WAITING),
            readings_per_frame: (config.imu.rate_hz / config.camera[0].rate_hz).ceil() as usize,
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
        Streams { mut imu, stereo, first_reset_counter, .. }: Streams,
        options: &RunOptions,
        control: &Control,
    ) -> Result<Outcome, RunError> {
        let sizes_px = image_sizes(&config.camera);
        let mut stereo: Box<dyn StereoSource> = match options.threads {
            0 | 1 => stereo,
            _ => Box::new(Prefetch::new(stereo, sizes_px, config.driver.image_queue)?),
        };
        let mut frame = StereoFrame::new(sizes_px);
        self.window.count_resets_from(first_reset_counter);
        self.window.figures.start();
        while !control.is_stopped() && stereo.next_frame(&mut frame)? {
            self.feed_for(imu.as_mut(), frame.stamp)?;
            if let Some(kind) = control.take_reset() {
                self.front.reset(kind, frame.sequence);
            }
            self.step(Some(&frame));
            self.front.release(&mut frame);
        }
        self.step(None);
        while self.feed_one(imu.as_mut())? {}
        let places = self.places.take().map(|places| PlacesEnd::new(places.stage, &self.window, 0));
        Ok(Outcome {
            places,
            figures: stages::total(&self.front, &self.window, &self.tick, self.team),
            estimate_digest: self.window.digest(),
            odometry_digest: self.tick.digest(),
            faults: DriverFaults { imu: imu.faults(), cameras: stereo.faults() },
            live: None,
        })
    }

    /// Takes the readings that a frame needs; for one whose stamp is not believed, as many as come in a frame's time.
    fn feed_for(&mut self, imu: &mut dyn ImuSource, image_stamp: Timestamp) -> Result<(), DriverError> {
        if self.front.expects(image_stamp) {
            let needed = self.front.needed_until(image_stamp);
            return self.feed(imu, needed);
        }
        for _ in 0..self.readings_per_frame {
            if !self.feed_one(imu)? {
                break;
            }
        }
        Ok(())
    }

    /// Takes readings until one reaches `needed`.
    fn feed(&mut self, imu: &mut dyn ImuSource, needed: Timestamp) -> Result<(), DriverError> {
        let mut newest = self.newest_imu;
        // Where the clock is set back meanwhile, what is needed never comes.
        while (newest..needed).contains(&self.newest_imu) && self.feed_one(imu)? {
            newest = newest.max(self.newest_imu);
        }
        Ok(())
    }

    /// Takes the next reading; `false` when there is none.
    fn feed_one(&mut self, imu: &mut dyn ImuSource) -> Result<bool, DriverError> {
        let Some(reading) = imu.next_reading()? else { return Ok(false) };
        if self.front.add(&reading) {
            self.newest_imu = reading.sample.stamp;
        }
        self.tick_or_wait(reading);
        Ok(true)
    }

    /// Gives the frame that was solved to the map.
    fn map(&mut self) {
        let Self { front, window, feedback, places: Some(places), .. } = self else { return };
        if places.choice.takes(feedback) {
            front.fill_place_job(&mut places.job, feedback);
            window.update_map_later(places.stage.work(&places.job));
        }
    }

    /// A reading is ticked when no estimate that would correct it is still to come.
    fn tick_or_wait(&mut self, reading: ImuReading) {
        if self.waiting.len() == MAX_WAITING {
            self.step(None);
        }
        self.waiting.push_back((reading, self.newest_imu));
        self.tick_waiting();
    }

    fn tick_waiting(&mut self) {
        let until =
            self.is_in_flight.then(|| self.in_flight.tracked.time.stamp.plus_nanos(CORRECTION_DELAY_NS));
        while let Some((reading, time)) = self.waiting.front()
            && until.is_none_or(|until| *time < until)
        {
            self.tick.take(reading);
            self.waiting.pop_front();
        }
    }

    /// Tracks `frame` while the window solves the one before it.
    fn step(&mut self, frame: Option<&StereoFrame>) {
        let Self { front, window, feedback, in_flight, is_in_flight, next, team, .. } = self;
        let mut solved: Option<Estimate> = None;
        team.join(
            &mut || {
                if let Some(frame) = frame {
                    front.track(frame, Rung::Full, *team, next);
                }
            },
            &mut || solved = is_in_flight.then(|| window.solve(in_flight, feedback).0),
        );
        if let Some(estimate) = solved {
            self.front.apply_feedback(&self.feedback);
            self.tick.correct_later(estimate);
            // The front-end holds the images of the frame that was solved when it has tracked another.
            if frame.is_some() {
                self.map();
            }
        }
        std::mem::swap(&mut self.in_flight, &mut self.next);
        self.is_in_flight = frame.is_some();
        self.tick_waiting();
    }
}
