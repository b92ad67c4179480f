//! Starts anew in flight: from where, with which biases, and on which calibration.

use super::synthetic::{World, config, stamp};
use super::*;
use crate::estimate::TrackingState;
use crate::geometry::exp_so3;
use crate::input::ResetKind;
use crate::window::state::Rig;
use plumbline_config::{ImuSample, ValidSetup};

/// A flight, frame by frame.
struct Flight {
    world: World,
    odometer: Odometer,
    tracked: Tracked,
    feedback: Feedback,
    is_dark: bool,
    /// Reading of the clock at the beginning, s.
    clock_s: f64,
    next_frame: u32,
    last: Option<Estimate>,
}

impl Flight {
    fn new(setup: &ValidSetup) -> Self {
        Self {
            world: World::new(setup, 7, 300),
            odometer: Odometer::new(setup),
            tracked: Tracked::new(setup),
            feedback: Feedback::new(setup),
            is_dark: false,
            clock_s: 0.0,
            next_frame: 0,
            last: None,
        }
    }

    /// Time of the frame that was flown last, s.
    fn t(&self) -> f64 {
        0.15 + f64::from(self.next_frame) * 0.05
    }

    fn frame(&mut self, reset: Option<ResetKind>) -> &Estimate {
        self.next_frame += 1;
        let t = self.t();
        self.tracked.samples.clear();
        let by_clock = |s: ImuSample| ImuSample { stamp: s.stamp.plus_seconds(self.clock_s), ..s };
        self.tracked.samples.extend(self.world.samples_to(t).into_iter().map(by_clock));
        self.tracked.points = self.world.observe(t, [!self.is_dark; 2]);
        self.tracked.sequence = u64::from(self.next_frame);
        self.tracked.time = FrameTime { stamp: stamp(t + self.clock_s), time_offset_s: 0.0 };
        self.tracked.reset = reset;
        self.last.insert(self.odometer.process(&self.tracked, &mut (), &mut self.feedback))
    }

    fn frames(&mut self, count: usize) -> &Estimate {
        for _ in 1..count {
            self.frame(None);
        }
        self.frame(None)
    }

    /// Frames until there is a pose; it.
    fn until_pose(&mut self) -> Estimate {
        for _ in 0..80 {
            let estimate = self.frame(None);
            if estimate.has_pose() {
                return estimate.clone();
            }
        }
        panic!("never starts: {:?}", self.last);
    }

    /// The position of the estimate against the truth, m, given that of a frame before.
    fn error_m(&self, then: &(Estimate, f64)) -> f64 {
        let (before, t) = then;
        let now = self.last.as_ref().expect("has flown");
        let (from, to) = (self.world.pose_o_b(*t), self.world.pose_o_b(self.t()));
        let moved =
            (before.pose_o_b * from.inverse()).rotation * (to.translation.vector - from.translation.vector);
        (now.pose_o_b.translation.vector - before.pose_o_b.translation.vector - moved).norm()
    }
}

#[test]
fn the_first_pose_after_darkness_knows_velocity_and_heading() {
    let mut flight = biased(2);
    let before = flight.frames(100).clone();
    let turned = before.pose_o_b.rotation * flight.world.pose_o_b(flight.t()).rotation.inverse();
    flight.is_dark = true;
    assert_eq!(flight.frames(140).state, TrackingState::Failed);
    flight.is_dark = false;
    let first = flight.until_pose();
    assert_eq!((first.state, first.reset_counter), (TrackingState::Tracking, 1));
    let v_b = first.pose_o_b.rotation.inverse() * first.v_o_b;
    let error_m_s = (v_b - flight.world.v_b(flight.t())).norm();
    assert!(error_m_s < 0.05, "the first velocity is off by {error_m_s} m/s");
    let up_b = |rotation: &nalgebra::UnitQuaternion<f64>| rotation.inverse() * Vector3::z();
    let tilt_rad = up_b(&first.pose_o_b.rotation).angle(&up_b(&flight.world.pose_o_b(flight.t()).rotation));
    assert!(tilt_rad < 0.025, "the first tilt is off by {tilt_rad} rad");
    let quality = flight.odometer.judge.quality(&flight.odometer.estimation, 100);
    assert!(quality > 80, "{quality}");
    // The gyroscope went on measuring in the dark.
    let expected = turned * flight.world.pose_o_b(flight.t()).rotation;
    let heading_deg =
        crate::geometry::yaw_of(&(first.pose_o_b.rotation * expected.inverse())).abs().to_degrees();
    assert!(heading_deg < 2.0, "the heading is off by {heading_deg} degrees");
    let share = first.origin.covariance[(3, 3)].sqrt().to_degrees();
    assert!(share < 3.0, "a heading that was measured is known to {share} degrees");
}

