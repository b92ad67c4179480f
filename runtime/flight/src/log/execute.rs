//! Runs the estimator again over the inputs of a log, in the order that the log gives.
//!
//! Two machines go through the same readings: the odometry, which is given one after the other and the
//! corrections in between, and the estimator, which is given each frame after as many readings as it had
//! then. They meet where an estimate takes effect. Nothing of the recorded outputs enters: they are only
//! handed to the comparison.

use super::channel::Channel;
use super::cursor::Cursor;
use super::execute_map::MapExecution;
use super::{LogError, image};
use crate::schedule::ladder::Rung;
use plumbline_config::Timestamp;
use plumbline_config::options::image_sizes;
use plumbline_drivers::{ImuReading, StereoFrame, StereoSource};
use plumbline_estimator::places::PlaceMap;
use plumbline_estimator::{
    Estimate, Feedback, FrameInput, FrontEnd, InTurn, Odometer, Odometry, Propagator, Tracked,
};
use plumbline_record::compare::Pairing;
use plumbline_record::digest::Digest;
use plumbline_record::parts::FrameAbout;
use plumbline_record::{CorrectionOrder, FrameOrder, MapOrder, ResetOrder, Verdict};
use std::collections::VecDeque;

/// Estimates that may wait to take effect.
const MAX_PENDING: usize = 256;

/// A run from a log.
pub struct Execution {
    log: Cursor,
    images: Option<Box<dyn StereoSource>>,
    front_end: FrontEnd,
    odometer: Odometer,
    tracked: Tracked,
    feedback: Feedback,
    /// The map, where places were switched on.
    pub map: Option<MapExecution>,
    propagator: Propagator,
    readings: Readings,
    /// Readings that the odometry was given.
    ticked: u64,
    /// Readings that the estimator was given.
    fed: u64,
    correction: Option<CorrectionOrder>,
    reset: Option<ResetOrder>,
    pending: VecDeque<Estimate>,
    /// The newest estimate, and the newest that has a pose.
    newest: Option<Estimate>,
    newest_pose: Option<Estimate>,
    /// First and last reading.
    span: Option<(Timestamp, Timestamp)>,
    /// What the recorder says is missing.
    gap: Option<String>,
    frame: StereoFrame,
    /// Estimates of the log and of the execution.
    pub estimates: Pairing<Estimate>,
    /// Odometry of the log and of the execution.
    pub odometry: Pairing<Odometry>,
    /// Bits of all estimates of the execution.
    pub estimate_digest: Digest,
    /// Bits of all odometry of the execution.
    pub odometry_digest: Digest,
    /// Frames that were refused in flight.
    pub refused: u64,
}

/// Readings that one of the two machines has still to be given.
#[derive(Default)]
struct Readings {
    held: VecDeque<ImuReading>,
    first: u64,
}

impl Readings {
    /// Reading `index` of the run, read from the log if need be; `None` after the last.
    fn get(&mut self, index: u64, log: &mut Cursor) -> Result<Option<ImuReading>, LogError> {
        while self.first + self.held.len() as u64 <= index {
            match log.next(Channel::Imu)? {
                Some(reading) => self.held.push_back(reading),
                None => return Ok(None),
            }
        }
        let place = usize::try_from(index.saturating_sub(self.first)).unwrap_or(usize::MAX);
        Ok(self.held.get(place).copied())
    }

    fn forget_before(&mut self, index: u64) {
        while self.first < index && self.held.pop_front().is_some() {
            self.first += 1;
        }
    }
}

impl Execution {
    /// Creates the execution of the log at the beginning of `log`, with the images of a data set or its own, and the
    /// map that the flight continued.
    #[must_use]
    pub fn new(log: Cursor, images: Option<Box<dyn StereoSource>>, known: Option<PlaceMap>) -> Self {
        let config = &log.reader().about().config;
        let frame = StereoFrame::new(image_sizes(&config.camera));
        let mut odometer = Odometer::new(config.setup());
        odometer.count_resets_from(log.reader().about().first_reset_counter);
        Self {
            front_end: FrontEnd::new(config.setup()),
            odometer,
            tracked: Tracked::new(config.setup()),
            feedback: Feedback::new(config.setup()),
            map: MapExecution::new(config, known),
            propagator: Propagator::new(config.setup()),
            log,
            images,
            readings: Readings::default(),
            ticked: 0,
            fed: 0,
            correction: None,
            reset: None,
            pending: VecDeque::new(),
            newest: None,
            newest_pose: None,
            span: None,
            gap: None,
            frame,
            estimates: Pairing::default(),
            odometry: Pairing::default(),
            estimate_digest: Digest::default(),
            odometry_digest: Digest::default(),
            refused: 0,
        }
    }

    /// The log.
    #[must_use]
    pub fn log(&self) -> &Cursor {
        &self.log
    }

    /// Readings executed so far.
    #[must_use]
    pub fn readings(&self) -> u64 {
        self.ticked
    }

