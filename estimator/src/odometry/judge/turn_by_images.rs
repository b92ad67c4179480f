//! The turn of a frame by what its images show: landmarks of the window, or corners that look like nothing around them.

use crate::geometry::log_so3;
use crate::points::prediction::WitnessedTurn;
use crate::window::Window;
use crate::window::sighting::{Sighting, variance_along};
use crate::window::trial::{DOUBTFUL_SIGMAS, Trial};
use nalgebra::{Matrix3, Vector3};
use plumbline_config::Portable;

/// Share of the landmarks that the sighted pose alone explains, from which they vote for it.
const VOTED_SHARE: f64 = 0.15;

/// Turn of the newest frame since the one before, by images.
#[derive(Clone, Copy, Debug)]
pub(super) struct TurnByImages {
    /// rad in `B`, and its covariance, rad².
    pub(super) seen: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
    /// Share of what was looked at that agrees with it.
    pub(super) agreeing_share: f64,
    /// True if the prediction does not explain what is seen as well.
    pub(super) is_voted: bool,
    /// True if corners tell it, and no known landmarks.
    pub(super) is_by_corners: bool,
}

impl TurnByImages {
    /// By the landmarks of the window, whose votes are those of the frame's `trial` if there was one.
    pub(super) fn of_landmarks(window: &Window, sighting: &Sighting, trial: Option<&Trial>) -> Option<Self> {
        let [.., before, newest] = &window.frames[..] else { return None };
        let votes = trial.map_or_else(|| window.votes(&newest.nav, sighting), |trial| trial.votes);
        Some(Self {
            seen: log_so3(&(before.nav.rot_o_b.inverse() * sighting.rot_o_b)),
            covariance: sighting.rotation_covariance,
            agreeing_share: sighting.agreeing_share,
            is_voted: votes.sighted as f64 >= VOTED_SHARE * votes.all as f64,
            is_by_corners: false,
        })
    }

    /// True if it is the turn by `corners`, as far as these know it.
    pub(super) fn is_turn_of(&self, corners: &Self) -> bool {
        let off = self.seen - corners.seen;
        off.norm_squared() < DOUBTFUL_SIGMAS.squared() * variance_along(&corners.covariance, &off)
    }

    /// By corners that look like nothing around them: before texture that repeats, landmarks may be of another cell.
    pub(super) fn of_corners(turn: &WitnessedTurn) -> Self {
        Self {
            seen: log_so3(&turn.rot_prev_cur_b),
            covariance: turn.covariance,
            // Corners that do not agree were found elsewhere: no crowd carries those that do.
            agreeing_share: 1.0,
            is_voted: turn.is_other,
            is_by_corners: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    #[test]
    fn landmarks_tell_the_turn_of_corners_as_far_as_these_know_it() {
        let corners = |sigma_rad: f64| {
            TurnByImages::of_corners(&WitnessedTurn {
                rot_prev_cur_b: UnitQuaternion::from_scaled_axis(Vector3::x() * 0.01),
                covariance: Matrix3::identity() * sigma_rad.squared(),
                is_other: true,
            })
        };
        let landmarks = TurnByImages { seen: Vector3::zeros(), is_voted: false, ..corners(1e-4) };
        assert!(landmarks.is_turn_of(&corners(5e-3)) && !landmarks.is_turn_of(&corners(2e-3)));
        assert!((corners(1e-3).seen - Vector3::x() * 0.01).norm() < 1e-12 && corners(1e-3).is_voted);
    }
}
