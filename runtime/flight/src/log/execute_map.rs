//! The map, executed again beside the estimates of a log.
//!
//! A frame is taken into the map when the next order of a frame has been read: by then the log has said whether it was
//! passed over. Where the odometry lies in the map is found for a frame when the recorded one has been read: by then the
//! log has said what took effect with it.

use crate::pipeline::places::PlaceChoice;
use plumbline_config::ValidConfig;
use plumbline_estimator::places::{MapEstimate, MapFollower, MapUpdate, Mapper, PlaceJob, PlaceMap};
use plumbline_estimator::{Estimate, Feedback, FrontEnd};
use plumbline_record::compare::Pairing;
use plumbline_record::digest::Digest;
use plumbline_record::{MapOrder, MapVerdict};
use std::collections::VecDeque;

/// Updates, and estimates, that may wait for what the log says of them.
const MAX_WAITING: usize = 4096;

/// The map of an execution.
pub struct MapExecution {
    mapper: Mapper,
    choice: PlaceChoice,
    job: PlaceJob,
    has_job: bool,
    updates: VecDeque<MapUpdate>,
    passed_over: VecDeque<u64>,
    applied: VecDeque<(u64, u64)>,
    estimates: VecDeque<Estimate>,
    /// The newest frame whose recorded output was read.
    recorded: Option<u64>,
    follower: MapFollower,
    is_ended: bool,
    /// Poses of the odometry in the map, of the log and of the execution.
    pub outputs: Pairing<MapEstimate>,
    /// Bits of all of the execution.
    pub digest: Digest,
}

impl MapExecution {
    /// Creates the execution for a flight with this configuration, which continued the keyframes of `known`; `None` if
    /// places were off.
    #[must_use]
    pub fn new(config: &ValidConfig, known: Option<PlaceMap>) -> Option<Self> {
        config.estimator.places.enabled.then(|| Self {
            mapper: Mapper::new(config.setup(), known),
            choice: PlaceChoice::default(),
            job: PlaceJob::new(config.setup()),
            has_job: false,
            updates: VecDeque::new(),
            passed_over: VecDeque::new(),
            applied: VecDeque::new(),
            estimates: VecDeque::new(),
            recorded: None,
            follower: MapFollower::default(),
            is_ended: false,
            outputs: Pairing::default(),
            digest: Digest::default(),
        })
    }

    /// A fault of the program ends it: what front-end and window had in hand when they died may have reached the map or not,
    /// and the log does not say.
    pub fn end(&mut self) {
        (self.is_ended, self.has_job) = (true, false);
        self.estimates.clear();
        self.outputs.forget();
    }

    /// Whether it has ended before the log.
    #[must_use]
    pub fn is_ended(&self) -> bool {
        self.is_ended
    }

    /// An order of the log.
    pub fn order(&mut self, order: &MapOrder) {
        if self.is_ended {
            return;
        }
        match order.verdict {
            MapVerdict::PassedOver => self.passed_over.push_back(order.frame),
            MapVerdict::Applied { at_frame } => self.applied.push_back((order.frame, at_frame)),
        }
    }

    /// The front-end has tracked a frame and heard `feedback` about the one before it.
    pub fn offer(&mut self, feedback: &Feedback, front_end: &mut FrontEnd) {
        if !self.is_ended && self.choice.takes(feedback) {
            self.job.describe(feedback);
            front_end.exchange_images(feedback.solved.sequence, &mut self.job.images);
            self.has_job = true;
        }
    }

    /// Takes the frame that waits into the map, unless it was passed over in flight.
    pub fn work(&mut self) {
        if !std::mem::take(&mut self.has_job) {
            return;
        }
        let frame = self.job.solved.sequence;
        if self.passed_over.front() == Some(&frame) {
            self.passed_over.pop_front();
            return;
        }
        let update = self.mapper.process(&self.job);
        if self.updates.len() < MAX_WAITING {
            self.updates.push_back(update);
        }
    }

    /// An estimate came out.
    pub fn executed(&mut self, estimate: &Estimate) {
        if !self.is_ended && self.estimates.len() < MAX_WAITING {
            self.estimates.push_back(estimate.clone());
        }
    }

    /// The next output of the log.
    pub fn recorded(&mut self, output: MapEstimate) {
        if !self.is_ended {
            self.recorded = Some(output.frame_sequence);
            self.outputs.recorded(output);
        }
    }

    /// Finds where the odometry lies in the map for all frames of which the log has said everything.
    ///
    /// # Errors
    /// When the log says that something took effect which was not found: what, in words.
    pub fn follow(&mut self) -> Result<(), String> {
        while let Some(recorded) = self.recorded
            && self.estimates.front().is_some_and(|e| e.frame_sequence <= recorded)
        {
            let Some(estimate) = self.estimates.pop_front() else { break };
            self.apply(estimate.frame_sequence)?;
            let output = self.follower.follow(&estimate);
            self.digest.add(&output);
            self.outputs.executed(output);
        }
        Ok(())
    }

    fn apply(&mut self, at: u64) -> Result<(), String> {
        while let Some(&(frame, at_frame)) = self.applied.front()
            && at_frame <= at
        {
            self.applied.pop_front();
            self.work_up_to(frame);
            let Some(update) = self.updates.pop_front().filter(|u| u.sequence == frame) else {
                return Err(format!("frame {frame} took effect in the map, but was not given to it"));
            };
            self.follower.apply(&update);
        }
        Ok(())
    }

    fn work_up_to(&mut self, frame: u64) {
        if self.has_job && self.job.solved.sequence <= frame {
            self.work();
        }
    }
}
