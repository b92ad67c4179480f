//! A map as a point cloud (PLY, Turk 1994): the points of all keyframes, and the keyframes' places.

use plumbline_estimator::places::PlaceMap;
use std::fmt::Write as _;

/// Colour of points, dark where they are known badly.
const POINT_GREY: [f64; 2] = [230.0, 60.0];
/// Colour of keyframes.
const KEYFRAME: &str = "255 80 0";

/// The text of the file.
#[must_use]
pub fn ply(map: &PlaceMap) -> String {
    let mut body = String::new();
    let mut count = 0;
    for (slot, keyframe) in map.keyframes() {
        let pose_m_c = keyframe.pose_m_c();
        for feature in map.features(slot).iter().filter(|f| f.is_point()) {
            let p = pose_m_c * nalgebra::Point3::from(feature.position_c());
            let relative = f64::from(feature.sigma_inverse_depth / feature.inverse_depth);
            let grey = (POINT_GREY[0] - 700.0 * relative).max(POINT_GREY[1]) as u8;
            let _ = writeln!(body, "{:.4} {:.4} {:.4} {grey} {grey} {grey}", p.x, p.y, p.z);
            count += 1;
        }
    }
    for (_, keyframe) in map.keyframes() {
        let p = keyframe.pose_m_b.translation;
        let _ = writeln!(body, "{:.4} {:.4} {:.4} {KEYFRAME}", p.x, p.y, p.z);
        count += 1;
    }
    let properties = "property float x\nproperty float y\nproperty float z\n\
                      property uchar red\nproperty uchar green\nproperty uchar blue\n";
    format!(
        "ply\nformat ascii 1.0\ncomment map of Plumbline, metres, z up\nelement vertex {count}\n{properties}end_header\n{body}"
    )
}
