//! Round trips: a data set that was written is read back the same.

use super::*;
use crate::{ImuReading, StereoFrame};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_config::ImuSample;
use plumbline_config::camera::Distortion;
use plumbline_config::options::{CameraConfig, ImuConfig};

/// Deterministic values with all digits in use.
fn noise(i: u64) -> f64 {
    let mixed = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed ^ (mixed >> 29)) as i32 as f64 / 7.3e8
}

struct Frames {
    next: u64,
    fail_at: u64,
}

impl StereoSource for Frames {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        let i = self.next;
        if i == self.fail_at {
            return Err(DriverError::refused("camera", "unplugged"));
        }
        self.next += 1;
        frame.stamp = Timestamp::from_nanos(frame_ns(i as i64) + i as i64 % 3);
        frame.valid = [true, i != 4];
        for (camera, image) in frame.images.iter_mut().enumerate() {
            for (k, pixel) in image.pixels_mut().iter_mut().enumerate() {
                *pixel = (noise(i * 1000 + k as u64) * 90.0) as i64 as u8 ^ camera as u8;
            }
        }
        Ok(i < 10)
    }

    fn expected_frames(&self) -> Option<u64> {
        Some(10)
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }
}

struct Samples(u64);

impl ImuSource for Samples {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        let i = self.0;
        self.0 += 1;
        let vector =
            |k| Vector3::new(noise(9 * i + k), noise(9 * i + k + 1) * 1e-9, noise(9 * i + k + 2) * 10.0);
        let stamp = Timestamp::from_nanos(START_NS + i as i64 * 5_000_001);
        let sample = ImuSample { stamp, gyro: vector(0), accel: vector(3) };
        Ok((i < 100).then_some(ImuReading { sequence: i, sample }))
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }
}

fn truth() -> Vec<TruthState> {
    let vector = |k| Vector3::new(noise(k), noise(k + 1), noise(k + 2));
    (0..20_u64)
        .map(|i| TruthState {
            stamp: Timestamp::from_nanos(START_NS + i as i64 * 25_000_003),
            pose_w_b: Isometry3::from_parts(
                vector(i).into(),
                UnitQuaternion::from_scaled_axis(vector(50 + i)),
            ),
            v_w_b: vector(100 + i),
            bias_gyro: vector(200 + i) * 1e-3,
            bias_accel: vector(300 + i) * 1e-2,
        })
        .collect()
}

fn config() -> Config {
    let camera = CameraConfig {
        width_px: SIZE.0,
        height_px: SIZE.1,
        rate_hz: 20.0,
        readout_s: 0.0,
        exposure_s: 0.0,
        mask: None,
        focal_px: [458.654, 457.296],
        centre_px: [8.0, 6.0],
        distortion: Distortion::RadialTangential { k1: -0.283, k2: 0.0739, p1: 1.9e-4, p2: 1.76e-5 },
        pose_b_c: [[1.0, 0.0, 0.0, 0.1], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
    };
    let imu = ImuConfig::with_noise(200.0, (1.7e-4, 2e-5), (2e-3, 3e-3));
    Config::new(vec![camera.clone(), camera], imu)
}

fn write_to(out: &Path, fail_at: u64, overwrite: bool) -> Result<Written, DriverError> {
    let (mut stereo, mut imu) = (Frames { next: 0, fail_at }, Samples(0));
    let inputs = WriteInputs {
        config: &config(),
        stereo: &mut stereo,
        imu: &mut imu,
        truth: &mut truth().into_iter(),
    };
    write(out, inputs, overwrite, &mut |_| {})
}

#[test]
fn a_round_trip_keeps_every_bit() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("deep/run1");
    let written = write_to(&out, u64::MAX, false).unwrap();
    assert_eq!(written, Written { frames: 10, images: 19, imu_samples: 100, truth_rows: 20 });
    let dataset = EurocDataset::open(&out, &EurocOptions::default()).unwrap();
    let sizes = dataset.sizes_px();
    let mut source = Frames { next: 0, fail_at: u64::MAX };
    for (back, sent) in all_frames(&mut dataset.stereo(), sizes).iter().zip(all_frames(&mut source, sizes)) {
        assert_eq!((back.stamp, back.valid), (sent.stamp, sent.valid));
        assert_eq!(back.images[0], sent.images[0]);
        assert!(!back.valid[1] || back.images[1] == sent.images[1]);
    }
    assert_eq!(dataset.frame_count(), 10);
    assert_eq!(all_readings(&mut dataset.imu()), all_readings(&mut Samples(0)));
    let back = dataset.ground_truth().unwrap().unwrap();
    assert_eq!(back.len(), 20);
    for (back, sent) in back.iter().zip(truth()) {
        assert_eq!((back.stamp, back.v_w_b, back.bias_gyro), (sent.stamp, sent.v_w_b, sent.bias_gyro));
        assert_eq!(back.pose_w_b.translation, sent.pose_w_b.translation);
        assert!(back.pose_w_b.rotation.angle_to(&sent.pose_w_b.rotation) < 1e-15);
        assert_eq!(back.bias_accel, sent.bias_accel);
    }
    let yaml = std::fs::read_to_string(out.join("mav0/cam1/sensor.yaml")).unwrap();
    assert!(yaml.contains("resolution: [16, 12]") && yaml.contains("data: [1.0, 0.0, 0.0, 0.1,\n"), "{yaml}");
    assert!(out.join("mav0/imu0/sensor.yaml").exists());
}

#[test]
fn what_is_there_is_not_overwritten_unless_told() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("notes.txt"), "mine").unwrap();
    let message = write_to(dir.path(), u64::MAX, false).unwrap_err().to_string();
    assert!(message.contains("exists and is not empty"), "{message}");
    write_to(dir.path(), u64::MAX, true).unwrap();
    write_to(dir.path(), u64::MAX, true).unwrap();
    assert_eq!(std::fs::read_to_string(dir.path().join("notes.txt")).unwrap(), "mine");
}

#[test]
fn a_failure_leaves_nothing_behind_and_the_old_one_whole() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("run");
    assert!(write_to(&out, 5, false).unwrap_err().to_string().contains("unplugged"));
    assert!(!out.exists());
    write_to(&out, u64::MAX, false).unwrap();
    assert!(write_to(&out, 5, true).is_err());
    assert!(!out.join("mav0.partial").exists());
    assert_eq!(EurocDataset::open(&out, &EurocOptions::default()).unwrap().frame_count(), 10);
}

#[test]
fn the_remains_of_a_killed_run_are_no_obstacle() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(dir.path().join("mav0.partial/cam0")).unwrap();
    write_to(dir.path(), u64::MAX, false).unwrap();
    assert!(!dir.path().join("mav0.partial").exists());
}
