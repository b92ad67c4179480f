use super::*;
use crate::fixture;
use nalgebra::UnitQuaternion;

fn model(effects: ImuEffects, flight: &Trajectory, rate_hz: f64) -> Samples {
    let config = ImuConfig { rate_hz, ..fixture::config().imu };
    ImuModel::new(&config, effects, 3, [flight.begin(), flight.end()]).samples(flight)
}

#[test]
fn at_rest_it_feels_gravity_upwards() {
    let flight = fixture::standing(2.0);
    let sample = model(ImuEffects::none(), &flight, 200.0).samples[100];
    let up_b = flight.motion_at(0.5).pose_w_b.rotation.inverse() * Vector3::new(0.0, 0.0, 9.81);
    assert!((sample.accel - up_b).norm() < 1e-6);
    assert!(sample.gyro.norm() < 1e-6);
}

#[test]
fn integrated_finely_it_gives_the_truth() {
    let flight = fixture::wobble(4.0);
    let imu = model(ImuEffects::none(), &flight, 4000.0);
    let dt = 1.0 / 4000.0;
    let first = flight.motion(imu.samples[0].stamp);
    let (mut q, mut v, mut p) = (first.pose_w_b.rotation, first.v_w_b, first.pose_w_b.translation.vector);
    for k in 0..imu.samples.len() - 1 {
        let (a, b) = (imu.samples[k], imu.samples[k + 1]);
        let next = q * UnitQuaternion::from_scaled_axis((a.gyro + b.gyro) * (0.5 * dt));
        let gravity = Vector3::new(0.0, 0.0, -9.81);
        let acceleration = (q * a.accel + next * b.accel) * 0.5 + gravity;
        p += v * dt + acceleration * (0.5 * dt * dt);
        v += acceleration * dt;
        q = next;
    }
    let last = flight.motion(imu.samples[imu.samples.len() - 1].stamp);
    assert!((p - last.pose_w_b.translation.vector).norm() < 1e-4);
    assert!((v - last.v_w_b).norm() < 1e-4);
    assert!(q.angle_to(&last.pose_w_b.rotation) < 1e-5);
}

#[test]
fn noise_has_the_configured_density() {
    let flight = fixture::standing(50.0);
    let quiet = ImuEffects { noise_scale: 1.0, ..ImuEffects::none() };
    let imu = model(quiet, &flight, 200.0);
    let mean_square = (0..imu.samples.len()).map(|k| imu.samples[k].gyro.norm_squared()).sum::<f64>()
        / (3.0 * imu.samples.len() as f64);
    let expected = fixture::config().imu.gyro_noise_density * 200.0_f64.sqrt();
    assert!((mean_square.sqrt() / expected - 1.0).abs() < 0.02);
}

#[test]
fn biases_are_in_the_samples_and_in_the_truth() {
    let flight = fixture::standing(5.0);
    let effects = ImuEffects { noise_scale: 0.0, ..ImuEffects::default() };
    let imu = model(effects, &flight, 200.0);
    let sample = imu.samples[500];
    let biases = imu.biases(sample.stamp);
    assert!((sample.gyro - biases.gyro).norm() < 1e-6 && biases.gyro.norm() > 1e-3);
    let start = imu.biases(imu.samples[0].stamp);
    assert!((start.accel - biases.accel).norm() > 1e-6, "the bias walks");
}

#[test]
fn vibration_shakes_the_samples() {
    let flight = fixture::standing(2.0);
    let effects = ImuEffects { vibration_accel_m_s2: 3.0, ..ImuEffects::none() };
    let imu = model(effects, &flight, 200.0);
    let still = model(ImuEffects::none(), &flight, 200.0);
    let most = (0..imu.samples.len())
        .map(|k| (imu.samples[k].accel - still.samples[k].accel).amax())
        .fold(0.0, f64::max);
    assert!((2.0..4.6).contains(&most));
}

#[test]
fn readings_stay_within_range() {
    let flight = fixture::standing(1.0);
    let config = ImuConfig { accel_range_m_s2: 5.0, ..fixture::config().imu };
    let imu = ImuModel::new(&config, ImuEffects::none(), 1, [flight.begin(), flight.end()]).samples(&flight);
    assert!(imu.samples[0].accel.amax() <= 5.0);
}

