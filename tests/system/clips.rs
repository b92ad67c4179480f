//! The real clips: a rig at rest in stereo, a flight with one camera, a hand-held camera of unknown delay.

use plumbline_config::Timestamp;
use plumbline_estimator::Odometry;
use plumbline_estimator::propagator::blend::{MAX_SPEED_M_S, MAX_TURN_RAD_S};
use plumbline_flight::flight::{Cut, fly, open_dataset};
use plumbline_flight::pipeline::listener::{Listener, Producer, Subscriber};
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_lab::report::Report;
use plumbline_record::Said;
use plumbline_tests::shared;
use std::sync::{Arc, Mutex};

const OPTIONS: RunOptions = RunOptions { speed: None, threads: 2 };

#[test]
fn at_rest_nothing_drifts() {
    let Some(shared) = shared("euroc/V1_01_easy_clip") else { return };
    let flight = open_dataset(&shared.join("euroc/V1_01_easy_clip"), None, None, false).unwrap();
    let flown = fly(flight, &OPTIONS, &Control::default(), vec![]).unwrap();
    let (report, poses) = (Report::new(&flown), &flown.poses);
    assert!(poses.len() >= 90, "{} poses of {} frames", poses.len(), report.frames);
    assert_eq!(report.resets, 0);
    let [first, last] = [0, poses.len() - 1].map(|k| &poses[k].pose_o_b);
    let drift_m = (last.translation.vector - first.translation.vector).norm();
    let turn_deg = (last.rotation * first.rotation.inverse()).scaled_axis().map(f64::to_degrees);
    // Tilt settles with the accelerometer's bias: the first pose has a standard deviation of 1 degree of it, and none of heading.
    let (heading_deg, tilt_deg) = (turn_deg.z.abs(), turn_deg.xy().norm());
    println!(
        "{} poses, drift {drift_m:.5} m, heading {heading_deg:.4}, tilt {tilt_deg:.4} degrees",
        poses.len()
    );
    assert!(drift_m <= 0.005 && heading_deg <= 0.1 && tilt_deg <= 0.4);
}

#[test]
fn one_camera_in_flight_finds_scale_and_keeps_it_with_and_without_lines() {
    let Some(shared) = shared("euroc/MH_05_mono_clip") else { return };
    // A single flight scatters by a third, and neighbours err alike: starts are spread over the clip.
    let starts_s = [0.0, 0.7, 1.4, 2.1, 2.8, 3.5];
    let [with, without] = [true, false].map(|lines| {
        let errors = starts_s.map(|start_s| {
            let clip = shared.join("euroc/MH_05_mono_clip");
            let cut = Cut { frames: None, seconds: start_s..f64::INFINITY };
            let mut flight = open_dataset(&clip, None, cut, true).unwrap();
            flight.config = flight.config.with("test", |c| c.estimator.lines.enabled = lines).unwrap();
            let mut steps = Steps::default();
            let flown = fly(flight, &OPTIONS, &Control::default(), vec![&mut steps]).unwrap();
            steps.are_within_what_is_promised();
            keeps_scale(&Report::new(&flown))
        });
        let mean = |k: usize| errors.iter().map(|error| error[k]).sum::<f64>() / errors.len() as f64;
        let (mean_m, mean_scale) = (mean(0), mean(1));
        let worst_m = errors.iter().map(|error| error[0]).fold(0.0, f64::max);
        assert!(mean_m <= 0.09 && worst_m <= 0.15 && mean_scale <= 2.0, "{errors:?}");
        mean_m
    });
    assert!(with <= without, "lines make it worse: {with:.4} m, without {without:.4} m");
}

