//! Pose that was found, with its evidence.

use nalgebra::{Isometry3, Matrix6};
use plumbline_config::Portable;

/// Poses that differ by no more than this are of one place, m and rad.
const SAME_POSE: (f64, f64) = (0.3, 0.09);

/// A pose found.
#[derive(Clone, Debug, PartialEq)]
pub struct Located {
    /// Pose of the body in the map.
    pub pose_m_b: Isometry3<f64>,
    /// Covariance of position (0..3, in `M`) and attitude (3..6, right perturbation, rad).
    pub covariance: Matrix6<f64>,
    /// Number of the keyframe by which it was found.
    pub keyframe_id: u32,
    /// Matches that agree with it.
    pub inliers: usize,
    /// Matches before guiding that agree with the pose.
    pub first_inliers: usize,
}

impl Located {
    /// Evidence for the pose: inliers found without guidance, and a quarter of those found with it.
    pub fn evidence(&self) -> f64 {
        self.first_inliers as f64 + 0.25 * self.inliers as f64
    }

    /// Standard deviation of the position in its worst direction, m.
    pub fn sigma_m(&self) -> f64 {
        self.worst_sigma(0)
    }

    /// Standard deviation of the attitude about its worst axis, rad.
    pub fn sigma_rad(&self) -> f64 {
        self.worst_sigma(3)
    }

    fn worst_sigma(&self, part: usize) -> f64 {
        self.covariance.fixed_view::<3, 3>(part, part).symmetric_eigenvalues().max().at_least(0.0).sqrt()
    }

    /// True if it speaks for the same place as `other`.
    pub(super) fn agrees_with(&self, other: &Self) -> bool {
        (self.pose_m_b.translation.vector - other.pose_m_b.translation.vector).norm() <= SAME_POSE.0
            && self.pose_m_b.rotation.angle_to(&other.pose_m_b.rotation) <= SAME_POSE.1
    }
}
