//! The stage of places: keyframes in, what the map knows out. It works beside the flight, and nothing of the odometry
//! depends on it.
//!
//! Results for frame `k` take effect [`PLACES_DELAY_FRAMES`] frames later, however early they were ready, so that every
//! executor gives the same bits. In a live run they may take effect later still, or the frame be passed over when the one
//! before is not done: then that is an order ([`MapOrder`]), and an input of a re-execution.

use super::clock::Stopwatch;
use super::effect::Effect;
use super::listener::{Listener, ListenerView, Mapped};
use crate::schedule::times::Times;
use plumbline_config::ValidConfig;
use plumbline_estimator::places::mapper::SEARCH_EVERY_FRAMES;
use plumbline_estimator::places::{MapFollower, MapUpdate, Mapper, PlaceJob, PlaceMap};
use plumbline_estimator::{Estimate, Feedback};
use plumbline_record::digest::Digest;
use plumbline_record::{MapOrder, MapVerdict, Said};
use serde::Serialize;
use std::collections::VecDeque;

/// Frames from a keyframe to the first estimate that knows what was found with it: longer than the search takes.
pub const PLACES_DELAY_FRAMES: u64 = 6;
/// Updates that wait to take effect, at most.
const MAX_PENDING: usize = 16;

/// Choice of the frames that are given to the map, by the window's feedback.
#[derive(Debug, Default)]
pub struct PlaceChoice {
    last: Option<u64>,
}

impl PlaceChoice {
    /// True if the frame of `feedback` is one: a keyframe, or the first for a while.
    pub fn takes(&mut self, feedback: &Feedback) -> bool {
        let solved = &feedback.solved;
        let is_due = self.last.is_none_or(|last| solved.index >= last + SEARCH_EVERY_FRAMES);
        let is_taken = solved.pose_o_b.is_some() && (solved.is_keyframe || is_due);
        if is_taken {
            self.last = Some(solved.index);
        }
        is_taken
    }
}

/// Counts and times of the stage.
#[derive(Clone, Debug, Default, Serialize)]
pub struct PlacesFigures {
    /// Computation of each call, ms of wall time.
    #[serde(skip)]
    pub times_ms: Times,
    /// Keyframes in the map at the end.
    pub keyframes: u32,
    /// Places seen again.
    pub sightings: u32,
    /// Places that looked like one seen before, where the odometry speaks against it.
    pub contradicted: u32,
    /// Loops that count at the end.
    pub loops_used: u32,
    /// Frames that were passed over because the one before was not done.
    pub passed_over: u64,
    /// Updates that took effect later than the rule says.
    pub late: u64,
    /// SHA-256 over the bits of the pose of the odometry in the map, frame by frame.
    #[serde(rename = "map_digest")]
    pub digest: String,
}

/// The map with its figures.
pub struct PlacesStage {
    listener: Box<dyn Listener>,
    mapper: Mapper,
    times_ms: Times,
}

impl PlacesStage {
    /// Stage with everything allocated for the configuration; `None` where places are switched off.
    pub fn new(config: &ValidConfig, known: Option<PlaceMap>, listener: Box<dyn Listener>) -> Option<Self> {
        config.estimator.places.enabled.then(|| Self {
            listener,
            mapper: Mapper::new(config.setup(), known),
            times_ms: Times::default(),
        })
    }

    /// Takes a frame into account.
    pub fn work(&mut self, job: &PlaceJob) -> MapUpdate {
        let watch = Stopwatch::start();
        let update = self.mapper.process(job);
        self.times_ms.record(watch.elapsed_ms());
        self.listener.shown(ListenerView::Mapped(&Mapped { update: &update, mapper: &self.mapper }));
        update
    }

    /// The map, its graph solved to the end, and the times.
    #[must_use]
    pub fn into_end(mut self) -> (Mapper, Times) {
        self.mapper.finish();
        (self.mapper, self.times_ms)
    }
}

