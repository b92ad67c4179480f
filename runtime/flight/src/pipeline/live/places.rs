//! The task of the map: works beside the flight, below everything that a frame needs.

use super::super::places::{PlaceChoice, PlacesStage};
use super::super::stages::FrontStage;
use super::NAP;
use super::shared::RunState;
use crate::schedule::ring::{Bell, Reader, Writer};
use crate::schedule::tasks::TaskId;
use plumbline_estimator::Feedback;
use plumbline_estimator::places::{MapUpdate, PlaceJob};

/// The front-end's end: frames to the map, and their buffers back.
pub struct PlacesRings {
    pub jobs: Writer<PlaceJob>,
    pub spare: Reader<PlaceJob>,
    pub choice: PlaceChoice,
}

impl PlacesRings {
    /// Gives the frame that `feedback` is about to the map, if it is one for it; `false` when the map has fallen behind,
    /// and it is passed over.
    pub fn offer(&mut self, shared: &RunState<'_>, feedback: &Feedback, front: &mut FrontStage) -> bool {
        if !self.choice.takes(feedback) {
            return true;
        }
        let Some(mut job) = self.spare.pop() else {
            front.pass_over_place(feedback.solved.sequence);
            return false;
        };
        front.fill_place_job(&mut job, feedback);
        shared.heartbeats.give(TaskId::Places);
        let _ = self.jobs.push(job);
        true
    }
}

/// The map as a task.
pub struct PlacesTask {
    pub stage: PlacesStage,
    pub jobs: Reader<PlaceJob>,
    pub spare: Writer<PlaceJob>,
    pub updates: Writer<MapUpdate>,
    pub bell: Bell,
}

impl PlacesTask {
    /// Works until the front-end has ended.
    pub fn run(mut self, shared: &RunState<'_>) -> PlacesStage {
        self.bell.listen();
        while let Some(job) = self.jobs.next(&self.bell, NAP) {
            shared.heartbeats.busy(TaskId::Places);
            let update = self.stage.work(&job);
            // A window that has gone wants no more.
            let _ = self.updates.push(update);
            let _ = self.spare.push(job);
            shared.heartbeats.idle(TaskId::Places);
        }
        self.stage
    }
}
