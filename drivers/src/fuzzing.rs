//! What the fuzzers call (`fuzz/`): each function takes any bytes, and a panic is a finding.
//!
//! The same functions run over the checked-in seeds, and over seeded mutations of them, in the tests of this crate.

use crate::euroc::image::gray_png;
use crate::euroc::imu::{IMU_COLUMNS, ImuRecord, parse_imu_row};
use crate::euroc::pairing::{self, IMAGE_COLUMNS, ImageRow, parse_image_row};
use crate::euroc::table::{Stamped, Table, read_rows};
use crate::euroc::truth::{TRUTH_COLUMNS, parse_truth_row};
use crate::tum::{read_tum_from, write_pose};
use crate::v4l2::fuzzing as camera;
use plumbline_config::Timestamp;
use std::path::Path;

/// Largest image, px: larger ones make the fuzzer slow and show nothing more.
const MAX_SIDE_PX: usize = 256;
/// Difference of stamps within a stereo pair, ns: two milliseconds.
const PAIR_TOLERANCE_NS: i64 = 2_000_000;

fn no_file() -> &'static Path {
    Path::new("fuzz")
}

/// An image: what is read has the size that its header says.
///
/// # Panics
/// When it has not.
pub fn png(data: &[u8]) {
    if let Ok(image) = gray_png(no_file(), data, 1..=MAX_SIDE_PX) {
        assert_eq!(image.pixels().len(), image.width() * image.height());
    }
}

/// The tables of a EuRoC data set: images, paired, inertial samples, ground truth.
///
/// # Panics
/// When rows come back out of order, or with what is no number.
pub fn euroc_csv(data: &[u8]) {
    if let Ok(table) = read_rows(no_file(), IMU_COLUMNS, data, parse_imu_row) {
        check_order(&table);
        assert!(table.rows.iter().all(|s| s.gyro.iter().chain(&s.accel).all(|x| x.is_finite())));
        assert!(ImuRecord::new(table).span().is_some());
    }
    if let Ok(table) = read_rows(no_file(), TRUTH_COLUMNS, data, parse_truth_row) {
        check_order(&table);
        assert!(table.rows.iter().all(|s| (s.pose_w_b.rotation.norm() - 1.0).abs() < 1e-9));
    }
    if let Ok(table) = read_rows(no_file(), IMAGE_COLUMNS, data, parse_image_row) {
        check_order(&table);
        pair(&table.rows);
    }
}

fn check_order<T: Stamped>(table: &Table<T>) {
    assert!(!table.rows.is_empty());
    assert!(table.rows.is_sorted_by(|a, b| a.stamp() < b.stamp()));
}

/// Pairs every other row with the rest: each image is handed out once or counted.
fn pair(rows: &[ImageRow]) {
    let of_camera = |camera: usize| rows.iter().skip(camera).step_by(2).cloned().collect::<Vec<_>>();
    let pairing = pairing::stereo(of_camera(0), of_camera(1), PAIR_TOLERANCE_NS);
    let handed_out = pairing.frames.iter().flat_map(|frame| frame.files.iter().flatten()).count();
    assert_eq!(handed_out as u64 + pairing.outside, rows.len() as u64);
    assert!(pairing.frames.is_sorted_by(|a, b| (a.stamp, a.sequence) <= (b.stamp, b.sequence)));
    assert_eq!(pairing::monocular(rows.to_vec()).frames.len(), rows.len());
}

/// A trajectory: what is read can be written, and has the same stamps when it is read again.
///
/// # Panics
/// When it has not.
pub fn tum(data: &[u8]) {
    let Ok(poses) = read_tum_from(no_file(), data) else { return };
    let mut text = Vec::new();
    for pose in &poses {
        assert!(pose.pose.translation.vector.iter().all(|x| x.is_finite()));
        write_pose(&mut text, pose).expect("memory takes everything");
    }
    let Ok(back) = read_tum_from(no_file(), text.as_slice()) else {
        panic!("what was written is refused: {}", String::from_utf8_lossy(&text));
    };
    let stamps = |poses: &[crate::StampedPose]| poses.iter().map(|p| p.stamp).collect::<Vec<Timestamp>>();
    assert_eq!(stamps(&back), stamps(&poses));
}

/// An image of a camera (JPEG): rows come in order and whole, an image that is accepted has all of them.
///
/// # Panics
/// When they do not.
pub fn mjpeg(data: &[u8]) {
    camera::mjpeg(data, MAX_SIDE_PX);
}

/// A driver's buffer of any layout, which the first bytes say: it is read within its bounds, or refused.
///
/// # Panics
/// When it is not.
pub fn camera_buffer(data: &[u8]) {
    camera::buffer(data);
}

#[cfg(test)]
#[path = "../../fuzz/smoke.rs"]
mod smoke;

#[cfg(test)]
mod tests {
    use super::smoke::over_seeds_and_mutations;

    #[test]
    fn fuzz_png() {
        over_seeds_and_mutations("png", 5000, super::png);
    }

    #[test]
    fn fuzz_euroc_csv() {
        over_seeds_and_mutations("euroc_csv", 5000, super::euroc_csv);
    }

    #[test]
    fn fuzz_mjpeg() {
        over_seeds_and_mutations("mjpeg", 5000, super::mjpeg);
    }

    #[test]
    fn fuzz_camera_buffer() {
        over_seeds_and_mutations("camera_buffer", 5000, super::camera_buffer);
    }

    #[test]
    fn fuzz_tum() {
        over_seeds_and_mutations("tum", 5000, super::tum);
    }
}
