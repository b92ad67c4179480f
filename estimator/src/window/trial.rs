//! A trial of the prediction: whether known landmarks contradict where inertial samples put the newest frame.
//!
//! The predicted position and the sighted one ([`super::sighting`]) share the landmarks and little else, so that their difference has
//! the variance of both: that of the sighting, of the velocity before, and of the stamp along the way. A force `f` that did not act
//! moves the prediction by `f dt² / 2` within a frame.
//!
//! People contradict the prediction too, and may outnumber what stands still. But what stands still is then explained by the
//! prediction alone, where a blow leaves nothing on its side; and who has just come into view is not known yet. A crowd that pulls a
//! sighting along also turns it, which a force does not.

use super::Window;
use super::sighting::{LEAST_SIGHTING_M, Sighting, Votes, variance_along};
use super::state::NavState;
use crate::geometry::log_so3;
use nalgebra::Vector3;
use plumbline_config::Portable;

/// A difference contradicts by this many standard deviations, whatever differs: one axis of a frame at 20 Hz would by chance every 24
/// hours. By so many, it is in doubt: forces lose weight.
pub const CONTRADICTS_SIGMAS: f64 = 5.0;
pub const DOUBTFUL_SIGMAS: f64 = 3.0;
/// A stamp is not better than this, s.
const LEAST_STAMP_S: f64 = 1e-3;
/// Share of known landmarks on the side of the prediction from which it is not contradicted, and that the sighting explains at least.
const BACKED_SHARE: f64 = 0.1;
const EXPLAINED_SHARE: f64 = 0.7;
/// Share of known landmarks that only the sighting explains, from which a turn is outvoted.
const PLAIN_SHARE: f64 = 0.25;
/// A turn is outvoted by this many times the landmarks that explain it alone.
const TURN_OUTVOTES: usize = 4;
/// Turns of a frame by the images and by the gyroscope are the same if they differ by this, rad: twice the most of recorded and clean
/// simulated flights, but for single frames.
pub const SAME_TURN_RAD: f64 = 1.5e-3;

/// Uncertainty of a frame's prediction.
#[derive(Clone, Copy, Debug)]
pub struct Expected {
    /// Standard deviation of the velocity before the frame, m/s.
    pub velocity_sigma_m_s: f64,
    /// Standard deviation of the stamp as far as it is learnt, s.
    pub stamp_sigma_s: f64,
}

/// The predicted position of a frame against the sighted one.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    /// Pose by known landmarks.
    pub sighting: Sighting,
    /// Votes of the landmarks that it rests on.
    pub votes: Votes,
    /// Distance between the positions, m, after this time, s, and in standard deviations.
    off_m: f64,
    dt_s: f64,
    off_sigmas: f64,
    /// True if the rotations agree.
    is_turn_backed: bool,
}

impl Trial {
    /// True if the prediction is wrong, and not the observations.
    pub fn is_contradicted(&self) -> bool {
        self.is_off_by(CONTRADICTS_SIGMAS)
    }

    /// True if the prediction may be wrong: forces lose weight, and nothing is reported.
    pub fn is_doubtful(&self) -> bool {
        self.is_off_by(DOUBTFUL_SIGMAS)
    }

    /// True if the turn that the samples predict is wrong rather than what is seen: most known landmarks are where another turn has them, and
    /// hardly any where the predicted one does.
    pub fn is_turn_outvoted(&self) -> bool {
        let Votes { predicted, sighted, all, .. } = self.votes;
        let is_outvoted = sighted as f64 >= PLAIN_SHARE * all as f64 && sighted >= TURN_OUTVOTES * predicted;
        !self.is_turn_backed && self.votes.are_explained() && is_outvoted
    }

    /// True if known landmarks are where the prediction has them: then everything else that is elsewhere moves.
    pub fn is_backed(&self) -> bool {
        let Votes { predicted, both, all, .. } = self.votes;
        (predicted + both) as f64 >= EXPLAINED_SHARE * all as f64
    }

    /// Force that explains the difference, m/s².
    pub fn force_m_s2(&self) -> f64 {
        2.0 * self.off_m / self.dt_s.squared()
    }

    fn is_off_by(&self, sigmas: f64) -> bool {
        self.off_sigmas > sigmas && self.is_turn_backed && self.votes.are_for_sighting()
    }
}

impl Votes {
    /// True if the sighting explains nearly all.
    fn are_explained(self) -> bool {
        (self.sighted + self.both) as f64 >= EXPLAINED_SHARE * self.all as f64
    }

    /// True if nearly all are where the sighting has them, and hardly any where the prediction alone does.
    pub fn are_for_sighting(self) -> bool {
        self.are_explained() && self.predicted as f64 <= BACKED_SHARE * self.all as f64
    }
}

impl Window {
    /// Compares the pose at which the newest frame was predicted, and still is, with that by its known landmarks; `None` where it sees too
    /// few of these. The latter is found unless it is given.
    pub fn try_prediction(&self, expected: &Expected, known: Option<Sighting>) -> Option<Trial> {
        let [.., before, newest] = &self.frames[..] else { return None };
        let predicted = &newest.nav;
        let sighting = known.or_else(|| self.sight_by_known(predicted))?;
        let off = sighting.p_o_b - predicted.p_o_b;
        let dt_s = newest.taken.seconds_since(before.taken);
        Some(Trial {
            sighting,
            votes: self.votes(predicted, &sighting),
            off_m: off.norm(),
            dt_s,
            is_turn_backed: sighting.is_turn_of(predicted),
            off_sigmas: sigmas(&off, &sighting, predicted, dt_s, expected),
        })
    }
}

impl Sighting {
    /// True if the attitude of `predicted` is the sighted one: no force turns the vehicle, and a crowd that pulls a sighting along does.
    pub fn is_turn_of(&self, predicted: &NavState) -> bool {
        let off = log_so3(&(predicted.rot_o_b.inverse() * self.rot_o_b));
        let variance = variance_along(&self.rotation_covariance, &off);
        off.norm_squared() < SAME_TURN_RAD.squared() + DOUBTFUL_SIGMAS.squared() * variance
    }
}

/// The difference `off` of positions `dt_s` after the frame before, in standard deviations.
fn sigmas(
    off: &Vector3<f64>,
    sighting: &Sighting,
    predicted: &NavState,
    dt_s: f64,
    expected: &Expected,
) -> f64 {
    let sighted = variance_along(&sighting.position_covariance, off).at_least(LEAST_SIGHTING_M.squared());
    let stamp = expected.stamp_sigma_s.at_least(LEAST_STAMP_S);
    let of_stamp = variance_along(&(predicted.v_o_b * predicted.v_o_b.transpose()), off) * stamp.squared();
    off.norm() / (sighted + (expected.velocity_sigma_m_s * dt_s).squared() + of_stamp).sqrt()
}

#[cfg(test)]
#[path = "trial_tests.rs"]
mod tests;
