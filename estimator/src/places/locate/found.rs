//! Pose that was found, with its evidence, and the reason why it was not believed.

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
    /// Matches before guiding.
    pub matches: usize,
    /// Matches before guiding that agree with the pose.
    pub first_inliers: usize,
    /// Fields of the grid over the image with inliers.
    pub spread: usize,
    /// Mean square of the whitened residuals.
    pub variance: f64,
}

impl Located {
    /// Evidence for the pose: inliers found without guidance, and a quarter of those found with it.
    #[must_use]
    pub fn evidence(&self) -> f64 {
        evidence(self.first_inliers, self.inliers)
    }

    /// Standard deviation of the position in its worst direction, m.
    #[must_use]
    pub fn sigma_m(&self) -> f64 {
        self.covariance.fixed_view::<3, 3>(0, 0).symmetric_eigenvalues().max().at_least(0.0).sqrt()
    }

    /// Standard deviation of the attitude about its worst axis, rad.
    #[must_use]
    pub fn sigma_rad(&self) -> f64 {
        self.covariance.fixed_view::<3, 3>(3, 3).symmetric_eigenvalues().max().at_least(0.0).sqrt()
    }
}

/// Reason why a pose was not believed, or none was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doubt {
    /// No pose agrees with enough matches.
    NoPose,
    /// The matches after guided matching do not determine a pose.
    Undetermined,
    /// Too few inliers.
    Inliers,
    /// Too few of the matches are inliers.
    InlierShare,
    /// Too few inliers were found without knowing where to look.
    Evidence,
    /// The inliers lie in a small part of the image.
    Spread,
    /// The position is not known well enough.
    Position,
    /// The attitude is not known well enough.
    Attitude,
    /// Another group speaks for another place, with nearly as much evidence.
    Rival,
}

/// Result of verifying a group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attempt {
    /// Number of its keyframe.
    pub keyframe_id: u32,
    /// Similarity to the frame.
    pub score: f32,
    /// Matches before guiding.
    pub matches: usize,
    /// Matches before guiding that agree with the pose.
    pub first_inliers: usize,
    /// Matches that agree with the pose after guiding.
    pub inliers: usize,
    /// The pose of the body in the map, where one was found.
    pub pose_m_b: Option<Isometry3<f64>>,
    /// Reason why it was not believed; `None` when it was.
    pub doubt: Option<Doubt>,
}

impl Attempt {
    /// Evidence for its pose.
    #[must_use]
    pub fn evidence(&self) -> f64 {
        evidence(self.first_inliers, self.inliers)
    }

    pub(super) fn agrees_with(&self, found: &Located) -> bool {
        self.pose_m_b.is_some_and(|pose| {
            (pose.translation.vector - found.pose_m_b.translation.vector).norm() <= SAME_POSE.0
                && pose.rotation.angle_to(&found.pose_m_b.rotation) <= SAME_POSE.1
        })
    }
}

/// Inliers before guiding, and a quarter of those after it.
fn evidence(first_inliers: usize, inliers: usize) -> f64 {
    first_inliers as f64 + 0.25 * inliers as f64
}
