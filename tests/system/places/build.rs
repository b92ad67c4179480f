//! Maps from stereo images with known poses, and images located in them.

use super::frames::RecordedFrames;
use nalgebra::Vector3;
use plumbline_config::Timestamp;
use plumbline_drivers::{DriverError, StampedPose};
use plumbline_estimator::places::refine::Gravity;
use plumbline_estimator::places::{Keyframe, Located, Locator, LocatorOptions, MapLimits, PlaceMap, Query};

/// Uncertainty of the vertical, rad.
const SIGMA_VERTICAL_RAD: f64 = 0.01;

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
        map.add(keyframe, frames.features(up_c));
    }
    Ok(map)
}

/// A frame and where it was found.
pub struct LocatedFrame {
    pub stamp: Timestamp,
    pub located: Option<Located>,
}

/// Locates every frame by itself; `up_b` says which way is up in the body.
pub fn locate(
    frames: &mut RecordedFrames,
    map: &PlaceMap,
    up_b: impl Fn(Timestamp) -> Vector3<f64>,
    mut each: impl FnMut(LocatedFrame),
) -> Result<(), DriverError> {
    let limits = map.limits();
    let mut locator = Locator::new(&LocatorOptions::default(), limits.keyframes, limits.features);
    let pose_b_c = frames.left().pose_b_c;
    while let Some(stamp) = frames.advance()? {
        let up_b = up_b(stamp);
        let features = frames.features(pose_b_c.rotation.inverse() * up_b);
        let gravity = Gravity { up_b, sigma_rad: SIGMA_VERTICAL_RAD };
        let query = Query { features, pose_b_c, gravity, seed: stamp.as_nanos() as u64 };
        each(LocatedFrame { stamp, located: locator.locate(map, &query, |_| true) });
    }
    Ok(())
}
