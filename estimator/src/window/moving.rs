//! Things that move: what the newest frame sees of landmarks elsewhere than the motion predicts that window and IMU agree on.
//!
//! A person who walks through the view contradicts that motion from one frame to the next by tens of pixels, where velocity and
//! gyroscope predict to a pixel or two. Such observations are dropped before anything else looks at the frame: afterwards the
//! pose is a compromise, and no longer tells the vehicle's motion from that of the person.
//!
//! A blow, or an inertial sensor that lies, contradicts the images too, but then one motion explains what is seen: known landmarks have decided
//! about it before ([`super::trial`]).

use super::Window;
use super::feature::Feature;
use super::landmark::LandmarkStore;
use super::poses::Poses;
use super::problem::Problem;
use super::tracks::{self, MIN_WITNESSES, Verdict};
use super::trial::{DOUBTFUL_SIGMAS, Trial};

/// Observations that agree with a motion, at least: by chance hardly any would.
const MIN_AGREEING: usize = 6;
/// With [`MIN_WITNESSES`] that agree, what contradicts has been seen to move, and is known for so long, s, even if it hides all else.
const REMEMBERED_S: f64 = 0.5;
/// Observations that contradict it before anything is taken for moving, at least.
const MIN_MOVING: usize = 8;
/// Gates may grow by this factor where the velocity is uncertain.
const MOST_SLACK: f64 = 3.0;
/// Inverse depth of a near point, 1/m, by which a wrong velocity is seen.
const NEAR_RHO: f64 = 0.7;

impl Window {
    /// Drops what the newest frame, at its predicted pose, sees of things that move; returns whether there were any. `velocity_sigma_m_s` is the standard deviation of the predicted velocity, m/s. Where a `trial` outvotes the predicted turn, nothing is
    /// dropped.
    pub fn drop_moving(&mut self, velocity_sigma_m_s: f64, trial: Option<&Trial>) -> bool {
        let was_in_sight = self.is_motion_in_sight();
        if trial.is_some_and(Trial::is_turn_outvoted) {
            return false;
        }
        let Some(slack) = self.slack(velocity_sigma_m_s) else { return false };
        let verdict = self.verdict_within(slack);
        let most = if trial.is_some_and(Trial::is_backed) { 1.0 } else { self.options.max_moving_share };
        if !are_moving(verdict, was_in_sight, most) {
            return false;
        }
        self.forget_moving(slack);
        if verdict.seen >= verdict.wrong + MIN_WITNESSES {
            self.last_motion = self.frames.last().map(|newest| newest.stamp);
        }
        true
    }

    /// Judges what the newest frame sees from where it is now.
    fn verdict_within(&mut self, slack: f64) -> Verdict {
        let Self { rig, frames, points, lines, linearizer, options, .. } = self;
        linearizer.poses.refresh(rig, frames, options.first_estimates);
        let problem = Problem::of_frames(rig, frames, options);
        let poses = &linearizer.poses;
        tracks::judge_within(points, poses, &problem, slack)
            .and(tracks::judge_within(lines, poses, &problem, slack))
    }

    /// True if something has moved in view a moment ago.
    pub fn is_motion_in_sight(&self) -> bool {
        let newest = self.frames.last().zip(self.last_motion);
        newest.is_some_and(|(newest, last)| newest.stamp.seconds_since(last) <= REMEMBERED_S)
    }

    fn forget_moving(&mut self, slack: f64) {
        let Self { rig, frames, points, lines, linearizer, options, outliers, .. } = self;
        linearizer.poses.refresh(rig, frames, options.first_estimates);
        let problem = Problem::of_frames(rig, frames, options);
        let poses = &linearizer.poses;
        forget(points, poses, &problem, slack, &mut outliers.points);
        forget(lines, poses, &problem, slack, &mut outliers.lines);
    }

    /// Factor of the gates for a predicted velocity of this standard deviation, m/s; `None` where the prediction tells nothing,
    /// or nothing is to be dropped.
    fn slack(&self, velocity_sigma_m_s: f64) -> Option<f64> {
        let [.., before, newest] = &self.frames[..] else { return None };
        let dt_s = newest.taken.seconds_since(before.taken);
        let off_px = DOUBTFUL_SIGMAS * velocity_sigma_m_s * dt_s * NEAR_RHO * self.options.focal_px;
        let slack = 1.0 + off_px / self.options.outlier_px;
        (self.options.max_moving_share > 0.0 && slack <= MOST_SLACK).then_some(slack)
    }
}

/// True if so many contradict that something moves, and so few that the rest shows the motion of the vehicle.
fn are_moving(verdict: Verdict, was_in_sight: bool, most: f64) -> bool {
    let (seen, wrong) = (verdict.seen as f64, verdict.wrong as f64);
    let do_others_agree = verdict.seen >= verdict.wrong + MIN_AGREEING && wrong <= most * seen;
    verdict.wrong >= MIN_MOVING && (do_others_agree || was_in_sight)
}

/// Takes the newest observations away from landmarks that they contradict; their tracks are outliers.
fn forget<F: Feature>(
    store: &mut LandmarkStore<F>,
    poses: &Poses,
    problem: &Problem<'_>,
    slack: f64,
    outliers: &mut Vec<u32>,
) {
    let newest = problem.frames.len().saturating_sub(1) as u8;
    for landmark in store.all_mut().iter_mut().filter(|l| l.is_triangulated && l.host != newest) {
        let placed = poses.placed(landmark);
        let is_wrong = landmark
            .observations
            .iter()
            .any(|o| o.frame == newest && !tracks::fits_within::<F>(poses, problem, &placed, o, slack));
        if is_wrong {
            landmark.observations.retain(|o| o.frame != newest);
            outliers.push(landmark.track_id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_in_sight_is_forgotten_in_frames_that_are_not_tried() {
        let mut window = crate::window::test_room::Room::default().window();
        let stamps: Vec<_> = window.frames.iter().map(|frame| frame.stamp).collect();
        let in_sight = stamps.iter().map(|stamp| {
            window.last_motion = Some(*stamp);
            window.is_motion_in_sight()
        });
        assert_eq!(in_sight.collect::<Vec<_>>(), [false, false, false, true, true], "frames are 0.3 s apart");
    }

    #[test]
    fn a_few_are_left_to_the_kernel_and_a_few_do_not_tell_how_the_vehicle_moves() {
        let moving = |seen, wrong, was_in_sight| are_moving(Verdict { seen, wrong }, was_in_sight, 0.85);
        assert!(moving(100, 35, false) && moving(100, 80, false) && moving(18, 8, false));
        assert!(!moving(100, 5, false) && !moving(100, 90, false) && !moving(12, 8, false));
        assert!(moving(100, 98, true) && !moving(7, 7, true), "what hides all else has been seen to move");
    }
}
