//! The path.

use super::*;

/// The path grows, and is what was computed.
pub(super) fn check_paths(seen: &Seen) {
    let paths = seen.samples("/drone_1/path");
    assert!(paths.iter().all(|sample| sample["same_bytes"] == true));
    let newest = paths.last().expect("there are samples");
    check_path(seen, newest);
    let poses = |path: &Value| path["message"]["poses"].as_array().unwrap().len();
    assert!((2..=5).contains(&paths.len()) && poses(newest) > poses(paths[0]), "{}", paths.len());
}

/// Poses of the vehicle, in order of time, as they were computed.
fn check_path(seen: &Seen, sample: &Value) {
    let path = &sample["message"];
    let poses = path["poses"].as_array().unwrap();
    assert!(poses.len() >= 5, "{} poses", poses.len());
    assert_eq!(path["header"]["stamp"], poses[poses.len() - 1]["header"]["stamp"]);
    let stamps: Vec<i64> = poses.iter().map(|pose| stamp_ns(&pose["header"])).collect();
    assert!(stamps.is_sorted());
    for (pose, stamp) in poses.iter().zip(stamps) {
        assert_eq!(pose["header"]["frame_id"], "odom");
        is_computed(&seen.computed, stamp, &pose["pose"]["position"], &pose["pose"]["orientation"]);
    }
}
