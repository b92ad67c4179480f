//! A causal trajectory, corrected by what the graph knows at the end.

use super::Mapper;
use nalgebra::Isometry3;
use plumbline_config::Timestamp;

/// A pose on the way of the body, as it was known when its frame came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passing {
    /// Time.
    pub stamp: Timestamp,
    /// Pose in the odometry frame of that time.
    pub pose_o_b: Isometry3<f64>,
    /// Resets up to then.
    pub reset_counter: u32,
}

/// Correction by a node of the causal pose at its time.
struct Correction {
    stamp: Timestamp,
    pose_m_o: Isometry3<f64>,
}

impl Mapper {
    /// Pose of the body in the map; `None` where it is not known. Between two keyframes their
    /// corrections are blended, before the first and after the last of a segment the nearest one holds.
    #[must_use]
    pub fn corrected(&self, passing: &Passing) -> Option<Isometry3<f64>> {
        let nodes = self.graph.nodes().iter().zip(&self.infos);
        let (mut before, mut after): (Option<Correction>, Option<Correction>) = (None, None);
        for (node, info) in nodes {
            if info.reset_counter != passing.reset_counter || !node.is_placed {
                continue;
            }
            let pose_m_o = node.pose_m_b() * info.first_pose_o_b.inverse();
            let correction = Correction { stamp: info.stamp, pose_m_o };
            if info.stamp <= passing.stamp {
                before = Some(correction);
            } else {
                after = Some(correction);
                break;
            }
        }
        let here = |c: &Correction| c.pose_m_o * passing.pose_o_b;
        match (before, after) {
            (Some(a), Some(b)) => {
                let share = passing.stamp.seconds_since(a.stamp) / b.stamp.seconds_since(a.stamp);
                here(&a).try_lerp_slerp(&here(&b), share, f64::EPSILON)
            }
            (Some(only), None) | (None, Some(only)) => Some(here(&only)),
            (None, None) => None,
        }
    }
}
