//! Requirements of a pose, and limits of the work.

/// Requirements of a pose before it is believed, and limits of the work.
#[derive(Clone, Debug, PartialEq)]
pub struct LocatorOptions {
    /// Groups that are verified at most.
    pub max_candidates: usize,
    /// Groups with less than this share of the best score are not verified.
    pub min_relative_score: f32,
    /// Least number of inliers.
    pub min_inliers: usize,
    /// Least share of the matches before guiding that must be inliers.
    pub min_inlier_share: f64,
    /// Least [evidence](super::Located::evidence): the inliers before guiding were found without knowing where to look, and
    /// prove the more for it.
    pub min_evidence: f64,
    /// A group that speaks for another place must have less than this share of the evidence.
    pub max_rival_share: f64,
    /// Fields of a 4x3 grid over the image that hold inliers, at least.
    pub min_spread: usize,
    /// Largest standard deviation of the position in its worst direction, m.
    pub max_sigma_m: f64,
    /// Largest standard deviation of the attitude in its worst direction, rad.
    pub max_sigma_rad: f64,
    /// Inliers err alike (one calibration, patches seen from one side), so no more than this count as independent of
    /// each other.
    pub max_independent: f64,
    /// Points of the map that a query is matched with, at most.
    pub max_points: usize,
    /// Standard deviation of the keyframes' own positions against each other, m: added to what is found.
    pub map_sigma_m: f64,
    /// Standard deviation of the keyframes' own attitudes against each other, rad: added to what is found.
    pub map_sigma_rad: f64,
}

impl Default for LocatorOptions {
    fn default() -> Self {
        Self {
            max_candidates: 6,
            min_relative_score: 0.2,
            min_inliers: 15,
            min_inlier_share: 0.25,
            min_evidence: 15.0,
            max_rival_share: 0.7,
            min_spread: 4,
            max_sigma_m: 0.08,
            max_sigma_rad: 0.03,
            // This, and the errors of poses by motion capture, were found as `notes/places.md` tells.
            max_independent: 30.0,
            max_points: 1600,
            map_sigma_m: 0.005,
            map_sigma_rad: 0.004,
        }
    }
}
