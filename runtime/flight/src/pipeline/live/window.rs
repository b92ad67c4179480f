//! The task that solves: a tracked frame in, an estimate out.

use super::super::stages::{Job, WindowStage};
use super::NAP;
use super::shared::RunState;
use crate::schedule::ring::{Bell, Reader, Writer};
use crate::schedule::tasks::TaskId;
use plumbline_estimator::places::MapUpdate;
use plumbline_estimator::{Estimate, Feedback};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Result of the task.
pub struct WindowEnd {
    pub stage: WindowStage,
    /// Most frames that ever waited for it.
    pub deepest_frames: usize,
}

/// Rings between the window and the other tasks.
pub struct WindowRings {
    pub jobs: Reader<Job>,
    pub spare: Writer<Job>,
    pub blank: Reader<Feedback>,
    pub feedback: Writer<Feedback>,
    pub corrections: Writer<Estimate>,
    pub map_updates: Reader<MapUpdate>,
    pub bell: Bell,
}

/// The window as a task.
pub struct WindowTask {
    stage: WindowStage,
    rings: WindowRings,
    /// In hand, where a fault does not lose them.
    job: Option<Job>,
    feedback: Option<Feedback>,
    /// It has ended by a fault of its own, and waits for a fresh start.
    is_down: bool,
    /// It has begun anew, and there is no pose yet: the odometry goes on by the IMU, from the last one.
    awaits_pose: bool,
}

impl WindowTask {
    pub fn new(stage: WindowStage, rings: WindowRings) -> Self {
        Self { stage, rings, job: None, feedback: None, is_down: false, awaits_pose: false }
    }

    /// Solves until the front-end has ended. After a fault of its own it gives frames back, unsolved, until the front-end
    /// sends one with which it is to begin anew.
    pub fn run(mut self, shared: &RunState<'_>) -> WindowEnd {
        self.rings.bell.listen();
        self.stage.figures.start();
        while catch_unwind(AssertUnwindSafe(|| self.solve_all(shared))).is_err() {
            shared.heartbeats.of(TaskId::Window).die();
            self.is_down = true;
            shared.report_window_down();
            if let Some(job) = self.job.take() {
                let _ = self.rings.spare.push(job);
            }
        }
        WindowEnd { stage: self.stage, deepest_frames: self.rings.jobs.deepest() }
    }

    fn solve_all(&mut self, shared: &RunState<'_>) {
        while let Some(job) = self.rings.jobs.next(&self.rings.bell, NAP) {
            if self.is_down && !job.is_after_fault {
                let _ = self.rings.spare.push(job);
                continue;
            }
            self.job = Some(job);
            shared.heartbeats.busy(TaskId::Window);
            self.solve(shared);
            if let Some(job) = self.job.take() {
                let _ = self.rings.spare.push(job);
            }
            shared.heartbeats.idle(TaskId::Window);
        }
    }

    /// Solves the frame in hand.
    fn solve(&mut self, shared: &RunState<'_>) {
        let Self { stage, rings, job: Some(job), feedback, is_down, awaits_pose } = self else { return };
        if job.is_after_fault {
            stage.renew();
            (*is_down, *awaits_pose) = (false, true);
        }
        while let Some(update) = rings.map_updates.pop() {
            stage.update_map_later(update);
        }
        // There are as many as there are jobs.
        let Some(room) = feedback.take().or_else(|| rings.blank.pop()) else { return };
        let (estimate, cost) = stage.solve(job, feedback.insert(room));
        shared.set_window_ms(cost.wall_ms);
        if let Some(filled) = feedback.take() {
            let _ = rings.feedback.push(filled);
        }
        *awaits_pose &= !estimate.has_pose();
        if !*awaits_pose {
            let _ = rings.corrections.push(estimate);
        }
    }
}
