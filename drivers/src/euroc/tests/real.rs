//! The real clips.

use super::*;
use crate::Prefetch;
use plumbline_test_support::shared;

#[test]
fn the_stereo_clip_ends_with_its_last_left_image() {
    let Some(path) = shared("euroc/V1_01_easy_clip") else { return };
    let dataset = EurocDataset::open(&path, &EurocOptions::default()).unwrap();
    assert_eq!(dataset.sizes_px(), [(752, 480); 2]);
    let mut stereo = Prefetch::new(dataset.stereo(), dataset.sizes_px(), 4).unwrap();
    let mut frame = dataset.new_frame();
    let mut frames = 0;
    while stereo.next_frame(&mut frame).unwrap() {
        assert_eq!((frame.sequence, frame.valid), (frames, [true, true]));
        frames += 1;
    }
    assert_eq!(frames, 95);
    assert_eq!(stereo.faults(), Faults { unpaired: 4, ..Faults::default() });
    let mut imu = dataset.imu();
    let readings = all_readings(&mut imu);
    let last = readings.last().unwrap().sample.stamp;
    assert!((0.09..=0.1).contains(&last.seconds_since(dataset.span().1)));
    assert_eq!(imu.faults(), Faults::default());
    assert_eq!(readings.last().unwrap().sequence, readings.len() as u64 - 1);
}

#[test]
fn the_monocular_clip_has_ground_truth() {
    let Some(path) = shared("euroc/MH_05_mono_clip") else { return };
    let dataset = EurocDataset::open(&path, &EurocOptions::default()).unwrap();
    assert_eq!((dataset.cameras(), dataset.frame_count()), (1, 300));
    let options = EurocOptions { frames: Some(0..20), ..EurocOptions::default() };
    let start = EurocDataset::open(&path, &options).unwrap();
    let mut stereo = start.stereo();
    let frames = all_frames(&mut stereo, start.sizes_px());
    assert!(frames.iter().all(|f| f.valid == [true, false] && f.images[0].pixels().iter().any(|&p| p > 50)));
    assert_eq!(stereo.faults(), Faults::default());
    let truth = dataset.ground_truth().unwrap().unwrap();
    assert_eq!(truth.len(), 3031);
    assert_eq!(truth[0].stamp.as_nanos(), 1_403_638_538_477_829_376);
    assert!((truth[0].pose_w_b.rotation.w - 0.183604).abs() < 1e-5);
    assert!((truth[0].bias_accel.y - 0.124949).abs() < 1e-12);
    let readings = all_readings(&mut dataset.imu());
    assert!(readings.len() > 3000);
}
