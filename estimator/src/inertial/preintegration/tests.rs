use super::*;
use crate::geometry::log_so3;

const NOISE: ImuNoise = ImuNoise { gyro_density: 1.7e-3, accel_density: 2e-2, ..ImuNoise::NONE };

fn rate(t: f64) -> Vector3<f64> {
    Vector3::new(0.8 * (3.0 * t).sin(), -0.5 + 0.3 * t, 1.2 * (2.0 * t).cos())
}

fn force(t: f64) -> Vector3<f64> {
    Vector3::new(2.0 * (5.0 * t).cos(), 1.0 - t, 9.81 + (4.0 * t).sin())
}

fn integrate(
    duration: f64,
    steps: usize,
    bias_gyro: &Vector3<f64>,
    bias_accel: &Vector3<f64>,
) -> Preintegration {
    let mut pre = Preintegration::new(bias_gyro, bias_accel);
    let dt = duration / steps as f64;
    for k in 0..steps {
        let t = k as f64 * dt;
        pre.integrate(dt, &((rate(t) + rate(t + dt)) * 0.5), &force(t), &force(t + dt), &NOISE);
    }
    pre
}

#[test]
fn agrees_with_a_thousand_times_finer_integration() {
    let zero = Vector3::zeros();
    let (coarse, fine) = (integrate(1.0, 200, &zero, &zero), integrate(1.0, 200_000, &zero, &zero));
    assert!((coarse.delta_p - fine.delta_p).norm() < 5e-5);
    assert!((coarse.delta_v - fine.delta_v).norm() < 1e-4);
    assert!(coarse.delta_rot.angle_to(&fine.delta_rot) < 2e-5);
}

#[test]
fn bias_jacobians_agree_with_numeric_differentiation() {
    let (gyro, accel) = (Vector3::new(0.01, -0.02, 0.03), Vector3::new(0.1, 0.05, -0.2));
    let pre = integrate(0.5, 100, &gyro, &accel);
    let h = 1e-5;
    for k in 0..6 {
        let mut d = [Vector3::zeros(), Vector3::zeros()];
        d[k / 3][k % 3] = h;
        let plus = integrate(0.5, 100, &(gyro + d[0]), &(accel + d[1]));
        let minus = integrate(0.5, 100, &(gyro - d[0]), &(accel - d[1]));
        let p = (plus.delta_p - minus.delta_p) / (2.0 * h);
        let v = (plus.delta_v - minus.delta_v) / (2.0 * h);
        let rot = log_so3(&(minus.delta_rot.inverse() * plus.delta_rot)) / (2.0 * h);
        let column = pre.by_bias.column(k);
        assert!((p - column.fixed_rows::<3>(0)).norm() < 1e-5, "dp by bias {k}");
        assert!((rot - column.fixed_rows::<3>(3)).norm() < 1e-5, "dR by bias {k}");
        assert!((v - column.fixed_rows::<3>(6)).norm() < 1e-4, "dv by bias {k}");
    }
}

#[test]
fn two_halves_make_the_whole() {
    let zero = Vector3::zeros();
    let whole = integrate(0.4, 80, &zero, &zero);
    let mut halves = [Preintegration::new(&zero, &zero), Preintegration::new(&zero, &zero)];
    for k in 0..80 {
        let t = k as f64 * 0.005;
        let gyro = (rate(t) + rate(t + 0.005)) * 0.5;
        halves[k / 40].integrate(0.005, &gyro, &force(t), &force(t + 0.005), &NOISE);
    }
    let joined = halves[0].followed_by(&halves[1]);
    assert!((joined.delta_p - whole.delta_p).norm() < 1e-12);
    assert!((joined.delta_v - whole.delta_v).norm() < 1e-12);
    assert!(joined.delta_rot.angle_to(&whole.delta_rot) < 1e-7);
    assert!((joined.covariance - whole.covariance).norm() < 1e-3 * whole.covariance.norm());
    assert!((joined.by_bias - whole.by_bias).norm() < 1e-9);
}

/// A linear congruential generator and the sum of twelve uniforms: normal enough, and the same for ever.
struct Normal(u64);

impl Normal {
    fn next(&mut self) -> f64 {
        let uniform = |state: &mut u64| {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform(&mut self.0)).sum::<f64>() - 6.0
    }

    fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::new(self.next(), self.next(), self.next()) * sigma
    }
}

#[test]
fn the_covariance_is_that_of_a_monte_carlo_experiment() {
    let zero = Vector3::zeros();
    let (dt, steps, runs) = (0.005, 100, 3000);
    let truth = integrate(dt * steps as f64, steps, &zero, &zero);
    let mut normal = Normal(7);
    let mut sample_covariance = SMatrix::<f64, 9, 9>::zeros();
    for _ in 0..runs {
        let mut pre = Preintegration::new(&zero, &zero);
        for k in 0..steps {
            let t = k as f64 * dt;
            let accel_noise = normal.vector(NOISE.accel_density / dt.sqrt());
            let gyro = (rate(t) + rate(t + dt)) * 0.5 + normal.vector(NOISE.gyro_density / dt.sqrt());
            pre.integrate(dt, &gyro, &(force(t) + accel_noise), &(force(t + dt) + accel_noise), &NOISE);
        }
        let mut error = nalgebra::SVector::<f64, 9>::zeros();
        error.fixed_rows_mut::<3>(0).copy_from(&(pre.delta_p - truth.delta_p));
        error.fixed_rows_mut::<3>(3).copy_from(&log_so3(&(truth.delta_rot.inverse() * pre.delta_rot)));
        error.fixed_rows_mut::<3>(6).copy_from(&(pre.delta_v - truth.delta_v));
        sample_covariance += error * error.transpose() / runs as f64;
    }
    for k in 0..9 {
        let ratio = sample_covariance[(k, k)] / truth.covariance[(k, k)];
        assert!((0.9..1.1).contains(&ratio), "variance {k}: sampled / propagated = {ratio}");
    }
}