/// Standard deviation of the tilt of the first pose after a second of darkness in which so many samples are missing, rad.
fn tilt_sigma_after_darkness(missing: u32) -> f64 {
    let mut flight = biased(2);
    flight.frames(100);
    flight.frame(Some(ResetKind::Soft));
    flight.is_dark = true;
    flight.frames(10);
    flight.world.next_imu += missing;
    flight.frames(10);
    flight.is_dark = false;
    let _ = flight.until_pose();
    flight.odometer.estimation.tilt_sigma_rad()
}

#[test]
fn a_start_anew_takes_over_the_tilt_where_the_gyroscope_measured_all_the_way() {
    let (carried_rad, lost_rad) = (tilt_sigma_after_darkness(0), tilt_sigma_after_darkness(40));
    assert!(carried_rad < 0.03 && carried_rad < 0.5 * lost_rad, "{carried_rad} and {lost_rad} rad");
}

#[test]
fn a_turn_while_the_clock_is_set_is_no_measured_one() {
    for clock_s in [-10.0, 100.0] {
        let mut flight = biased(2);
        flight.frames(100);
        // Samples and frames of 0.2 s are refused meanwhile.
        flight.clock_s = clock_s;
        flight.next_frame += 4;
        flight.world.next_imu += 40;
        flight.tracked.is_clock_set = true;
        flight.frame(None);
        flight.tracked.is_clock_set = false;
        let first = flight.until_pose();
        let tilt_sigma_rad = flight.odometer.estimation.tilt_sigma_rad();
        assert!(tilt_sigma_rad > 5e-3, "{clock_s}: gravity tells the tilt, to {tilt_sigma_rad} rad");
        let of_heading = first.origin.covariance[(3, 3)].sqrt();
        let of_way = first.origin.covariance[(0, 0)].sqrt();
        assert!(of_heading > 0.25 && (0.3..5.0).contains(&of_way), "{clock_s}: {of_heading} rad, {of_way} m");
    }
}

#[test]
fn a_start_anew_inherits_what_a_dispute_left_uncertain() {
    let mut flight = biased(2);
    flight.frames(60);
    let disputed = flight.odometer.estimation.covariance + NavCovariance::identity() * 25.0;
    let Odometer { estimation, start, phase, .. } = &mut flight.odometer;
    start.prepare(estimation, disputed, ResetKind::Soft);
    estimation.window.clear();
    *phase = Phase::Gathering;
    assert!(flight.until_pose().covariance[(0, 0)] > 24.0);
}

#[test]
fn a_hard_reset_forgets_the_noise_of_the_flight() {
    let mut flight = biased(2);
    flight.frames(5);
    let stated = crate::inertial::ImuNoise::of(&flight.world.config.imu);
    assert_ne!(flight.odometer.estimation.window.imu_noise, stated);
    flight.odometer.estimation.window.options.point_sigma = 2.0;
    flight.odometer.reset(ResetKind::Hard);
    let Window { imu_noise, options, .. } = &flight.odometer.estimation.window;
    assert_eq!((*imu_noise, options.point_sigma), (stated, 1.0));
}

