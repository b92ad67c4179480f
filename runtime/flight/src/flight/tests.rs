//! A flight that was recorded is flown again.

use super::*;
use crate::log::{Recorder, WhenFull};
use crate::pipeline::{Control, RunOptions};
use plumbline_config::options::ImageRecording;
use plumbline_simulator::InjectedFault;
use plumbline_simulator::{Scenario, Scene};

const OPTIONS: RunOptions = RunOptions { speed: None, threads: 1 };

/// A short flight in small images.
fn flight(images: ImageRecording) -> Flight {
    let scenario =
        Scenario { scene: Scene::Room, duration_s: 1.0, resolution_scale: 0.3, ..Scenario::default() };
    let mut flight = open_simulation(None, &scenario, false, 0.0, None).unwrap();
    flight.config = flight.config.with("test", |config| config.recorder.images = images).unwrap();
    flight
}

fn recorded(path: &std::path::Path, images: ImageRecording) -> Flown {
    let flight = flight(images);
    let mut recorder = Recorder::start(path, &flight.config, (None, 0), WhenFull::Wait).unwrap();
    let flown = fly(flight, &OPTIONS, &Control::default(), vec![&mut recorder]).unwrap();
    assert_eq!(recorder.finish().not_recorded, 0);
    flown
}

#[test]
fn a_log_is_flown_again_as_the_flight_was() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let first = recorded(&path, ImageRecording::Png);
    let again = open_log(&path, None, None, false).unwrap();
    let again = fly(again, &OPTIONS, &Control::default(), vec![]).unwrap();
    assert_eq!(again.outcome.estimate_digest, first.outcome.estimate_digest);
    assert_eq!(again.outcome.odometry_digest, first.outcome.odometry_digest);
    let stamps = |flown: &Flown| flown.poses.iter().map(|pose| pose.stamp).collect::<Vec<_>>();
    assert!(!first.poses.is_empty());
    assert_eq!(stamps(&again), stamps(&first));
}

#[test]
fn a_log_without_images_cannot_be_flown() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    recorded(&path, ImageRecording::None);
    assert!(open_log(&path, None, None, false).is_err());
}

#[test]
fn odometry_is_kept_at_the_rate_of_the_imu() {
    let mut odometry = OdometryTrajectory::with_room_for(300);
    let control = Control::default();
    let flown = fly(flight(ImageRecording::None), &OPTIONS, &control, vec![&mut odometry]).unwrap();
    let odometry = odometry.into_rows();
    assert!(odometry.len() > 8 * flown.poses.len(), "{} of {}", odometry.len(), flown.poses.len());
    assert!(odometry.windows(2).all(|pair| pair[1].stamp.nanos_since(pair[0].stamp) == 5_000_000));
}

#[test]
fn what_is_no_flight_is_refused_as_wrong_usage() {
    let refused = open_dataset(std::path::Path::new("/nowhere"), None, None, false).err().unwrap();
    assert!(refused.is_usage() && refused.to_string().contains("/nowhere"), "{refused}");
}

#[test]
fn injected_faults_reach_streams_and_calibration_whatever_the_threads() {
    let faults: Vec<InjectedFault> =
        ["stamp-jitter:2", "gyro-pulse:x:1@0.4", "rig-baseline:1.1"].map(|text| text.parse().unwrap()).into();
    let fly_with = |faults: &[InjectedFault], threads| {
        let flight = flight(ImageRecording::None).with_injected(faults, 3).unwrap();
        fly(flight, &RunOptions { threads, ..OPTIONS }, &Control::default(), vec![]).unwrap()
    };
    let (sound, faulty) = (fly_with(&[], 1), fly_with(&faults, 1));
    let baseline = |flown: &Flown| {
        (flown.config.camera[1].pose_b_c().translation.vector
            - flown.config.camera[0].pose_b_c().translation.vector)
            .norm()
    };
    assert!((baseline(&faulty) / baseline(&sound) - 1.1).abs() < 1e-9);
    assert_ne!(faulty.outcome.estimate_digest, sound.outcome.estimate_digest);
    assert_eq!(fly_with(&faults, 4).outcome.odometry_digest, faulty.outcome.odometry_digest);
    assert_eq!((sound.injected.len(), faulty.injected), (0, faults));
}
