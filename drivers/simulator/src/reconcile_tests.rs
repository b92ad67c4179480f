use super::*;
use crate::fixture;

const G: f64 = 9.81;
const BIAS_GYRO: Vector3<f64> = Vector3::new(-0.002, 0.02, 0.077);
const BIAS_ACCEL: Vector3<f64> = Vector3::new(-0.03, 0.12, 0.06);

/// Samples at 200 Hz of a sensor with constant biases along `flight`.
fn samples(flight: &Trajectory) -> Vec<ImuSample> {
    let count = (flight.end().seconds_since(flight.begin()) * 200.0) as i64;
    let sample = |k: i64| {
        let stamp = Timestamp::from_nanos(flight.begin().as_nanos() + k * 5_000_000);
        let motion = flight.motion(stamp);
        let force = motion.pose_w_b.rotation.inverse() * (motion.a_w_b + Vector3::z() * G);
        ImuSample { stamp, gyro: motion.omega_b + BIAS_GYRO, accel: force + BIAS_ACCEL }
    };
    (0..=count).map(sample).collect()
}

/// Largest differences of position (m) and attitude (rad), a second from the ends on, of flights in worlds that differ by
/// `turn` and by a shift.
fn apart(a: &Trajectory, b: &Trajectory, turn: &UnitQuaternion<f64>) -> (f64, f64) {
    let middle = a.begin().plus_seconds(0.5 * a.end().seconds_since(a.begin()));
    let p = |flight: &Trajectory, at| flight.motion(at).pose_w_b.translation.vector;
    let shift = turn * p(a, middle) - p(b, middle);
    let (mut position, mut attitude) = (0.0_f64, 0.0_f64);
    let span_s = a.end().seconds_since(a.begin());
    for k in 100..(span_s * 100.0) as usize - 100 {
        let at = a.begin().plus_seconds(k as f64 * 0.01);
        position = position.max((turn * p(a, at) - p(b, at) - shift).norm());
        attitude =
            attitude.max((turn * a.motion(at).pose_w_b.rotation).angle_to(&b.motion(at).pose_w_b.rotation));
    }
    (position, attitude)
}

#[test]
fn path_with_jumps_tilt_offset_and_outliers_is_made_right() {
    let truth = fixture::wobble(40.0);
    let samples = samples(&truth);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.006, -0.007, 0.0));
    let mut poses = fixture::wobble_poses(40.0);
    for (k, pose) in poses.iter_mut().enumerate() {
        pose.pose = turn * pose.pose;
        pose.stamp = pose.stamp.plus_seconds(0.003);
        if k >= 4000 {
            pose.pose.translation.vector.y += 0.08;
        }
        // An attitude that is off by a degree for a tenth of a second.
        if (6000..6020).contains(&k) {
            pose.pose.rotation *= UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0175, 0.0));
        }
    }
    let joined = reconcile(&poses, &samples, G).unwrap();
    assert!((joined.bias_gyro - BIAS_GYRO).norm() < 1e-3, "{}", joined.bias_gyro);
    assert!((joined.bias_accel - BIAS_ACCEL).norm() < 5e-3, "{}", joined.bias_accel);
    // The heading of the world is that of the path, its vertical that of gravity.
    let (position_m, attitude_rad) = apart(&truth, &joined.flight, &UnitQuaternion::identity());
    println!("position {:.2} mm, attitude {:.3} mrad", 1e3 * position_m, 1e3 * attitude_rad);
    assert!(position_m < 0.003 && attitude_rad < 0.0015, "{position_m} {attitude_rad}");
}

#[test]
fn samples_of_another_flight_are_refused() {
    let poses = fixture::wobble_poses(20.0);
    let mut others = samples(&fixture::wobble(20.0));
    others.iter_mut().for_each(|s| s.gyro = Vector3::new(s.gyro.y, -s.gyro.x, 0.5 - s.gyro.z));
    assert!(reconcile(&poses, &others, G).unwrap_err().contains("rates"));
    others.truncate(500);
    assert!(reconcile(&poses, &others, G).unwrap_err().contains("another flight"));
}

/// Errors of real samples after half a second against the flight reconciled with them, under a constant bias:
/// medians of position (m), velocity (m/s) and attitude (rad), and the 95th percentile of position (m).
fn residuals(joined: &Reconciled, samples: &[ImuSample]) -> [f64; 4] {
    let samples = &samples[joined.within.clone()];
    let mut errors = [(); 3].map(|()| Vec::new());
    for start in (400..samples.len() - 600).step_by(50) {
        let begin = joined.flight.motion(samples[start].stamp);
        let (mut q, mut p, mut v) = (begin.pose_w_b.rotation, begin.pose_w_b.translation.vector, begin.v_w_b);
        for pair in samples[start..=start + 100].windows(2) {
            let dt = pair[1].stamp.seconds_since(pair[0].stamp);
            let rate = 0.5 * (pair[0].gyro + pair[1].gyro) - joined.bias_gyro;
            let next = q * UnitQuaternion::from_scaled_axis(rate * dt);
            let force =
                |q: UnitQuaternion<f64>, s: &ImuSample| q * (s.accel - joined.bias_accel) - Vector3::z() * G;
            let (a, b) = (force(q, &pair[0]), force(next, &pair[1]));
            p += v * dt + (a / 3.0 + b / 6.0) * (dt * dt);
            v += (a + b) * (0.5 * dt);
            q = next;
        }
        let end = joined.flight.motion(samples[start + 100].stamp);
        errors[0].push((p - end.pose_w_b.translation.vector).norm());
        errors[1].push((v - end.v_w_b).norm());
        errors[2].push(q.angle_to(&end.pose_w_b.rotation));
    }
    errors[0].sort_by(f64::total_cmp);
    let late = errors[0][errors[0].len() * 95 / 100];
    let [p, v, q] = errors.map(|errors| median(errors).unwrap());
    [p, v, q, late]
}

#[test]
fn recorded_samples_agree_with_their_paths() {
    let Some(folder) = plumbline_test_support::shared("euroc/imu") else { return };
    let names = "V1_01_easy V1_02_medium V2_01_easy V2_02_medium MH_01_easy MH_03_medium MH_04_difficult";
    for name in names.split(' ') {
        let imu = folder.join(format!("{name}.csv.gz"));
        let samples = plumbline_drivers::euroc::read_imu_samples(&imu).unwrap();
        let path = folder.with_file_name("trajectories").join(format!("{name}.tum.gz"));
        let poses = plumbline_drivers::tum::read_tum(&path).unwrap();
        let joined = reconcile(&poses, &samples, G).unwrap();
        let [p, v, q, late] = residuals(&joined, &samples);
        let path = Trajectory::from_poses(&poses).unwrap();
        let tilt = joined.flight.motion(joined.flight.begin()).pose_w_b.rotation
            * path.motion(joined.flight.begin()).pose_w_b.rotation.inverse();
        println!(
            "{name}: after 0.5 s {:.1} mm (95 %: {:.1}), {:.1} mm/s, {:.2} mrad; turned by {:.1} mrad, biases {:.3?} {:.3?}",
            1e3 * p,
            1e3 * late,
            1e3 * v,
            1e3 * q,
            1e3 * tilt.angle(),
            joined.bias_gyro.as_slice(),
            joined.bias_accel.as_slice()
        );
        assert!(p < 0.009 && v < 0.035 && q < 0.002 && late < 0.02, "{name}");
        assert!(joined.bias_accel.amax() < 0.2 && joined.bias_gyro.amax() < 0.1, "{name}");
    }
}