#[test]
fn motions_that_are_integrated_anew_are_as_doubtful_as_before() {
    let mut flight = biased(2);
    flight.frames(60);
    let newest = |flight: &Flight| {
        let frame = flight.odometer.estimation.window.frames.last().and_then(|frame| frame.inertial.as_ref());
        frame.map(|inertial| inertial.motion.covariance).unwrap_or_default()
    };
    let Estimation { window, .. } = &mut flight.odometer.estimation;
    let since = window.frames[window.frames.len() - 2].stamp;
    window.doubt_forces(since, 20.0);
    let doubted = newest(&flight);
    flight.odometer.estimation.window.doubt_forces(since, 20.0);
    assert_eq!(newest(&flight), doubted, "the same doubt counts once");
    flight.odometer.estimation.integrate_anew(since, 4e-6);
    let anew = newest(&flight);
    assert!((6..9).all(|k| anew[(k, k)] >= 0.999 * doubted[(k, k)] && doubted[(k, k)] > 0.9));
    flight.odometer.estimation.integrate_anew(since, 0.0);
    assert!((newest(&flight) - anew).norm() < 1e-6 * anew.norm(), "its ends are as uncertain");
}

#[test]
fn a_state_that_no_frame_tells_of_right_after_the_start_is_known_less_and_less_well() {
    let mut flight = biased(2);
    let _ = flight.until_pose();
    let mut last = flight.odometer.estimation.covariance;
    for k in 0..5 {
        flight.odometer.carry_covariance(None);
        let now = flight.odometer.estimation.covariance;
        assert!([0, 3, 6].into_iter().all(|part| now[(part, part)] > last[(part, part)]), "{k}: {now}");
        last = now;
    }
}

#[test]
fn a_start_without_a_known_velocity_publishes_no_pose() {
    let mut flight = biased(2);
    flight.frames(20);
    flight.odometer.estimation.covariance = NavCovariance::identity() * 400.0;
    flight.odometer.judge.begin(stamp(flight.t()));
    flight.odometer.judge.judge_start(&flight.odometer.estimation);
    let unknown = flight.odometer.estimate(&flight.tracked, HealthBits::default(), Solved::default());
    assert_eq!((unknown.state, unknown.quality), (TrackingState::Initialising, -1));
    assert!(!unknown.has_pose());
    // The next frame knows it.
    assert_eq!(flight.frame(None).state, TrackingState::Tracking);
}

/// Biases of the gyroscope as large as those of the sensor of EuRoC.
fn biased(cameras: usize) -> Flight {
    let mut flight = Flight::new(&config(cameras));
    flight.world.bias_gyro = Vector3::new(-0.05, 0.08, 0.06);
    flight
}

#[test]
fn a_start_anew_begins_with_the_biases_that_were_known() {
    for cameras in [1, 2] {
        let mut flight = biased(cameras);
        let bias = flight.world.bias_gyro;
        let before = flight.frames(160).clone();
        assert!((before.bias_gyro - bias).norm() < 2e-3, "{cameras}: {}", before.bias_gyro);
        flight.frame(Some(ResetKind::Soft));
        // The front-end predicts by it while there is no pose.
        let heard = flight.feedback.bias_gyro;
        assert!((heard - bias).norm() < 2e-3, "{cameras} cameras: the front-end is told {heard}");
        let first = flight.until_pose();
        let error = (first.bias_gyro - bias).norm();
        assert!(error < 5e-3, "{cameras} cameras: the first pose has a bias off by {error}");
    }
}

#[test]
fn a_hard_reset_forgets_biases_and_calibration() {
    let mut flight = biased(2);
    let configured = Rig::of(&flight.world.config);
    flight.frames(40);
    // As an estimate that diverges leaves it.
    flight.odometer.estimation.window.rig.pose_b_c0.rotation *= exp_so3(&Vector3::new(0.02, 0.0, 0.0));
    flight.odometer.estimation.window.rig.time_offset_s += 0.01;
    flight.frame(Some(ResetKind::Hard));
    assert_eq!(flight.odometer.estimation.window.rig, configured);
    assert_eq!(flight.odometer.estimation.window.prior.rig, configured);
    assert_eq!(flight.feedback.pose_b_c[0], configured.pose_b_c0);
    assert_eq!(flight.feedback.bias_gyro, Vector3::zeros());
    let first = flight.until_pose();
    assert!(first.pose_o_b.translation.vector.norm() < 0.05, "begins at the origin: {}", first.pose_o_b);
}