    /// Executes the next reading and all that it brings with it; `false` when the log has no more, or at
    /// the first difference.
    ///
    /// # Errors
    /// When the log cannot be read, lacks an input, or holds orders that cannot be followed.
    pub fn step(&mut self) -> Result<bool, LogError> {
        let reading = self.readings.get(self.ticked, &mut self.log)?;
        if self.lacks_input() {
            return Ok(false);
        }
        self.take_outputs()?;
        let Some(reading) = reading else {
            self.finish()?;
            return Ok(false);
        };
        let stamp = reading.sample.stamp;
        self.span = Some(self.span.map_or((stamp, stamp), |(first, _)| (first, stamp)));
        self.correct()?;
        let odometry = self.propagator.tick(&reading.sample);
        self.ticked += 1;
        if let Some(odometry) = odometry {
            self.odometry_digest.add(&odometry);
            self.odometry.executed(odometry);
        }
        while self.log.peek_order()?.is_some_and(|order| order.readings_before <= self.ticked) {
            if !self.follow_next()? {
                break;
            }
        }
        self.readings.forget_before(self.ticked.min(self.fed));
        let is_same_map = self.map.as_ref().is_none_or(|map| map.outputs.difference.is_none());
        Ok(self.estimates.difference.is_none() && self.odometry.difference.is_none() && is_same_map)
    }

    /// The frames after the last reading.
    fn finish(&mut self) -> Result<(), LogError> {
        while self.follow_next()? {}
        if let Some(map) = &mut self.map {
            map.work();
        }
        self.take_outputs()
    }

    /// A log that lacks an input ends the execution: what comes after it cannot be made again.
    fn lacks_input(&mut self) -> bool {
        let dropped = self.log.reader().dropped();
        if dropped.inputs() > 0 && self.gap.is_none() {
            self.gap = Some(format!(
                "the recorder dropped {dropped} there, so the rest cannot be executed again; record with longer queues \
                 (recorder.queue_entries, recorder.queue_frames) or smaller images"
            ));
        }
        self.gap.is_some()
    }

    /// Why the execution ended before the log, if it did.
    #[must_use]
    pub fn break_off(&self) -> Option<&str> {
        self.gap.as_deref().or(self.log.damage())
    }

    /// Time of data that was executed, s.
    #[must_use]
    pub fn span_s(&self) -> f64 {
        self.span.map_or(0.0, |(first, last)| last.seconds_since(first))
    }

    /// Hands the recorded outputs that were read to the comparison.
    fn take_outputs(&mut self) -> Result<(), LogError> {
        while let Some(estimate) = self.log.next_waiting(Channel::Estimate)? {
            self.estimates.recorded(estimate);
        }
        while let Some(odometry) = self.log.next_waiting(Channel::Odometry)? {
            self.odometry.recorded(odometry);
        }
        self.take_map_outputs()
    }

    /// Hands what the log says of the map to its execution.
    fn take_map_outputs(&mut self) -> Result<(), LogError> {
        self.take_map_orders()?;
        let Some(map) = &mut self.map else { return Ok(()) };
        while let Some(output) = self.log.next_waiting(Channel::MapEstimate)? {
            map.recorded(output);
        }
        map.follow().map_err(|reason| LogError::unusable(self.log.reader().path(), reason))
    }

    fn take_map_orders(&mut self) -> Result<(), LogError> {
        let Some(map) = &mut self.map else { return Ok(()) };
        while let Some(order) = self.log.next_waiting::<MapOrder>(Channel::MapOrder)? {
            map.order(&order);
        }
        Ok(())
    }

    /// The corrections that come before the next reading.
    fn correct(&mut self) -> Result<(), LogError> {
        loop {
            if self.correction.is_none() {
                self.correction = self.log.next_waiting(Channel::CorrectionOrder)?;
            }
            let Some(order) = self.correction.filter(|order| order.readings_before <= self.ticked) else {
                return Ok(());
            };
            self.correction = None;
            if order.readings_before < self.ticked {
                return Err(self.unusable(format!("the correction by frame {} comes too late", order.frame)));
            }
            if !self.estimate_up_to(order.frame)? {
                return Ok(());
            }
            let Some(estimate) = self.pending.pop_front().filter(|e| e.frame_sequence == order.frame) else {
                let reason = format!("frame {} corrects the odometry, but was not estimated", order.frame);
                return Err(self.unusable(reason));
            };
            self.propagator.correct(&estimate);
        }
    }

    /// Follows orders until the estimate of `frame` is the first that waits; `false` when the log ends
    /// before it.
    fn estimate_up_to(&mut self, frame: u64) -> Result<bool, LogError> {
        loop {
            while self.pending.front().is_some_and(|estimate| estimate.frame_sequence < frame) {
                self.pending.pop_front();
            }
            if !self.pending.is_empty() {
                return Ok(true);
            }
            if !self.follow_next()? {
                return Ok(false);
            }
        }
    }