/// The pose of the odometry in the map, frame by frame. Runs where the window does.
pub struct MapStage {
    follower: MapFollower,
    effect: Effect,
    pending: VecDeque<MapUpdate>,
    /// Results that take effect by order: their frame, and the frame with whose estimate they do.
    ordered: VecDeque<(u64, u64)>,
    /// A frame that took effect by order, and was not given to the map.
    missing: Option<u64>,
    /// Nothing is known of it any more.
    is_ended: bool,
    /// Estimates so far.
    frames: u64,
    digest: Digest,
    late: u64,
    newest: Option<MapUpdate>,
}

impl MapStage {
    /// A map of which nothing is known yet.
    pub fn new(effect: Effect) -> Self {
        Self {
            follower: MapFollower::default(),
            effect,
            pending: VecDeque::with_capacity(MAX_PENDING),
            ordered: VecDeque::new(),
            missing: None,
            is_ended: false,
            frames: 0,
            digest: Digest::default(),
            late: 0,
            newest: None,
        }
    }

    /// Orders the results of `frame` to take effect with the estimate of `at_frame`.
    pub fn apply_by(&mut self, frame: u64, at_frame: u64) {
        self.ordered.push_back((frame, at_frame));
    }

    /// The frame that an order named and the map was not given.
    pub fn missing(&self) -> Option<u64> {
        self.missing
    }

    /// Ends it: what comes now is not known.
    pub fn end(&mut self) {
        self.is_ended = true;
    }

    /// SHA-256 over the bits so far; `None` where it has ended before the flight.
    pub fn digest(&self) -> Option<String> {
        (!self.is_ended).then(|| self.digest.hex())
    }

    /// The next update that takes effect with frame `index`, whose number is `sequence`.
    fn due(&mut self, index: u64, sequence: u64) -> Option<MapUpdate> {
        match self.effect {
            Effect::ByRule => self.pending.pop_front_if(|update| index >= update.index + PLACES_DELAY_FRAMES),
            Effect::ByOrder => {
                let (frame, _) = self.ordered.pop_front_if(|(_, at_frame)| *at_frame <= sequence)?;
                let update = self.pending.pop_front_if(|update| update.sequence == frame);
                self.missing = self.missing.or(update.is_none().then_some(frame));
                update
            }
        }
    }

    /// Keeps an update until it is to take effect.
    pub fn update_later(&mut self, update: MapUpdate) {
        if self.pending.len() == MAX_PENDING {
            self.pending.pop_front();
        }
        self.pending.push_back(update);
    }

    /// Lets the updates take effect that are due, and tells of the map as of `estimate`.
    pub fn follow(&mut self, estimate: &Estimate, listener: &mut dyn Listener) {
        if self.is_ended {
            return;
        }
        let index = self.frames;
        self.frames += 1;
        while let Some(update) = self.due(index, estimate.frame_sequence) {
            self.late += u64::from(index > update.index + PLACES_DELAY_FRAMES);
            self.follower.apply(&update);
            self.newest = Some(update);
            let verdict = MapVerdict::Applied { at_frame: estimate.frame_sequence };
            listener.said(&Said::MapOrder(MapOrder { frame: update.sequence, verdict }));
        }
        let map_estimate = self.follower.follow(estimate);
        self.digest.add(&map_estimate);
        listener.said(&Said::MapEstimate(map_estimate));
    }

    /// Figures of the whole stage, with the times of the map.
    pub fn figures(&self, times_ms: Times, passed_over: u64, mapper: &Mapper) -> PlacesFigures {
        PlacesFigures {
            times_ms,
            keyframes: mapper.map().len() as u32,
            sightings: mapper.sightings(),
            contradicted: mapper.contradicted(),
            loops_used: mapper.loops_used(),
            passed_over,
            late: self.late,
            digest: self.digest.hex(),
        }
    }
}
