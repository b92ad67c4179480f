//! Maps from stereo images with known poses, and images located in them.

use super::frames::RecordedFrames;
use plumbline_config::Timestamp;
use plumbline_drivers::{DriverError, StampedPose};
use plumbline_estimator::places::{Keyframe, Located, Locator, LocatorOptions, MapLimits, PlaceMap, Query};

/// Makes a map of the frames, each of which has a pose.
pub fn build(
    frames: &mut RecordedFrames,
    poses: &[StampedPose],
    limits: MapLimits,
) -> Result<PlaceMap, DriverError> {
    let mut map = PlaceMap::new(limits);
    let pose_b_c = frames.left().pose_b_c;
    while let Some(stamp) = frames.advance()? {
        let pose_m_b = poses.iter().find(|p| p.stamp == stamp).expect("each image has a pose").pose;
        let keyframe = Keyframe::new(0, stamp, pose_m_b, pose_b_c);
        let up_c = keyframe.up_c();
        map.add(keyframe, frames.features(Some(up_c)));
    }
    Ok(map)
}

/// A frame and where it was found.
pub struct LocatedFrame {
    pub stamp: Timestamp,
    pub located: Option<Located>,
}

/// Locates every frame by itself, without an IMU: the rig is taken to be held as it was when the map was made, for the
/// turn of the patches, and nothing is assumed of it for the pose.
pub fn locate(
    frames: &mut RecordedFrames,
    map: &PlaceMap,
    options: &LocatorOptions,
    max_features: usize,
    mut each: impl FnMut(LocatedFrame),
) -> Result<(), DriverError> {
    let mut locator = Locator::new(options, map.limits().keyframes, max_features);
    let up_c = map.usual_up_c();
    let pose_b_c = frames.left().pose_b_c;
    while let Some(stamp) = frames.advance()? {
        let features = frames.features(up_c);
        let query = Query { features, pose_b_c, gravity: None, seed: stamp.as_nanos() as u64 };
        each(LocatedFrame { stamp, located: locator.locate(map, &query, |_| true) });
    }
    Ok(())
}