/// All samples of `effects` along `flight`, and those of a perfect sensor.
fn beside(effects: ImuEffects, flight: &Trajectory) -> Vec<(ImuSample, ImuSample)> {
    let (imu, perfect) = (model(effects, flight, 200.0), model(ImuEffects::none(), flight, 200.0));
    (0..imu.samples.len()).map(|k| (imu.samples[k], perfect.samples[k])).collect()
}

#[test]
fn coloured_force_has_its_deviation_and_correlation_time() {
    let flight = fixture::standing(3000.0);
    let effects = ImuEffects { force_sigma_m_s2: 0.07, force_time_s: 2.0, ..ImuEffects::none() };
    let errors: Vec<_> = beside(effects, &flight).iter().map(|(a, b)| a.accel - b.accel).collect();
    let product = |lag: usize| {
        let pairs = errors.iter().zip(&errors[lag..]).map(|(a, b)| a.dot(b));
        pairs.sum::<f64>() / (3.0 * (errors.len() - lag) as f64)
    };
    let sigma = product(0).sqrt();
    assert!((sigma / 0.07 - 1.0).abs() < 0.05, "{sigma}");
    // 400 samples are the correlation time.
    let correlation = product(400) / product(0);
    assert!((correlation - libm::exp(-1.0)).abs() < 0.06, "{correlation}");
}

#[test]
fn scale_and_misalignment_are_as_large_as_asked() {
    let flight = fixture::wobble(20.0);
    let effects = ImuEffects { scale_error: 0.005, misalignment_rad: 0.003, ..ImuEffects::none() };
    let pairs = beside(effects, &flight);
    for of in [|s: &ImuSample| s.gyro, |s: &ImuSample| s.accel] {
        let (mut left, mut right) = (Matrix3::zeros(), Matrix3::zeros());
        for (wrong, true_sample) in &pairs {
            left += of(true_sample) * of(true_sample).transpose();
            right += of(wrong) * of(true_sample).transpose();
        }
        let matrix = right * left.try_inverse().unwrap();
        for axis in 0..3 {
            let [next, last] = [matrix[(axis, (axis + 1) % 3)], matrix[(axis, (axis + 2) % 3)]];
            assert!(((matrix[(axis, axis)] - 1.0).abs() - 0.005).abs() < 1e-6, "{matrix}");
            assert!((libm::hypot(next, last) - 0.003).abs() < 1e-6, "{matrix}");
        }
    }
}

#[test]
fn gyroscope_feels_forces() {
    let flight = fixture::standing(2.0);
    let effects = ImuEffects { g_sensitivity_rad_s_per_g: 1e-3, ..ImuEffects::none() };
    let (wrong, perfect) = beside(effects, &flight)[100];
    let error = wrong.gyro - perfect.gyro;
    assert!((1e-5..1.1e-3).contains(&error.amax()), "{error}");
    assert_eq!(wrong.accel, perfect.accel);
}

#[test]
fn vibration_is_aliased_and_its_frequency_wanders() {
    let flight = fixture::standing(60.0);
    let steady = ImuEffects { vibration_accel_m_s2: 30.0, vibration_hz: 173.0, ..ImuEffects::none() };
    let wandering = ImuEffects { vibration_wander: 0.02, ..steady };
    // Power of one axis at the frequencies to which 173 Hz fold at 200 Hz.
    let share = |effects: ImuEffects, low_hz: f64, high_hz: f64| {
        let x: Vec<f64> = beside(effects, &flight).iter().map(|(a, b)| a.accel.x - b.accel.x).collect();
        let power = |hz: f64| {
            let (mut re, mut im) = (0.0, 0.0);
            for (k, x) in x.iter().enumerate() {
                let angle = TAU * hz * k as f64 / 200.0;
                re += x * libm::cos(angle);
                im += x * libm::sin(angle);
            }
            (re * re + im * im) * 2.0 / (x.len() as f64 * x.len() as f64)
        };
        let all = x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64;
        let steps = ((high_hz - low_hz) * 60.0) as usize;
        (0..=steps).map(|k| power(low_hz + k as f64 / 60.0)).sum::<f64>() / all
    };
    // The first harmonic has a quarter of the power of the vibration.
    assert!((share(steady, 26.9, 27.1) - 0.8).abs() < 0.05);
    assert!(share(wandering, 26.9, 27.1) < 0.3);
    assert!(share(wandering, 14.0, 40.0) > 0.7);
}
