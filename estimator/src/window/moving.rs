//! Things that move: what the newest frame sees of landmarks elsewhere than the motion predicts that window and IMU agree on.
//!
//! A person who walks through the view contradicts that motion from one frame to the next by tens of pixels, where velocity and
//! gyroscope predict to a pixel or two. Such observations are dropped before anything else looks at the frame: afterwards the
//! pose is a compromise, and no longer tells the vehicle's motion from that of the person.
//!
//! A blow, or a gyroscope that lies, contradicts the images too, but then one motion near the predicted one explains all that is
//! seen, and [`super::doubt`] finds it. Where none does, there are two, and the vehicle's is the one that its sensors felt. One
//! that goes further than a blow is none: near things that pass by and a far background look like a way to the side.

use super::Window;
use super::feature::Feature;
use super::landmark::LandmarkStore;
use super::poses::Poses;
use super::problem::Problem;
use super::state::NavState;
use super::tracks::{self, Verdict};
use plumbline_config::Portable;

/// Observations that agree with the motion, at least: by chance hardly any would.
const MIN_AGREEING: usize = 6;
/// With so many that agree, what contradicts has been seen to move, and is known for the frames that follow, even if it hides all else.
const WITNESSES: usize = 12;
const REMEMBERED_FRAMES: u32 = 10;
/// Observations that contradict it before anything is taken for moving, at least.
const MIN_MOVING: usize = 8;
/// Share of what is seen that a motion which explains it leaves unexplained, at most.
const UNEXPLAINED_SHARE: f64 = 0.15;
/// A blow moves the vehicle by no more than this within a frame, m.
const BLOW_M: f64 = 0.03;
/// The prediction may be off by this many standard deviations of the velocity, and gates may grow by this factor.
const VELOCITY_SIGMAS: f64 = 3.0;
const MOST_SLACK: f64 = 3.0;
/// Inverse depth of a near point, 1/m, by which a wrong velocity is seen.
const NEAR_RHO: f64 = 0.7;

impl Window {
    /// Drops what the newest frame, at its predicted pose, sees of things that move. `velocity_sigma_m_s` is the standard
    /// deviation of the predicted velocity, m/s.
    pub fn drop_moving(&mut self, velocity_sigma_m_s: f64) {
        let was_in_sight = self.moving_in_sight > 0;
        self.moving_in_sight = self.moving_in_sight.saturating_sub(1);
        let Some(slack) = self.slack(velocity_sigma_m_s) else { return };
        let verdict = self.verdict_within(slack);
        let is_moving = are_moving(verdict, was_in_sight, self.options.max_moving_share);
        if is_moving && (explains(verdict) || !self.does_a_blow_explain(slack)) {
            self.forget_moving(slack);
            if verdict.seen >= verdict.wrong + WITNESSES {
                self.moving_in_sight = REMEMBERED_FRAMES;
            }
        }
    }

    /// Whether something was seen to move in the last frames: what the newest one sees is then no evidence against its sensors.
    #[must_use]
    pub fn is_motion_in_sight(&self) -> bool {
        self.moving_in_sight > 0
    }

    /// Judges what the newest frame sees from where it is now.
    fn verdict_within(&mut self, slack: f64) -> Verdict {
        let Self { rig, manhattan, frames, points, lines, linearizer, options, .. } = self;
        linearizer.poses.refresh(rig, frames, options.first_estimates);
        let problem = Problem { rig, frames, points: &[], lines: &[], manhattan, options };
        let poses = &linearizer.poses;
        tracks::judge_within(points, poses, &problem, slack)
            .and(tracks::judge_within(lines, poses, &problem, slack))
    }

    /// Whether nearly all that the newest frame sees fits at the pose that its images alone give it, and that is near.
    fn does_a_blow_explain(&mut self, slack: f64) -> bool {
        let Some(predicted) = self.frames.last().map(|frame| frame.nav.clone()) else { return true };
        let Some(sighting) = self.sight_newest(&predicted) else { return false };
        let (rot_o_b, p_o_b) = (sighting.rot_o_b, sighting.p_o_b);
        if (p_o_b - predicted.p_o_b).norm_squared() > BLOW_M.squared() {
            return false;
        }
        self.place_newest_at(NavState { rot_o_b, p_o_b, ..predicted.clone() });
        let verdict = self.verdict_within(slack);
        self.place_newest_at(predicted);
        explains(verdict)
    }

    fn forget_moving(&mut self, slack: f64) {
        let Self { rig, manhattan, frames, points, lines, linearizer, options, outliers, .. } = self;
        linearizer.poses.refresh(rig, frames, options.first_estimates);
        let problem = Problem { rig, frames, points: &[], lines: &[], manhattan, options };
        let poses = &linearizer.poses;
        forget(points, poses, &problem, slack, &mut outliers.points);
        forget(lines, poses, &problem, slack, &mut outliers.lines);
    }

    /// Factor of the gates for a predicted velocity of this standard deviation, m/s; `None` where the prediction tells nothing,
    /// or nothing is to be dropped.
    fn slack(&self, velocity_sigma_m_s: f64) -> Option<f64> {
        let [.., before, newest] = &self.frames[..] else { return None };
        let dt_s = newest.stamp.seconds_since(before.stamp);
        let off_px = VELOCITY_SIGMAS * velocity_sigma_m_s * dt_s * NEAR_RHO * self.options.focal_px;
        let slack = 1.0 + off_px / self.options.outlier_px;
        (self.options.max_moving_share > 0.0 && slack <= MOST_SLACK).then_some(slack)
    }
}

/// Whether so many contradict that something moves, and so few that the rest tell how the vehicle does.
fn are_moving(verdict: Verdict, was_in_sight: bool, most: f64) -> bool {
    let (seen, wrong) = (verdict.seen as f64, verdict.wrong as f64);
    let do_others_agree = verdict.seen >= verdict.wrong + MIN_AGREEING && wrong <= most * seen;
    verdict.wrong >= MIN_MOVING && (do_others_agree || was_in_sight)
}

/// Whether a motion explains what is seen.
fn explains(verdict: Verdict) -> bool {
    verdict.wrong as f64 <= UNEXPLAINED_SHARE * verdict.seen as f64
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
    fn a_few_are_left_to_the_kernel_and_a_few_do_not_tell_how_the_vehicle_moves() {
        let moving = |seen, wrong, was_in_sight| are_moving(Verdict { seen, wrong }, was_in_sight, 0.85);
        assert!(moving(100, 35, false) && moving(100, 80, false) && moving(18, 8, false));
        assert!(!moving(100, 5, false) && !moving(100, 90, false) && !moving(12, 8, false));
        assert!(moving(100, 98, true) && !moving(7, 7, true), "what hides all else has been seen to move");
    }
}
