use super::{is_fit, measure, missing, told};
use crate::{Checkup, Fitness, FrameInput, Measure};
use plumbline_config::{Config, import};
use plumbline_drivers::{EurocDataset, EurocOptions, ImuSource as _, StereoSource as _};
use std::path::Path;

/// What a data set shows, with the calibration that lies beside it.
fn checked(clip: &Path) -> Vec<Measure> {
    let config = import::euroc_into(Config::preset("euroc").unwrap(), clip).unwrap();
    let dataset = EurocDataset::open(clip, &EurocOptions::for_config(&config)).unwrap();
    let mut checkup = Checkup::new(&config);
    let (mut imu, mut stereo) = (dataset.imu(), dataset.stereo());
    let mut frame = dataset.new_frame();
    while stereo.next_frame(&mut frame).unwrap() {
        while checkup.needs_samples(frame.stamp) {
            let Some(reading) = imu.next_reading().unwrap() else { break };
            checkup.add_sample(reading.sequence, &reading.sample);
        }
        checkup.note_frame(frame.sequence, frame.stamp);
        let images = [frame.image(0), frame.image(1)];
        checkup.look_at(&FrameInput { sequence: Some(frame.sequence), stamp: frame.stamp, images });
    }
    checkup.report()
}

#[test]
fn real_images_of_one_piece_show_no_fault() {
    let Some(clip) = plumbline_test_support::shared("euroc/MH_01_motion") else { return };
    let report = checked(&clip);
    assert!(is_fit(&report), "{}", told(&report));
    assert_eq!(missing(&report), ["calibration"], "{}", told(&report));
}

#[test]
fn the_real_clip_of_a_drone_that_stands_is_fit() {
    let Some(clip) = plumbline_test_support::shared("euroc/V1_01_easy_clip") else { return };
    let report = checked(&clip);
    println!("{}", told(&report));
    assert!(is_fit(&report), "{}", told(&report));
    assert_eq!(measure(&report, "mounting").verdict, Fitness::Good, "{}", told(&report));
    for name in ["IMU timing", "camera timing"] {
        assert_eq!(measure(&report, name).verdict, Fitness::Good, "{}", told(&report));
    }
    let short = measure(&report, "calibration");
    assert!(short.is_missing() && short.value.starts_with("too short: 10 s of motion"), "{}", told(&report));
}
