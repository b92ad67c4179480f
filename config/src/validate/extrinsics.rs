//! Validation of extrinsics: whether a 4x4 matrix is a rigid transform, and whether two cameras make a
//! stereo pair.

use crate::error::Violation;
use crate::options::CameraConfig;
use nalgebra::{Matrix3, Vector3};

/// Largest deviation of `RᵀR` from the identity: a rotation written with four decimals passes.
const MAX_NON_ORTHONORMAL: f64 = 1e-3;
/// Largest distance of a camera from the body's origin, and from the other camera.
const MAX_DISTANCE_M: f64 = 5.0;
/// Shortest stereo baseline.
const MIN_BASELINE_M: f64 = 1e-3;
/// Largest angle between the optical axes of a stereo pair: beyond, the images hardly overlap.
const MAX_STEREO_ANGLE_RAD: f64 = 0.8;

/// Reason why a row-major 4x4 matrix is no plausible extrinsics, and the cure; `None` when it is one.
pub(crate) fn pose_problem(rows: &[[f64; 4]; 4]) -> Option<(String, &'static str)> {
    if rows.iter().flatten().any(|x| !x.is_finite()) {
        return Some(("contains NaN or infinity".into(), "give finite numbers"));
    }
    if rows[3] != [0.0, 0.0, 0.0, 1.0] {
        let cure = "write it row by row, with the translation in the last column; is this the transpose?";
        return Some((format!("the last row is {:?}, not [0, 0, 0, 1]", rows[3]), cure));
    }
    let r = Matrix3::from_fn(|i, j| rows[i][j]);
    let deviation = (r.transpose() * r - Matrix3::identity()).amax();
    // A sum of huge numbers may overflow to NaN, which is not small either.
    let is_orthonormal = deviation <= MAX_NON_ORTHONORMAL;
    if !is_orthonormal {
        let reason =
            format!("the upper-left 3x3 block is not a rotation (RᵀR differs from 1 by {deviation:.2e})");
        return Some((reason, "copy T_BC from the calibration with all its digits"));
    }
    if r.determinant() < 0.0 {
        let reason = "the upper-left 3x3 block is a reflection (determinant -1)".into();
        return Some((reason, "use right-handed frames: camera x right, y down, z forward"));
    }
    let distance = translation(rows).norm();
    if distance > MAX_DISTANCE_M {
        let reason = format!("the camera is {distance:.3} m from the IMU");
        return Some((reason, "write the translation in metres (is this in mm?)"));
    }
    None
}

fn translation(rows: &[[f64; 4]; 4]) -> Vector3<f64> {
    Vector3::new(rows[0][3], rows[1][3], rows[2][3])
}

/// Checks that two cameras can see the same things from different places.
pub(super) fn check_pair(cameras: &[CameraConfig], found: &mut Vec<Violation>) {
    let [left, right] = cameras else { return };
    if pose_problem(&left.pose_b_c).is_some() || pose_problem(&right.pose_b_c).is_some() {
        return;
    }
    let mut refuse = |reason, cure: &str| found.push(Violation::new("camera[1].pose_b_c", reason, cure));
    let baseline_m = (translation(&right.pose_b_c) - translation(&left.pose_b_c)).norm();
    if !(MIN_BASELINE_M..=MAX_DISTANCE_M).contains(&baseline_m) {
        let reason = format!("the stereo baseline to camera[0] is {baseline_m} m");
        refuse(reason, "give each camera its own T_BC, in metres; for one camera leave the second out");
    }
    let axis = |rows: &[[f64; 4]; 4]| Vector3::new(rows[0][2], rows[1][2], rows[2][2]);
    let angle_rad = axis(&left.pose_b_c).angle(&axis(&right.pose_b_c));
    if angle_rad > MAX_STEREO_ANGLE_RAD {
        let reason = format!("the optical axis is {angle_rad:.2} rad from that of camera[0]");
        refuse(reason, "check both T_BC (camera to body, not body to camera); the images must overlap");
    }
}
