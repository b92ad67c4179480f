//! Clocks of sensors that jump: refused, counted, and over within a second, in virtual time and against the clock.

use plumbline_config::Timestamp;
use plumbline_drivers::{DriverError, Faults, ImuReading, ImuSource, StampedPose, StereoFrame, StereoSource};
use plumbline_flight::flight::{Flight, Flown, OdometryTrajectory, fly};
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_simulator::{Scenario, Scene};
use plumbline_tests::simulated;

const HOUR_S: f64 = 3600.0;
const DURATION_S: f64 = 4.0;

/// By how much a stamp is wrong, s, `t` seconds after the first of its stream.
type Clock = fn(t: f64) -> f64;

/// A source with another clock.
struct Clocked<S> {
    source: S,
    clock: Clock,
    first: Option<Timestamp>,
}

impl<S> Clocked<S> {
    fn set(&mut self, stamp: &mut Timestamp) {
        let t = stamp.seconds_since(*self.first.get_or_insert(*stamp));
        *stamp = stamp.plus_seconds((self.clock)(t));
    }
}

impl ImuSource for Clocked<Box<dyn ImuSource>> {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        let mut reading = self.source.next_reading()?;
        if let Some(reading) = &mut reading {
            self.set(&mut reading.sample.stamp);
        }
        Ok(reading)
    }

    fn faults(&self) -> Faults {
        self.source.faults()
    }
}

impl StereoSource for Clocked<Box<dyn StereoSource>> {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        let is_there = self.source.next_frame(frame)?;
        self.set(&mut frame.stamp);
        Ok(is_there)
    }

    fn expected_frames(&self) -> Option<u64> {
        self.source.expected_frames()
    }

    fn faults(&self) -> Faults {
        self.source.faults()
    }
}

/// Four seconds in the room by these clocks of IMU and cameras.
fn flown(imu: Clock, cameras: Clock, speed: Option<f64>) -> (Flown, Vec<StampedPose>) {
    let scenario = Scenario {
        scene: Scene::Room,
        start_s: 2.0,
        duration_s: DURATION_S,
        seed: 1,
        resolution_scale: 0.4,
        ..Scenario::default()
    };
    let flight = simulated(&scenario);
    let flight = Flight {
        imu: Box::new(Clocked { source: flight.imu, clock: imu, first: None }),
        stereo: Box::new(Clocked { source: flight.stereo, clock: cameras, first: None }),
        ..flight
    };
    let mut odometry = OdometryTrajectory::with_room_for(1000);
    let options = RunOptions { speed, threads: 2 };
    let flown = fly(flight, &options, &Control::default(), vec![&mut odometry]).unwrap();
    (flown, odometry.into_rows())
}

/// One stamp an hour ahead, two seconds into the flight.
fn once(t: f64) -> f64 {
    if (1.999..2.004).contains(&t) { HOUR_S } else { 0.0 }
}

fn only_that_was_lost(speed: Option<f64>) {
    let (flown, odometry) = flown(once, once, speed);
    let figures = &flown.outcome.figures;
    assert_eq!((figures.imu_refused, figures.resets), (1, 0));
    assert!(figures.frames_refused >= 1, "the frame is counted");
    if speed.is_none() {
        assert_eq!(figures.frames_refused, 1);
    }
    assert!(flown.poses.len() as f64 > 17.0 * DURATION_S, "{} poses", flown.poses.len());
    assert!(odometry.len() as f64 > 180.0 * DURATION_S, "odometry for {} samples", odometry.len());
    let longest_s = odometry.windows(2).map(|p| p[1].stamp.seconds_since(p[0].stamp)).fold(0.0, f64::max);
    assert!(longest_s < 0.011, "odometry is missing for {longest_s} s");
}

#[test]
fn a_sample_and_a_frame_an_hour_ahead_cost_themselves() {
    only_that_was_lost(None);
}

#[test]
fn against_the_clock_nothing_waits_for_a_stamp_an_hour_ahead() {
    only_that_was_lost(Some(1.0));
}

#[test]
fn clocks_that_are_set_back_an_hour_cost_less_than_a_second_and_one_reset() {
    let back: Clock = |t| if t < 2.0 { 0.0 } else { -HOUR_S };
    let (flown, odometry) = flown(back, back, None);
    let figures = &flown.outcome.figures;
    assert_eq!(figures.resets, 1);
    assert!(figures.imu_refused >= 20 && figures.frames_refused >= 2, "they are counted");
    let after: Vec<_> = odometry.windows(2).filter(|p| p[1].stamp < p[0].stamp).collect();
    let [jump] = after[..] else { panic!("the clock is set once: {after:?}") };
    let lost_s = jump[1].stamp.seconds_since(jump[0].stamp) + HOUR_S;
    assert!(lost_s < 1.0, "{lost_s} s without odometry");
    let ends_s = odometry[odometry.len() - 1].stamp.seconds_since(jump[1].stamp);
    assert!(ends_s + lost_s > 1.9, "and then to the end, for {ends_s} s");
}
