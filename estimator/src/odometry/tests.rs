use super::synthetic::{World, config, stamp};
use super::trust_tests::anchored;
use super::*;
use crate::exchange::believable_offset;
use crate::window::snapshot::MapSnapshot;
use nalgebra::SVector;

/// Result of a simulated flight.
#[derive(Debug, Default)]
struct Flight {
    first_pose_s: Option<f64>,
    resets: u32,
    /// Allocations of all frames together, the first included.
    allocations: u64,
    distance_m: f64,
    final_error_m: f64,
    rms_error_m: f64,
    yaw_error_rad: f64,
    mean_nees: f64,
    scale: f64,
    last: Option<Estimate>,
    /// All that was reported in any frame.
    health: HealthBits,
    /// Takes coordinates of the world to the odometry frame.
    pose_o_world: nalgebra::Isometry3<f64>,
    /// Window at the end.
    snapshot: MapSnapshot,
}

impl Flight {
    fn summary(&self) -> String {
        format!(
            "first {:?} resets {} distance {:.2} final {:.4} rms {:.4} ({:.3} %) yaw {:.4} nees {:.2} scale {:.4} td {:.5}",
            self.first_pose_s,
            self.resets,
            self.distance_m,
            self.final_error_m,
            self.rms_error_m,
            100.0 * self.rms_error_m / self.distance_m,
            self.yaw_error_rad,
            self.mean_nees,
            self.scale,
            self.last.as_ref().map_or(0.0, |l| l.time_offset_s),
        )
    }
}

/// Which cameras see at time `t`.
type Alive = fn(f64) -> [bool; 2];

fn fly(world: &mut World, duration_s: f64, alive: Alive) -> Flight {
    fly_before(world, duration_s, alive, false)
}

/// Flies before texture that repeats itself, or not.
fn fly_before(world: &mut World, duration_s: f64, alive: Alive, is_repeating: bool) -> Flight {
    let mut odometer = Odometer::new(&world.config);
    let mut tracked = Tracked::new(&world.config);
    let mut feedback = Feedback::new(&world.config);
    // As the front-end hears of it: a frame late.
    let mut heard_offset_s = feedback.time_offset_s;
    let mut flight = Flight::default();
    let mut anchor: Option<nalgebra::Isometry3<f64>> = None;
    let (mut squared, mut nees, mut count) = (0.0, 0.0, 0.0);
    let (mut est_path, mut true_path) = (0.0, 0.0);
    let mut last_pair: Option<(Vector3<f64>, Vector3<f64>)> = None;
    for k in 0..(duration_s * 20.0) as u32 {
        let t = 0.2 + f64::from(k) * 0.05;
        let time_offset_s = believable_offset(heard_offset_s);
        let needed = stamp(t).plus_seconds(time_offset_s);
        tracked.samples.extend(world.samples_to(t + time_offset_s));
        tracked.points = world.observe(t, alive(t));
        tracked.sequence = u64::from(k);
        tracked.is_repeating = is_repeating;
        tracked.time = FrameTime { stamp: needed, time_offset_s };
        heard_offset_s = feedback.time_offset_s;
        let mut answer = None;
        let memory = allocation_counter::measure(|| {
            answer = Some(odometer.process(&tracked, &mut (), &mut feedback));
        });
        let estimate = answer.unwrap();
        flight.health.insert(estimate.health);
        flight.allocations += memory.count_total;
        tracked.samples.clear();
        if estimate.has_pose() {
            let t_state = t + estimate.time_offset_s;
            let truth = world.pose_o_b(t_state);
            flight.first_pose_s.get_or_insert(t - 0.2);
            let from_anchor = anchor.get_or_insert_with(|| anchored(&estimate.pose_o_b, &truth));
            let expected = *from_anchor * truth;
            let p_error = estimate.pose_o_b.translation.vector - expected.translation.vector;
            let rot_error =
                crate::geometry::log_so3(&(expected.rotation.inverse() * estimate.pose_o_b.rotation));
            let mut error = SVector::<f64, 6>::zeros();
            error.fixed_rows_mut::<3>(0).copy_from(&p_error);
            error.fixed_rows_mut::<3>(3).copy_from(&rot_error);
            let covariance =
                estimate.covariance.fixed_view::<6, 6>(0, 0) + nalgebra::Matrix6::identity() * 1e-10;
            nees += (error.transpose() * covariance.try_inverse().unwrap() * error)[0] / 6.0;
            squared += p_error.norm_squared();
            count += 1.0;
            if let Some((est, tru)) = last_pair {
                est_path += (estimate.pose_o_b.translation.vector - est).norm();
                true_path += (expected.translation.vector - tru).norm();
            }
            last_pair = Some((estimate.pose_o_b.translation.vector, expected.translation.vector));
            flight.final_error_m = p_error.norm();
            flight.yaw_error_rad =
                crate::geometry::yaw_of(&(estimate.pose_o_b.rotation * expected.rotation.inverse()));
        }
        flight.resets = estimate.reset_counter;
        flight.last = Some(estimate);
    }
    flight.snapshot = MapSnapshot::new(&world.config);
    if let Some(estimate) = &flight.last {
        odometer.window().snapshot(estimate, &mut flight.snapshot);
    }
    flight.pose_o_world = anchor.unwrap_or_default();
    flight.rms_error_m = (squared / count).sqrt();
    flight.mean_nees = nees / count;
    flight.distance_m = true_path;
    flight.scale = est_path / true_path;
    println!("{}", flight.summary());
    flight
}

