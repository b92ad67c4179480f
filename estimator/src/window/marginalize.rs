//! Marginalization: what leaves the window becomes part of the prior.
//!
//! The landmarks of a frame that leaves are linearized with their observations in keyframes and with the
//! frame's inertial factors, and everything that leaves is eliminated (Schur complement). A track that goes
//! on gets a new landmark in the newest keyframe, from observations that the prior has not seen; the
//! baseline gives it a depth at once. With one camera it would have to wait for parallax: there a landmark
//! that is still seen stays, hosted by another keyframe. A frame that neither hosts a landmark nor is in
//! the prior goes without a trace, and the inertial factors around it are joined: such are the frames since the newest
//! keyframe, and those before the origin, which have room in the prior's equations though nothing is known of them there.
//! So a start fixes its linearization when its first keyframe leaves, and not while its tilt is still off by degrees.
//! Observations are used once: those that enter the prior leave the window.
//!
//! With two cameras the frames this touches keep their linearization points: first-estimates Jacobians
//! (Huang et al. 2009; as in basalt and OKVIS), so that yaw and position of the whole stay unobservable.
//! With one camera the scale of the first estimates is still off by percents, and Jacobians there make
//! the solver stall (measured on the flight clip: ATE 0.11 to 0.57 m with, 0.09 to 0.15 m without, over
//! ten noise settings); they are taken at the present states.

use super::Window;
use super::feature::Feature;
use super::frame::Frame;
use super::landmark::{ERROR_MEMORY_S, Landmark, LandmarkStore};
use super::linearize::Purpose;
use super::prior::PIVOT_FLOOR;
use super::problem::Problem;
use super::reprojection::{InversePoint, PATCH_VARIANCE};
use super::state::{FRAME_DIM, unknown_of_frame};
use plumbline_config::Portable;

/// Change of the variance of points by one of them: it falls to a tenth within 115, which leave in some three seconds.
const VARIANCE_STEP: f64 = 0.02;

impl Window {
    /// Removes frame `index` (not the newest), keeping its information about the others in the prior.
    pub fn remove_frame(&mut self, index: usize) {
        let newest_keyframe = self.newest_keyframe();
        if !self.options.first_estimates {
            self.pass_on_living(index);
        }
        let hosts =
            hosted(&self.points, index).next().is_some() || hosted(&self.lines, index).next().is_some();
        if self.is_in_prior(index) || hosts {
            self.rehost_and_marginalize(index, newest_keyframe);
        }
        self.close_gap(index);
    }

    /// True if the prior holds information about frame `index`. Before anything has left the window it speaks of the origin
    /// alone, though its equations have room for the frames before that. (With one camera Jacobians are not fixed there: the
    /// start is left as it is.)
    fn is_in_prior(&self, index: usize) -> bool {
        match &self.anchor {
            Some(anchor) if self.options.first_estimates => index == anchor.frame,
            _ => index < self.prior.frames(),
        }
    }

    /// Landmarks of frame `index` that are still seen get another host among the frames that remain.
    fn pass_on_living(&mut self, index: usize) {
        let Self { rig, frames, points, lines, linearizer, .. } = self;
        linearizer.poses.rehost(rig, frames, points.all_mut(), index);
        linearizer.poses.rehost(rig, frames, lines.all_mut(), index);
    }

    fn newest_keyframe(&self) -> Option<usize> {
        self.frames.iter().rposition(|f| f.is_keyframe)
    }

    /// Linearizes what frame `index` hosts, eliminates the frame, and makes the rest the prior.
    fn rehost_and_marginalize(&mut self, index: usize, newest_keyframe: Option<usize>) {
        self.refresh_anchor();
        self.anchor = None;
        self.rehosted.0.clear();
        self.rehosted.1.clear();
        split_observations(&mut self.points, &mut self.rehosted.0, &self.frames, (index, newest_keyframe));
        split_observations(&mut self.lines, &mut self.rehosted.1, &self.frames, (index, newest_keyframe));
        let covered = self.frames_touched(index);
        // Its inertial factors too: else what the prior knows of this frame would be lost to the others.
        let _ = self.evaluate(Purpose::Leaving { frame: index });
        self.learn_point_sigma(index);
        let Self { rig, frames, prior, linearizer, .. } = self;
        for frame in &mut frames[..covered] {
            if !frame.in_prior {
                frame.in_prior = true;
                frame.linearization = frame.nav.clone();
            }
        }
        let equations = &mut linearizer.equations;
        let unused = unknown_of_frame(covered)..equations.dim();
        equations.eliminate(unused, f64::INFINITY);
        prior.replace(equations, rig, frames);
        let at = unknown_of_frame(index);
        prior.equations.eliminate(at..at + FRAME_DIM, PIVOT_FLOOR);
        self.walk_rig();
        let frames = &mut self.frames;
        frames[index].inertial = None;
        if let Some(next) = frames.get_mut(index + 1) {
            next.inertial = None;
        }
    }

