//! Maps from stereo images with known poses, and images located in them.

use super::frames::{PlacesError, RecordedFrames};
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_drivers::StampedPose;
use plumbline_estimator::places::map::view_distance;
use plumbline_estimator::places::{Keyframe, Located, Locator, LocatorOptions, MapLimits, PlaceMap, Query};

/// Poses further apart than this are not interpolated between, s.
const MAX_POSE_GAP_S: f64 = 0.06;

/// Options of building a map: the choice of keyframes, and its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BuildOptions {
    /// A frame becomes a keyframe when its view differs by this much from all others, m; a turn of 30 degrees counts
    /// as a metre.
    pub spacing_m: f64,
    /// Bounds of the map.
    pub limits: MapLimits,
}

/// Figures of building a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuildFigures {
    /// Frames looked at.
    pub frames: usize,
    /// Frames without a pose.
    pub without_pose: usize,
    /// Frames too similar to a keyframe of the map.
    pub too_near: usize,
}

/// Makes a map of the frames whose poses are known.
///
/// # Errors
/// When the data set cannot be read, has one camera only, or no frame has a pose.
pub fn build(
    frames: &mut RecordedFrames,
    poses: &[StampedPose],
    options: &BuildOptions,
) -> Result<(PlaceMap, BuildFigures), PlacesError> {
    if !frames.is_stereo() {
        return Err(PlacesError::Nothing("a map needs both cameras: depth comes from the second".into()));
    }
    let (mut map, mut figures) = (PlaceMap::new(options.limits), BuildFigures::default());
    let pose_b_c = frames.left().pose_b_c;
    while let Some(stamp) = frames.advance()? {
        figures.frames += 1;
        let Some(pose_m_b) = pose_at(poses, stamp) else {
            figures.without_pose += 1;
            continue;
        };
        let keyframe = Keyframe::new(0, stamp, pose_m_b, pose_b_c);
        if map.keyframes().any(|(_, k)| view_distance(k, &keyframe) < options.spacing_m) {
            figures.too_near += 1;
            continue;
        }
        let up_c = keyframe.up_c();
        map.add(keyframe, frames.features(Some(up_c)));
    }
    if map.is_empty() {
        let message =
            format!("none of the {} frames has a pose: are stamps and poses of one clock?", figures.frames);
        return Err(PlacesError::Nothing(message));
    }
    Ok((map, figures))
}

/// A frame and where it was found.
#[derive(Clone, Debug)]
pub struct LocatedFrame {
    /// Time of the frame.
    pub stamp: Timestamp,
    /// Number of features.
    pub features: usize,
    /// Pose that was found, if any.
    pub located: Option<Located>,
}

/// Locates every frame by itself, without an IMU: the rig is taken to be held as it was when the map was made, for the
/// turn of the patches, and nothing is assumed of it for the pose.
///
/// # Errors
/// When the data set cannot be read.
pub fn locate(
    frames: &mut RecordedFrames,
    map: &PlaceMap,
    options: &LocatorOptions,
    max_features: usize,
    mut each: impl FnMut(LocatedFrame),
) -> Result<(), PlacesError> {
    let mut locator = Locator::new(options, map.limits().keyframes, max_features);
    let up_c: Option<Vector3<f64>> = map.usual_up_c();
    let pose_b_c = frames.left().pose_b_c;
    while let Some(stamp) = frames.advance()? {
        let features = frames.features(up_c);
        let query = Query { features, pose_b_c, gravity: None, seed: stamp.as_nanos() as u64 };
        let located = locator.locate(map, &query, |_| true);
        each(LocatedFrame { stamp, features: features.len(), located });
    }
    Ok(())
}

/// The pose at a time, interpolated between its neighbours.
fn pose_at(poses: &[StampedPose], stamp: Timestamp) -> Option<Isometry3<f64>> {
    let after = poses.partition_point(|p| p.stamp < stamp);
    if let Some(exact) = poses.get(after).filter(|p| p.stamp == stamp) {
        return Some(exact.pose);
    }
    let (a, b) = (poses.get(after.checked_sub(1)?)?, poses.get(after)?);
    let gap_s = b.stamp.seconds_since(a.stamp);
    if gap_s > MAX_POSE_GAP_S {
        return None;
    }
    let share = stamp.seconds_since(a.stamp) / gap_s;
    let rotation = a.pose.rotation.slerp(&b.pose.rotation, share);
    let translation = a.pose.translation.vector.lerp(&b.pose.translation.vector, share);
    Some(Isometry3::from_parts(translation.into(), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_are_interpolated_between_near_neighbours_only() {
        let pose = |ms: i64, x: f64| StampedPose {
            stamp: Timestamp::from_nanos(ms * 1_000_000),
            pose: Isometry3::translation(x, 0.0, 0.0),
        };
        let poses = [pose(0, 0.0), pose(10, 1.0), pose(500, 2.0)];
        let x = |ms: i64| pose_at(&poses, Timestamp::from_nanos(ms * 1_000_000)).map(|p| p.translation.x);
        assert_eq!(x(0), Some(0.0));
        assert!((x(4).unwrap() - 0.4).abs() < 1e-12);
        assert_eq!(x(500), Some(2.0));
        assert!(x(100).is_none() && x(-1).is_none() && x(501).is_none());
    }
}