fn both(_: f64) -> [bool; 2] {
    [true; 2]
}

#[test]
fn before_texture_that_repeats_a_start_takes_half_a_second() {
    let first_s = [false, true].map(|is_repeating| {
        let mut world = World::new(&config(2), 1, 500);
        fly_before(&mut world, 1.0, both, is_repeating).first_pose_s.unwrap()
    });
    assert!(first_s[0] < 0.2 && (0.5..0.6).contains(&first_s[1]), "{first_s:?}");
}

#[test]
fn stereo_flight_drifts_little_and_knows_how_little() {
    // Errors of points hang together for 0.4 s, as those of recorded images do.
    let mut world = World::new(&config(2), 1, 500);
    world.error_correlation = 0.4 / 0.45;
    let flight = fly(&mut world, 20.0, both);
    assert_eq!(flight.resets, 0);
    assert!(flight.first_pose_s.unwrap() < 0.3);
    assert!(flight.rms_error_m < 0.002 * flight.distance_m);
    assert!((0.2..3.0).contains(&flight.mean_nees), "{}", flight.mean_nees);
}

#[test]
fn a_flight_whose_points_err_independently_is_no_surer_than_it_should_be() {
    let flight = fly(&mut World::new(&config(2), 1, 500), 20.0, both);
    assert!(flight.rms_error_m < 0.002 * flight.distance_m && flight.mean_nees < 3.0, "{}", flight.mean_nees);
}

#[test]
fn a_snapshot_says_where_the_landmarks_are() {
    let mut world = World::new(&config(2), 1, 500);
    let flight = fly(&mut world, 10.0, both);
    let points_o: Vec<_> =
        world.points_o.iter().map(|p| flight.pose_o_world * nalgebra::Point3::from(*p)).collect();
    let mut errors_m: Vec<f64> = flight
        .snapshot
        .points
        .iter()
        .map(|seen| points_o.iter().map(|p| (p.coords - seen.p_o).norm()).fold(f64::INFINITY, f64::min))
        .collect();
    errors_m.sort_by(f64::total_cmp);
    let (count, median_m) = (errors_m.len(), errors_m[errors_m.len() / 2]);
    println!("{count} landmarks, median error {median_m:.3} m, worst {:.3} m", errors_m[count - 1]);
    assert!(count > 50 && median_m < 0.1, "{count} landmarks, {median_m} m");
    assert!(errors_m[count * 3 / 4] < 0.2, "a quarter is off by {:.3} m or more", errors_m[count * 3 / 4]);
    assert!(flight.snapshot.keyframes.len() > 3);
    for keyframe in &flight.snapshot.keyframes {
        let t = keyframe.stamp.seconds_since(stamp(0.0));
        let truth = flight.pose_o_world * world.pose_o_b(t);
        let error_m = (truth.translation.vector - keyframe.pose_o_b.translation.vector).norm();
        assert!(error_m < 0.05, "keyframe at {t:.2} s: {error_m:.3} m off");
    }
    let hosts: Vec<_> = flight.snapshot.keyframes.iter().map(|k| k.stamp).collect();
    let at_home = flight.snapshot.points.iter().filter(|p| hosts.contains(&p.host)).count();
    assert!(at_home * 10 > count * 9, "{at_home} of {count} are hosted by keyframes");
}

