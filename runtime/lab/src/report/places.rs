//! Gain of the map: places seen again, loops, and the errors of the trajectories in the map.

use super::accuracy::ate_rmse_m;
use plumbline_flight::flight::Flown;
use plumbline_flight::pipeline::places::PlacesFigures;
use serde::Serialize;

/// The map of a flight.
#[derive(Clone, Debug, Serialize)]
pub struct PlacesReport {
    /// Counts, and the digest.
    #[serde(flatten)]
    pub figures: PlacesFigures,
    /// Poses that were known in the map when their frames came, over all poses.
    pub localized: f64,
    /// Root mean square position error of the causal trajectory in the map, after SE(3) alignment, m.
    pub ate_map_rmse_m: Option<f64>,
    /// Root mean square position error of the trajectory by all that was known at the end, after SE(3) alignment, m.
    pub ate_final_rmse_m: Option<f64>,
}

impl PlacesReport {
    /// Figures of a flight; `None` if places are switched off.
    pub fn of(flown: &Flown) -> Option<Self> {
        let in_map = flown.poses_in_map();
        Some(Self {
            figures: flown.outcome.places.as_ref()?.figures.clone(),
            localized: in_map.len() as f64 / flown.poses.len().max(1) as f64,
            ate_map_rmse_m: ate_rmse_m(&in_map, &flown.truth),
            ate_final_rmse_m: ate_rmse_m(&flown.final_poses(), &flown.truth),
        })
    }

    /// For people.
    pub fn line(&self) -> String {
        let counted = |n: u32, one: &str, many: &str| match n {
            0 => format!("no {one}"),
            1 => format!("1 {one}"),
            n => format!("{n} {many}"),
        };
        let mut line = format!(
            "{:<18}{}, {}, {}",
            "map",
            counted(self.figures.keyframes, "keyframe", "keyframes"),
            counted(self.figures.sightings, "place seen again", "places seen again"),
            counted(self.figures.loops_used, "loop", "loops")
        );
        let ates = [(self.ate_map_rmse_m, "as flown"), (self.ate_final_rmse_m, "as known at the end")];
        for (ate, when) in ates.into_iter().filter(|_| self.figures.keyframes > 0) {
            line += &ate.map_or_else(String::new, |m| format!("; ATE in the map {when} {m:.4} m"));
        }
        line
    }
}