#[test]
fn a_camera_of_unknown_delay_finds_the_same_way_from_any_start() {
    let Some(shared) = shared("real/L515_mono") else { return };
    // All starts fly what is 20 s after the first image and later.
    let begin = Timestamp::from_nanos(1_650_458_716_848_712_921);
    let ways_m = [0.0, 3.0, 6.0].map(|start_s| {
        let cut = Cut { frames: None, seconds: start_s..f64::INFINITY };
        let flight = open_dataset(&shared.join("real/L515_mono"), None, cut, true).unwrap();
        let flown = fly(flight, &OPTIONS, &Control::default(), vec![]).unwrap();
        let report = Report::new(&flown);
        let common: Vec<_> =
            flown.poses.iter().filter(|pose| pose.stamp.seconds_since(begin) > 20.0).collect();
        let steps = common.windows(2).map(|pair| {
            let [from, to] = [pair[0], pair[1]].map(|pose| pose.pose_o_b.translation.vector);
            (to - from).norm()
        });
        let way_m: f64 = steps.sum();
        println!("from {start_s} s: first pose after {:.2?} s, way {way_m:.2} m", report.first_pose_s);
        // A start may be taken back within its probation.
        assert!(report.resets <= 1 && report.first_pose_s.is_some_and(|s| s < 5.0), "{report:?}");
        way_m
    });
    let [least, most] = [f64::min, f64::max].map(|of| ways_m.into_iter().reduce(of).unwrap());
    assert!(most < 1.1 * least, "{ways_m:?}");
}

/// ATE, m, and error of the scale, %, of a sound flight with one camera.
fn keeps_scale(report: &Report) -> [f64; 2] {
    let accuracy = report.accuracy.as_ref().unwrap();
    let scale_percent = accuracy.scale_error_percent.unwrap();
    println!("ATE {:.4} m, scale error {scale_percent:+.2} %", accuracy.ate_rmse_m);
    assert_eq!(report.resets, 0);
    assert!(report.first_pose_s.unwrap() <= 2.0);
    [accuracy.ate_rmse_m, scale_percent.abs()]
}

/// The largest steps of the 200 Hz odometry: what moves from one message to the next beyond the motion that they tell.
#[derive(Clone, Default)]
struct Steps(Arc<Mutex<Largest>>);

#[derive(Default)]
struct Largest {
    messages: u32,
    position_m: f64,
    turn_rad: f64,
    last: Option<Odometry>,
}

impl Subscriber for Steps {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match producer {
            Producer::Tick => Box::new(self.clone()),
            _ => Box::new(()),
        }
    }
}

impl Listener for Steps {
    fn said(&mut self, said: &Said) {
        let Said::Odometry(now) = said else { return };
        let mut largest = self.0.lock().unwrap();
        if let Some(last) = largest.last.replace(now.clone()).filter(|l| l.steps() == now.steps()) {
            let dt_s = now.stamp.seconds_since(last.stamp);
            let moved = now.pose_o_b.translation.vector - last.pose_o_b.translation.vector;
            let turned = last.pose_o_b.rotation.inverse() * now.pose_o_b.rotation;
            let told_m = (last.v_o_b + now.v_o_b) * (0.5 * dt_s);
            let told_rad = (last.angular_rate_b + now.angular_rate_b) * (0.5 * dt_s);
            largest.messages += 1;
            largest.position_m = largest.position_m.max((moved - told_m).norm());
            largest.turn_rad = largest.turn_rad.max((turned.scaled_axis() - told_rad).norm());
        }
    }
}

impl Steps {
    fn are_within_what_is_promised(&self) {
        let largest = self.0.lock().unwrap();
        let (messages, position_m, turn_rad) = (largest.messages, largest.position_m, largest.turn_rad);
        let (mm, mrad) = (1e3 * position_m, 1e3 * turn_rad);
        println!("steps of {messages} messages: at most {mm:.2} mm and {mrad:.3} mrad");
        // The velocity may still be on its way too, by up to 0.1 m/s; the bias of the gyroscope is corrected at once.
        assert!(messages > 1000 && position_m < (MAX_SPEED_M_S + 0.1) * 0.005, "{mm} mm");
        assert!(turn_rad < MAX_TURN_RAD_S * 0.005 + 1e-4, "{mrad} mrad");
    }
}