#[test]
fn a_diverged_state_is_not_where_the_next_start_begins() {
    let mut flight = biased(2);
    let good = (flight.frames(100).clone(), flight.t());
    let rig = flight.odometer.estimation.window.rig.clone();
    let newest = flight.odometer.estimation.window.frames.last_mut().expect("flies");
    newest.nav.p_o_b += Vector3::new(300.0, -2e6, 50.0);
    newest.nav.v_o_b = Vector3::new(900.0, 0.0, 0.0);
    newest.nav.bias_gyro = Vector3::new(0.4, 0.0, 0.0);
    flight.odometer.estimation.window.rig.pose_b_c0.rotation *= exp_so3(&Vector3::new(0.3, 0.0, 0.0));
    let (at, mut health) = (stamp(flight.t()), HealthBits::default());
    flight.odometer.conclude(at, &mut health);
    assert!(matches!(flight.odometer.reset_reason(), Some(ResetReason::Speed(_))));
    let turned =
        flight.odometer.estimation.window.prior.rig.minus(&rig).fixed_rows::<3>(Rig::ROT_B_C0).norm();
    assert!(turned < 0.01, "the next start would begin with cameras turned by {turned}");
    flight.until_pose();
    let error_m = flight.error_m(&good);
    // The vehicle flies at up to 2 m/s, and the state that was believed is up to two seconds old.
    assert!(error_m < 5.0, "the next start begins {error_m} m off");
    assert!(flight.frames(20).reset_counter == 1, "and stays");
}

#[test]
fn a_calibration_beyond_what_is_configured_is_never_begun_with() {
    let mut flight = biased(2);
    let configured = Rig::of(&flight.world.config);
    flight.frames(40);
    flight.odometer.estimation.window.rig.pose_b_c0.rotation *= exp_so3(&Vector3::new(0.3, 0.0, 0.0));
    flight.odometer.reset(ResetKind::Soft);
    assert_eq!(flight.odometer.estimation.window.prior.rig, configured);
    // One that was refined within its bounds stays.
    flight.until_pose();
    flight.frames(20);
    let refined = flight.odometer.estimation.window.rig.clone();
    assert_ne!(refined, configured);
    flight.odometer.reset(ResetKind::Soft);
    assert_eq!(flight.odometer.estimation.window.prior.rig, refined);
}

#[test]
fn frames_that_cannot_be_solved_are_known_less_and_less_well_and_end_in_a_start_anew() {
    let mut flight = biased(2);
    // The prior holds what has left the window by then.
    flight.frames(160);
    let spoilt = (Rig::P_B_C0, Rig::ROT_B_C0);
    flight.odometer.estimation.window.prior.equations.add(spoilt.0, spoilt.1, 1e30);
    flight.frame(None);
    // Without what a gyroscope in doubt adds for a frame.
    let (mut last, mut velocities) = (flight.odometer.estimation.covariance, Vec::new());
    for k in 1..100 {
        let estimate = flight.frame(None).clone();
        if estimate.reset_counter > 0 {
            break;
        }
        assert!(estimate.health.contains(HealthBits::NOT_POSITIVE_DEFINITE), "{k}: {estimate:?}");
        let now = flight.odometer.estimation.covariance;
        for part in [0, 3, 6] {
            let [now, then] = [&now, &last].map(|c| c.fixed_view::<3, 3>(part, part).trace());
            assert!(now > then, "frame {k}, part {part}: {now} after {then}");
        }
        velocities.push(now.fixed_view::<3, 3>(6, 6).trace());
        last = now;
    }
    // A bias that is not known moves the velocity with the time, not with its root.
    let grown = |k: usize| velocities[k] - velocities[0];
    let half = velocities.len() / 2;
    assert!(grown(2 * half - 1) > 3.0 * grown(half - 1), "{velocities:?}");
    let blind_s = flight.world.config.estimator.health.max_blind_s;
    assert!(flight.frames(1 + (blind_s * 20.0) as usize / 20).reset_counter == 1, "is given up in the end");
    flight.until_pose();
}