#[test]
fn monocular_flight_finds_its_scale() {
    let mut world = World::new(&config(1), 2, 500);
    let flight = fly(&mut world, 20.0, both);
    assert_eq!(flight.resets, 0);
    assert!(flight.first_pose_s.unwrap() < 2.5);
    assert!((flight.scale - 1.0).abs() < 0.02);
    assert!(flight.rms_error_m < 0.01 * flight.distance_m);
}

#[test]
fn a_monocular_start_waits_while_the_velocity_is_constant() {
    let mut world = World::new(&config(1), 2, 500);
    world.cruise_m_s = Some(Vector3::new(0.0, 0.6, 0.0));
    let flight = fly(&mut world, 6.0, both);
    assert_eq!(flight.first_pose_s, None);
    // Two cameras have the scale from their baseline.
    let mut world = World::new(&config(2), 2, 500);
    world.cruise_m_s = Some(Vector3::new(0.0, 0.6, 0.0));
    assert!(fly(&mut world, 6.0, both).first_pose_s.is_some());
}

#[test]
fn no_frame_allocates_be_it_of_a_start_or_of_a_start_anew() {
    for (cameras, seed) in [(1, 2), (2, 4)] {
        let mut world = World::new(&config(cameras), seed, 500);
        let flight = fly(&mut world, 20.0, |t| [!(6.0..12.5).contains(&t); 2]);
        assert!(flight.resets > 0 && flight.last.unwrap().has_pose(), "{cameras} cameras do not start anew");
        assert_eq!(flight.allocations, 0, "{cameras} cameras");
    }
}

#[test]
fn at_rest_nothing_moves() {
    let mut world = World::new(&config(2), 3, 500);
    world.is_at_rest = true;
    world.sigma_px = 0.1;
    let flight = fly(&mut world, 10.0, both);
    assert_eq!(flight.resets, 0);
    assert!(flight.final_error_m < 0.005);
    assert!(flight.last.unwrap().health.contains(HealthBits::STATIONARY));
}

#[test]
fn a_blackout_is_bridged_by_the_imu_and_told_by_the_covariance() {
    let mut world = World::new(&config(2), 4, 500);
    let flight = fly(&mut world, 15.0, |t| [!(6.0..7.5).contains(&t); 2]);
    assert_eq!(flight.resets, 0);
    assert!(flight.mean_nees < 3.0);
    assert!(flight.final_error_m < 0.2);
}

#[test]
fn either_camera_may_be_lost_for_a_while() {
    for alive in
        [|t: f64| [!(5.0..10.0).contains(&t), true], |t: f64| [true, !(5.0..10.0).contains(&t)]] as [Alive; 2]
    {
        let mut world = World::new(&config(2), 5, 500);
        let flight = fly(&mut world, 15.0, alive);
        assert_eq!(flight.resets, 0);
        assert!(flight.rms_error_m < 0.005 * flight.distance_m);
    }
}

#[test]
fn time_offset_and_extrinsics_are_found() {
    let mut world = World::new(&config(2), 6, 500);
    world.time_offset_s = 0.008;
    let turn = crate::geometry::exp_so3(&Vector3::new(0.01, -0.01, 0.01));
    for pose in &mut world.pose_b_c {
        pose.rotation = turn * pose.rotation;
        pose.translation.vector = turn * pose.translation.vector;
    }
    let flight = fly(&mut world, 20.0, both);
    assert_eq!(flight.resets, 0);
    let last = flight.last.unwrap();
    assert!((last.time_offset_s - 0.008).abs() < 0.001);
    assert!(last.pose_b_c0.rotation.angle_to(&world.pose_b_c[0].rotation) < 0.003);
}

#[test]
fn a_long_exposure_in_a_turn_is_reported_as_blur() {
    for (exposure_s, is_blurred) in [(0.0, false), (0.001, false), (0.04, true)] {
        let mut setup = config(2).into_inner();
        setup.camera.iter_mut().for_each(|camera| camera.exposure_s = exposure_s);
        let flight = fly(&mut World::new(&setup.validate().unwrap(), 3, 300), 3.0, |_| [true; 2]);
        assert_eq!(flight.health.contains(HealthBits::BLURRED), is_blurred, "{exposure_s} s");
    }
}
