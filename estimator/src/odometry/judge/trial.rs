//! The trial of a frame's prediction, and what it decides: whether the samples or the images are wrong, and what moves in view.

use super::noise::Prediction;
use super::sudden_force::SuddenForce;
use crate::window::Window;
use crate::window::sighting::Sighting;
use crate::window::trial::{CONTRADICTS_SIGMAS, Crowd, Expected, Trial};
use plumbline_config::Portable;

/// A force that set in suddenly and did not act moves a prediction by no more than this multiple of what it adds to it.
const SUDDEN_SHARE: f64 = 1.5;
/// A force of the vehicle that its accelerometer does not feel, as on an axis that is dead, m/s².
const UNMEASURED_M_S2: f64 = 6.0;

/// Outcome of a trial.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tried {
    /// The prediction against known landmarks; `None` where it cannot be relied on, or too few are seen.
    pub(super) trial: Option<Trial>,
    /// Known landmarks that agree with the prediction, once whatever moves in view was dropped.
    pub(super) left: Option<usize>,
}

/// Tries a prediction that can be relied on against what is seen, and drops what moves if the prediction holds. `known` is the pose by
/// known landmarks if it was looked for, `stamp_sigma_s` the standard deviation of the frame's time, `wrong_m_s2` what forces have lately been
/// wrong by.
pub(super) fn try_prediction(
    window: &mut Window,
    prediction: &Prediction,
    known: Option<Sighting>,
    sudden_force: &SuddenForce,
    wrong_m_s2: f64,
    stamp_sigma_s: f64,
) -> Tried {
    let Some(velocity_sigma_m_s) = prediction.velocity_sigma_m_s() else { return Tried::default() };
    let crowd = crowd(window, sudden_force, wrong_m_s2, (prediction.dt_s, velocity_sigma_m_s));
    let trial = window.try_prediction(&Expected { velocity_sigma_m_s, stamp_sigma_s, crowd }, known);
    let is_contradicted = trial.is_some_and(|trial| trial.is_contradicted());
    let left = match is_contradicted {
        true => None,
        false => window.drop_moving(velocity_sigma_m_s, trial.as_ref()),
    };
    Tried { trial, left }
}

/// Bound of what a prediction over `dt_s` from a velocity of this standard deviation, m/s, can be wrong by, while something moves in view.
fn crowd(
    window: &Window,
    sudden_force: &SuddenForce,
    wrong_m_s2: f64,
    (dt_s, velocity_sigma_m_s): (f64, f64),
) -> Option<Crowd> {
    let newest = window.frames.last().filter(|_| window.is_motion_in_sight())?;
    let by_sudden = sudden_force.moved_m(newest.taken, dt_s);
    let by_unmeasured = 0.5 * UNMEASURED_M_S2.at_least(wrong_m_s2) * dt_s.squared();
    let by_velocity = CONTRADICTS_SIGMAS * velocity_sigma_m_s * dt_s;
    Some(Crowd {
        wrong_m: SUDDEN_SHARE * by_sudden.unwrap_or(0.0) + by_unmeasured + by_velocity,
        is_force_sudden: by_sudden.is_some(),
    })
}