    /// Follows the errors of points by the landmarks that leave with frame `index`: where the first and the last residual by the host's camera
    /// differ by more than the median of what is assumed they rise, else they fall. At rest an error stays as it is, and tells nothing. With
    /// one camera they stay as configured.
    fn learn_point_sigma(&mut self, index: usize) {
        let Self { rig, frames, points, linearizer, options, .. } = self;
        let (problem, mut variance) =
            (Problem::of_frames(rig, frames, options), options.point_sigma.squared());
        let tells = options.cameras > 1 && !frames[index].is_still;
        for landmark in hosted(points, index).filter(|_| tells) {
            let placed = linearizer.poses.placed(landmark);
            let mut residuals = landmark.observations.iter().filter_map(|o| {
                let measured = problem.moved_lenses.moved::<InversePoint>(o);
                let r = linearizer.poses.residual::<InversePoint>(&problem, &placed, (o, &measured))?;
                (o.camera == landmark.host_camera).then_some((frames[usize::from(o.frame)].stamp, r))
            });
            let Some((first, last)) = residuals.next().zip(residuals.next_back()) else { continue };
            let dt_s = last.0.seconds_since(first.0);
            if dt_s > ERROR_MEMORY_S {
                // Of the two components the landmark's depth takes one; the other's square is less than half its mean every second time.
                let half = dt_s / (ERROR_MEMORY_S + dt_s) * variance;
                let is_more = (last.1 - first.1).norm_squared() > half;
                variance *= if is_more { 1.0 + VARIANCE_STEP } else { 1.0 - VARIANCE_STEP };
            }
        }
        options.point_sigma = variance.clamp(1.0 / PATCH_VARIANCE, PATCH_VARIANCE).sqrt();
    }

    /// Number of leading frames that the new prior speaks of.
    fn frames_touched(&self, index: usize) -> usize {
        let last = last_seen(&self.points, index).max(last_seen(&self.lines, index));
        last.max(index + 2).max(self.prior.frames()).min(self.frames.len())
    }

    /// Takes frame `index` out: joins the motions around it, renumbers, hosts surviving tracks anew.
    fn close_gap(&mut self, index: usize) {
        let removed = self.frames.remove(index);
        if let Some(anchor) = &mut self.anchor
            && index < anchor.frame
            && self.options.first_estimates
        {
            anchor.frame -= 1;
            self.refresh_anchor();
        }
        if let Some(next) = self.frames.get_mut(index) {
            next.inertial = match (removed.inertial, next.inertial.take()) {
                (Some(a), Some(b)) => Some(a.followed_by(&b, &self.imu_noise)),
                _ => None,
            };
        }
        let gone = index as u8;
        take_out(&mut self.points, &mut self.rehosted.0, gone);
        take_out(&mut self.lines, &mut self.rehosted.1, gone);
    }
}

/// Landmarks with a depth that frame `index` hosts.
fn hosted<F: Feature>(store: &LandmarkStore<F>, index: usize) -> impl Iterator<Item = &Landmark<F>> {
    store.all().iter().filter(move |l| usize::from(l.host) == index && l.is_triangulated)
}

/// One past the last frame that sees a landmark of frame `index`.
fn last_seen<F: Feature>(store: &LandmarkStore<F>, index: usize) -> usize {
    let seen = hosted(store, index).flat_map(|l| l.observations.iter().map(|o| usize::from(o.frame) + 1));
    seen.max().unwrap_or(0)
}

/// Takes from the landmarks of frame `index` what the prior must not see: observations outside keyframes, and observations in
/// the newest keyframe, where a living track is hosted anew.
fn split_observations<F: Feature>(
    store: &mut LandmarkStore<F>,
    rehosted: &mut Vec<Landmark<F>>,
    frames: &[Frame],
    (index, newest_keyframe): (usize, Option<usize>),
) {
    for landmark in store.all_mut() {
        if usize::from(landmark.host) != index {
            continue;
        }
        let heir = newest_keyframe.filter(|&k| k > index && landmark.is_triangulated);
        if let Some(heir) = heir
            && let Some(moved) = super::triangulate::moved_to(landmark, heir)
        {
            rehosted.push(moved);
        }
        landmark.observations.retain(|o| {
            let frame = usize::from(o.frame);
            frames[frame].is_keyframe && Some(frame) != heir
        });
    }
}

/// Takes a frame out of the landmarks: renumbers, and adds those hosted anew.
fn take_out<F: Feature>(store: &mut LandmarkStore<F>, rehosted: &mut Vec<Landmark<F>>, gone: u8) {
    store.retain(|l| l.host != gone);
    for landmark in store.all_mut() {
        landmark.observations.retain(|o| o.frame != gone);
        renumber(landmark, gone);
    }
    while let Some(mut landmark) = rehosted.pop() {
        renumber(&mut landmark, gone);
        store.insert(landmark);
    }
}

fn renumber<F: Feature>(landmark: &mut Landmark<F>, gone: u8) {
    if landmark.host > gone {
        landmark.host -= 1;
    }
    for observation in &mut landmark.observations {
        if observation.frame > gone {
            observation.frame -= 1;
        }
    }
}

#[cfg(test)]
#[path = "marginalize_tests.rs"]
mod tests;
