//! Fit of the newest frame, by which calibrations are compared.

use super::Window;
use super::factor::RobustSum;
use super::feature::Feature;
use super::problem::Problem;
use super::reprojection::InversePoint;
use plumbline_config::Portable;

/// Fit of observations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fit {
    /// Sum of the robust costs, in squared standard deviations.
    pub cost: f64,
    /// Observations.
    pub observations: usize,
}

impl Window {
    /// Fit of the newest frame's observations of points with a depth. An observation that was dropped costs as much as the gate
    /// allows.
    pub fn newest_fit(&mut self) -> Fit {
        let Self { rig, frames, points, linearizer, options, outliers, .. } = self;
        linearizer.poses.refresh(rig, frames, options.first_estimates);
        let problem = Problem::of_frames(rig, frames, options);
        let newest = frames.len().saturating_sub(1) as u8;
        let gate = InversePoint::outlier_sigmas(options);
        let mut costs = RobustSum::new(options.cauchy_scale);
        let mut observations = outliers.points.len();
        for _ in &outliers.points {
            costs.add(gate * gate);
        }
        for landmark in points.all().iter().filter(|l| l.is_triangulated && l.host != newest) {
            let placed = linearizer.poses.placed(landmark);
            for o in landmark.observations.iter().filter(|o| o.frame == newest) {
                let residual = linearizer.poses.residual::<InversePoint>(&problem, &placed, o);
                costs.add(residual.map_or(gate * gate, |r| r.norm_squared().at_most(gate * gate)));
                observations += 1;
            }
        }
        Fit { cost: costs.cost(), observations }
    }
}