    /// Follows the next order of a frame; `false` when the log ends before it can be followed.
    fn follow_next(&mut self) -> Result<bool, LogError> {
        let Some(order) = self.log.next::<FrameOrder>(Channel::FrameOrder)? else { return Ok(false) };
        self.take_map_orders()?;
        if let Some(map) = &mut self.map {
            map.work();
        }
        self.reset_before(order.frame, true)?;
        if order.readings_before < self.fed {
            return Err(self.unusable(format!("the order of frame {} comes too late", order.frame)));
        }
        while self.fed < order.readings_before {
            let Some(reading) = self.readings.get(self.fed, &mut self.log)? else { return Ok(false) };
            self.front_end.add_imu(&reading.sample);
            self.fed += 1;
        }
        self.reset_before(order.frame, false)?;
        let Verdict::Taken { level } = order.verdict else {
            self.refused += 1;
            return Ok(true);
        };
        if self.log.is_lost(order.frame)? {
            return Ok(true);
        }
        if !self.find_frame(order.frame)? {
            return Ok(false);
        }
        let estimate = self.estimate(level)?;
        self.estimate_digest.add(&estimate);
        self.newest = Some(estimate.clone());
        if estimate.has_pose() {
            self.newest_pose.clone_from(&self.newest);
        }
        self.pending.push_back(estimate.clone());
        if self.pending.len() > MAX_PENDING {
            self.pending.pop_front();
        }
        if let Some(map) = &mut self.map {
            map.executed(&estimate);
        }
        self.estimates.executed(estimate);
        Ok(true)
    }

    /// The estimate after the frame that was found, with the work of a rung of the ladder.
    fn estimate(&mut self, level: u8) -> Result<Estimate, LogError> {
        let Some(rung) = Rung::of_level(level) else {
            return Err(self.unusable(format!(
                "frame {} was estimated at level {level}, which this build does not have; verify with the build \
                 that recorded it",
                self.frame.sequence
            )));
        };
        let images = [self.frame.image(0), self.frame.image(1)];
        let input = FrameInput::new(self.frame.stamp, images).numbered(self.frame.sequence);
        let Self { front_end, odometer, tracked, feedback, map, .. } = self;
        front_end.track(&input, &rung.budget(), &InTurn, [&mut (), &mut ()], tracked);
        // That of the frame before: see `plumbline_estimator::exchange`.
        front_end.apply_feedback(feedback);
        if let Some(map) = map {
            map.offer(feedback, front_end);
        }
        Ok(odometer.process(tracked, &mut (), feedback))
    }

    /// Follows the resets before a frame: a fresh start before the samples since the last frame are given, one that was asked for
    /// when they have been, as in flight.
    fn reset_before(&mut self, frame: u64, is_renewal: bool) -> Result<(), LogError> {
        loop {
            if self.reset.is_none() {
                self.reset = self.log.next_waiting(Channel::ResetOrder)?;
            }
            let Some(order) = self.reset.filter(|o| o.before_frame <= frame && o.is_renewal == is_renewal)
            else {
                return Ok(());
            };
            self.reset = None;
            if order.is_renewal {
                self.renew();
            } else {
                self.front_end.reset(order.kind);
            }
        }
    }

    /// Makes front-end and window anew, as the flight did after a fault.
    fn renew(&mut self) {
        let setup = self.log.reader().about().config.setup().clone();
        self.front_end = FrontEnd::new(&setup);
        self.odometer.renew(&setup, self.newest.as_ref(), self.newest_pose.as_ref());
        self.feedback = Feedback::new(&setup);
        if let Some(map) = &mut self.map {
            map.end();
        }
    }

    /// Reads frames up to number `sequence`; `false` when the log ends before it.
    fn find_frame(&mut self, sequence: u64) -> Result<bool, LogError> {
        loop {
            let Some(description) = self.log.next_frame(&mut self.frame)? else { return Ok(false) };
            if description.sequence > sequence {
                return Err(self.unusable(format!("frame {sequence} was estimated, but is not in the log")));
            }
            if description.sequence < sequence {
                continue;
            }
            if self.images.is_some() {
                self.find_images(&description)?;
            }
            return Ok(true);
        }
    }

    /// Takes the images of the frame from the data set.
    fn find_images(&mut self, description: &FrameAbout) -> Result<(), LogError> {
        let sequence = description.sequence;
        let Some(images) = &mut self.images else { return Ok(()) };
        let stamp = self.frame.stamp;
        loop {
            if !images.next_frame(&mut self.frame)? || self.frame.sequence > sequence {
                return Err(self.unusable(format!("frame {sequence} is not in the data set of --images")));
            }
            if self.frame.sequence == sequence {
                break;
            }
        }
        self.frame.stamp = stamp;
        for (camera, image) in [&description.left, &description.right].into_iter().enumerate() {
            let Some(image) = image else {
                self.frame.valid[camera] = false;
                continue;
            };
            let sound = match self.frame.valid[camera] {
                true => image::check(&self.frame.images[camera], image),
                false => Err("its image is missing"),
            };
            sound.map_err(|e| {
                self.unusable(format!("frame {sequence} of the data set of --images is another: {e}"))
            })?;
        }
        Ok(())
    }

    fn unusable(&self, reason: String) -> LogError {
        LogError::unusable(self.log.reader().path(), reason)
    }

    /// Reads the rest of the log, for how it ends.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn read_to_end(&mut self) -> Result<(), LogError> {
        self.log.read_to_end()
    }
}
