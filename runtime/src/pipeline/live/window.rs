//! The task that solves: a tracked frame in, an estimate out.

use super::super::stages::{Job, WindowStage};
use super::NAP;
use super::shared::Shared;
use crate::schedule::ring::{Bell, Reader, Writer};
use crate::schedule::tasks::TaskId;
use plumbline_estimator::places::MapUpdate;
use plumbline_estimator::{Estimate, Feedback};

/// What the task leaves.
pub struct WindowEnd {
    pub stage: WindowStage,
    /// Most frames that ever waited for it.
    pub deepest_frames: usize,
}

/// The window as a task.
pub struct WindowTask {
    pub stage: WindowStage,
    pub jobs: Reader<Job>,
    pub spare: Writer<Job>,
    pub blank: Reader<Feedback>,
    pub feedback: Writer<Feedback>,
    pub corrections: Writer<Estimate>,
    pub map_updates: Reader<MapUpdate>,
    pub bell: Bell,
}

impl WindowTask {
    /// Solves until the front-end has ended.
    pub fn run(mut self, shared: &Shared<'_>) -> WindowEnd {
        self.bell.listen();
        self.stage.figures.start();
        while let Some(job) = self.next_job() {
            shared.heartbeats.busy(TaskId::Window);
            while let Some(update) = self.map_updates.pop() {
                self.stage.update_map_later(update);
            }
            // There are as many as there are jobs.
            if let Some(mut feedback) = self.blank.pop() {
                let (estimate, cost) = self.stage.solve(&job, &mut feedback);
                shared.set_window_ms(cost.wall_ms);
                let _ = self.feedback.push(feedback);
                let _ = self.corrections.push(estimate);
            }
            let _ = self.spare.push(job);
            shared.heartbeats.idle(TaskId::Window);
        }
        WindowEnd { stage: self.stage, deepest_frames: self.jobs.deepest() }
    }

    fn next_job(&mut self) -> Option<Job> {
        let Self { jobs, bell, .. } = self;
        loop {
            if let Some(job) = bell.wait(NAP, || jobs.pop()) {
                return Some(job);
            }
            if jobs.is_closed() {
                return None;
            }
        }
    }
}
