//! Our odometry in an autopilot: PX4's own filter, fed by the messages of the bridge and the IMU of the flight.

mod capture;
mod ekf2;
mod flow;
mod udp;

use self::ekf2::FilterRun;
use capture::{Captured, capture};
use nalgebra::Vector3;
use plumbline_estimator::TrackingState;
use plumbline_simulator::{Effects, FlightPath, Scenario, Scene};
use plumbline_tests::shared;

/// Duration of the flight after that, s.
const AFTER_S: f64 = 6.0;

/// A flight whose images are black in full motion, from `dark_s.0` on for `dark_s.1`, s.
fn blackout(path: FlightPath, start_s: f64, scene: Scene, dark_s: (f64, f64)) -> Captured {
    let end_s = dark_s.0 + dark_s.1;
    capture(&Scenario {
        scene,
        path,
        start_s,
        duration_s: end_s + AFTER_S,
        resolution_scale: 0.5,
        effects: Effects { blackout: Some((dark_s.0, end_s)), ..Effects::default() },
        ..Scenario::default()
    })
}

/// Largest error of the velocity in the body among odometry that tracks, m/s: of all, and of the first after a restart.
fn odometry_errors(captured: &Captured) -> [f64; 2] {
    let (mut worst, mut first) = (0.0_f64, None);
    for o in captured.odometry.iter().filter(|o| o.state == TrackingState::Tracking && o.quality > 0) {
        let truth = captured.simulator.ground_truth(o.stamp);
        let in_body = |rot: nalgebra::UnitQuaternion<f64>, v: Vector3<f64>| rot.inverse() * v;
        let error = in_body(o.pose_o_b.rotation, o.v_o_b) - in_body(truth.pose_w_b.rotation, truth.v_w_b);
        worst = worst.max(error.norm());
        if o.reset_counter > 0 {
            first.get_or_insert(error.norm());
        }
    }
    [worst, first.unwrap_or(f64::NAN)]
}

/// Largest errors of EKF2's velocity in the body, m/s, and yaw, degrees, while it is told odometry that tracks; not in the
/// first second of all, while it starts, nor in the 200 ms that it waits after a silence.
fn worst(captured: &Captured, course: &FilterRun) -> [f64; 2] {
    let mut since = None;
    let mut worst = [0.0_f64; 2];
    let begin = captured.samples[0].stamp;
    for j in &course.judged {
        if !j.is_tracked {
            since = None;
            continue;
        }
        let since = *since.get_or_insert(j.stamp);
        if j.stamp.seconds_since(begin) > 1.5 && j.stamp.seconds_since(since) > 0.2 {
            worst = [worst[0].max(j.velocity_m_s), worst[1].max(j.yaw_deg.abs())];
        }
    }
    worst
}

/// Flies through darkness. In the dark EKF2 has the IMU alone, and its own tilt is then off: its velocity is allowed 0.2 m/s, or
/// 0.05 m/s more than it would have with the true velocity.
fn survives(name: &str, captured: &Captured) -> Result<(), String> {
    let course = ekf2::run(captured, &captured.messages, 0.0);
    let [by_itself_m_s, _] = worst(captured, &ekf2::run(captured, &ekf2::with_true_velocity(captured), 0.0));
    let [odometry_m_s, first_m_s] = odometry_errors(captured);
    let [velocity_m_s, yaw_deg] = worst(captured, &course);
    let last = captured.odometry.last().expect("there is odometry");
    println!(
        "{name}: odometry {odometry_m_s:.3} m/s (first after the restart {first_m_s:.3}), EKF2 {velocity_m_s:.3} m/s \
         ({by_itself_m_s:.3} with the true velocity), {yaw_deg:.2} deg; resets {}, jumps {}; fused {}, rejected {}",
        last.reset_counter, last.jumps, course.fused, course.rejected
    );
    let holds = odometry_m_s < 0.15
        && velocity_m_s < f64::max(0.2, by_itself_m_s + 0.05)
        && yaw_deg < 2.0
        && last.reset_counter == 1;
    let is_finite = captured.messages.iter().all(|(_, m)| {
        let all = m.q.iter().chain(&m.pose_covariance).chain(&m.velocity_covariance);
        all.chain(&[m.x, m.y, m.z, m.vx, m.vy, m.vz]).all(|x| x.is_finite())
    });
    if holds && is_finite { Ok(()) } else { Err(name.to_owned()) }
}

