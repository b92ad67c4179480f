//! The examples do what they say, and no image is copied.

#[allow(dead_code)]
#[path = "../examples/own_camera_buffer.rs"]
mod own_camera_buffer;
#[allow(dead_code)]
#[path = "../examples/stereo_from_directory.rs"]
mod stereo_from_directory;

use own_camera_buffer::record;
use plumbline_estimator::{Estimate, Estimator, HealthBits};
use plumbline_test_support::shared;
use std::path::PathBuf;

/// The stereo clip: a vehicle at rest, 95 frames of 752 x 480.
fn clip() -> Option<PathBuf> {
    shared("euroc/V1_01_easy_clip")
}

#[test]
fn stereo_from_a_directory_stays_where_it_stands() {
    let Some(clip) = clip() else { return };
    let mut poses = Vec::new();
    stereo_from_directory::estimate(&clip, |estimate| poses.extend(estimate.pose().copied())).unwrap();
    let (first, last) = (poses[0], poses[poses.len() - 1]);
    assert!(poses.len() > 85, "{} poses of 95 frames", poses.len());
    let drift_m = (last.translation.vector - first.translation.vector).norm();
    assert!(drift_m < 0.005, "{drift_m} m");
    // Tilt settles with the accelerometer's bias: the first pose has a standard deviation of 1 degree of it, and none of heading.
    let turn_deg = (last.rotation * first.rotation.inverse()).scaled_axis().map(f64::to_degrees);
    assert!(turn_deg.z.abs() < 0.1 && turn_deg.xy().norm() < 0.4, "{turn_deg}");
}

#[test]
fn padded_buffers_give_the_bits_of_whole_images() {
    let Some(clip) = clip() else { return };
    let mut expected: Vec<Estimate> = Vec::new();
    stereo_from_directory::estimate(&clip, |estimate| expected.push(estimate.clone())).unwrap();
    let (setup, shots) = record(&clip, 40).unwrap();
    assert_eq!((shots[0].left.width, shots[0].left.stride), (752, 768));
    let mut estimator = Estimator::new(&setup);
    for (shot, expected) in shots.iter().zip(&expected) {
        assert_eq!(shot.feed(&mut estimator).unwrap(), *expected);
    }
    assert!(expected[39].has_pose());
}

/// Not only are images not copied: no frame and no sample allocates anything, from the first on.
#[test]
fn no_image_is_copied_and_nothing_is_allocated_after_construction() {
    let Some(clip) = clip() else { return };
    let (setup, shots) = record(&clip, 40).unwrap();
    let mut estimator = None;
    let construction = allocation_counter::measure(|| estimator = Some(Estimator::new(&setup)));
    let mut estimator = estimator.unwrap();
    let mut last = None;
    let flight = allocation_counter::measure(|| {
        for shot in &shots {
            for sample in &shot.samples {
                estimator.propagate(sample);
            }
            last = Some(shot.feed(&mut estimator).unwrap());
        }
    });
    println!(
        "construction {} bytes, {} frames {} bytes",
        construction.bytes_total,
        shots.len(),
        flight.bytes_total
    );
    let last = last.unwrap();
    assert!(last.has_pose() && !last.health.contains(HealthBits::LEFT_MISSING));
    assert_eq!((flight.count_total, flight.bytes_total), (0, 0));
    // The counter does count: a copy of one image would be seen.
    let copy = allocation_counter::measure(|| drop(std::hint::black_box(shots[0].left.bytes.clone())));
    assert!(copy.bytes_total >= 752 * 480 && construction.count_total > 100);
}
