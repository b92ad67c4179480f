//! The trial of a frame's prediction, and what it decides: whether the samples or the images are wrong, and what moves in view.

use super::noise::Prediction;
use crate::window::Window;
use crate::window::sighting::Sighting;
use crate::window::trial::{Expected, Trial};

/// Outcome of a trial.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tried {
    /// The prediction against known landmarks; `None` where it cannot be relied on, or too few are seen.
    pub(super) trial: Option<Trial>,
    /// True if something moves in view, and was dropped.
    pub(super) has_dropped: bool,
}

/// Tries a prediction that can be relied on against what is seen, and drops what moves if the prediction holds. `known` is the pose by
/// known landmarks if it was looked for, `stamp_sigma_s` the standard deviation of the frame's time.
pub(super) fn try_prediction(
    window: &mut Window,
    prediction: &Prediction,
    known: Option<Sighting>,
    stamp_sigma_s: f64,
) -> Tried {
    let Some(velocity_sigma_m_s) = prediction.velocity_sigma_m_s() else { return Tried::default() };
    let trial = window.try_prediction(&Expected { velocity_sigma_m_s, stamp_sigma_s }, known);
    let is_contradicted = trial.is_some_and(|trial| trial.is_contradicted());
    let has_dropped = !is_contradicted && window.drop_moving(velocity_sigma_m_s, trial.as_ref());
    Tried { trial, has_dropped }
}