#[test]
fn a_blackout_of_seven_seconds_misleads_px4_in_nothing() {
    survives("room", &blackout(FlightPath::Demo, 4.0, Scene::Room, (5.0, 7.0))).unwrap();
}

/// Recorded paths, where in them, and how long it is dark, s. EKF2 learns the biases of the accelerometer in flight, and needs
/// them in the dark.
const FLIGHTS: [(&str, f64, f64); 6] = [
    ("V1_02_medium", 5.0, 6.0),
    ("V1_02_medium", 20.0, 8.0),
    ("V2_02_medium", 5.0, 7.0),
    ("V2_02_medium", 20.0, 9.0),
    ("MH_04_difficult", 10.0, 7.0),
    ("V1_03_difficult", 5.0, 6.0),
];

#[test]
#[ignore = "minutes; run by `make soak`"]
fn soak_blackouts_of_six_to_nine_seconds_mislead_px4_in_nothing() {
    let Some(shared) = shared("euroc/trajectories") else { return };
    let mut missed = Vec::new();
    for (path, start_s, dark_s) in FLIGHTS {
        let file = shared.join(format!("euroc/trajectories/{path}.tum.gz"));
        let captured = blackout(FlightPath::Tum(file), start_s, Scene::Room, (20.0, dark_s));
        missed.extend(survives(&format!("{path} from {start_s} s, dark for {dark_s} s"), &captured).err());
    }
    assert!(missed.is_empty(), "{missed:?}");
}

#[test]
fn px4_rejects_nothing_of_a_flight_through_the_room_and_finds_no_delay() {
    let captured = capture(&Scenario { duration_s: 20.0, resolution_scale: 0.5, ..Scenario::default() });
    let rms = |delay_ms: f64| {
        let course = ekf2::run(&captured, &captured.messages, delay_ms);
        let settled = course.judged.iter().skip(course.judged.len() / 4);
        let (sum, count) = settled.fold((0.0, 0.0), |(s, n), j| (s + j.velocity_m_s.powi(2), n + 1.0));
        let end_m = course.judged.last().expect("it flies").position_m;
        (f64::sqrt(sum / count), end_m, course.rejected, course.fused)
    };
    // Steps of its filter: it shifts the stamps by half of one itself.
    let delays = [-10.0, 0.0, 10.0, 20.0].map(|delay| (delay, rms(delay)));
    for (delay_ms, (rms_m_s, end_m, rejected, fused)) in delays {
        println!(
            "delay {delay_ms:+} ms: velocity {rms_m_s:.4} m/s, ends {end_m:.4} m off, {rejected} of {fused} rejected"
        );
    }
    let best = delays.iter().min_by(|a, b| a.1.0.total_cmp(&b.1.0)).expect("there are some");
    assert_eq!(best.0, 0.0, "the stamps are off");
    let (_, end_m, rejected, fused) = best.1;
    assert!(rejected == 0 && fused > 1000 && end_m < 0.02, "{rejected} of {fused}, {end_m} m");
}

mod realtime {
    use super::*;

    #[test]
    #[ignore = "half a minute, and a machine that keeps up: `make soak`"]
    fn soak_px4_follows_the_bridge_over_udp_through_a_blackout() {
        let folder = tempfile::tempdir().unwrap();
        let scenario = Scenario {
            start_s: 4.0,
            duration_s: 18.0,
            resolution_scale: 0.5,
            effects: Effects { blackout: Some((5.0, 12.0)), ..Effects::default() },
            ..Scenario::default()
        };
        let captured = udp::capture_live(&scenario, folder.path());
        survives("over UDP in real time", &captured).unwrap();
    }
}
