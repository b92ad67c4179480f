//! State of a camera and of everything that moves at one instant.

use super::world::World;
use nalgebra::Isometry3;

/// Most people.
pub(super) const MAX_MOVERS: usize = 4;

/// One instant of one camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shot {
    /// Pose of the camera in the world.
    pub(super) pose_w_c: Isometry3<f64>,
    /// Poses in the world of the things that move, as many as the world has.
    pub(super) movers: [Isometry3<f64>; MAX_MOVERS],
}

impl Shot {
    /// A camera in a world in which nothing moves.
    pub(super) fn at(pose_w_c: Isometry3<f64>) -> Self {
        Self { pose_w_c, movers: [Isometry3::identity(); MAX_MOVERS] }
    }

    /// Pose of the camera in the frame of each of the surfaces: ranges of them, those at rest first.
    pub(super) fn poses<'a>(
        &'a self,
        world: &'a World,
    ) -> impl Iterator<Item = (std::ops::Range<usize>, Isometry3<f64>)> + 'a {
        let movers = world.movers.iter().zip(&self.movers);
        let moved = movers.map(|(range, pose_w_m)| (range.clone(), pose_w_m.inverse() * self.pose_w_c));
        std::iter::once((0..world.still().len(), self.pose_w_c)).chain(moved)
    }
}
