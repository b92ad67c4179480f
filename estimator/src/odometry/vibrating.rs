//! A vehicle that vibrates: what the samples show of it ([`crate::inertial::vibration`]) makes the velocity at an instant uncertain.
//!
//! Sampling folds a vibration anywhere, down to forces that last for a second. So a start takes more frames than it would else: a tilt that is
//! found wrong later turns all that was published since, and with it the heading.

use crate::inertial::{ImuNoise, Vibration, vibration};
use crate::window::state::NavState;
use nalgebra::Matrix3;
use plumbline_config::Portable;

/// Standard deviation of a force, along the worst axis, from which a vehicle vibrates, m/s². Recorded flights of EuRoC have medians
/// of 0.9 to 1.8, and less than 2.8 in 95 % of the time.
const VIBRATING_M_S2: f64 = 3.0;

/// True if the vehicle vibrates.
pub(super) fn is_vibrating(vibration: &Vibration) -> bool {
    vibration.force.amax() > VIBRATING_M_S2 * VIBRATING_M_S2
}

/// Covariance in `O` of the velocity that sways with `vibration`; `None` where white noise as `stated` explains it.
pub(super) fn sway(vibration: &Vibration, stated: &ImuNoise, nav: &NavState) -> Option<Matrix3<f64>> {
    let explained = stated.accel_density * stated.accel_density * vibration::SPAN_S;
    let beyond = vibration.velocity.map(|variance| (variance - explained).at_least(0.0));
    let rot = nav.rot_o_b.to_rotation_matrix().into_inner();
    (beyond.amax() > 0.0).then(|| rot * Matrix3::from_diagonal(&beyond) * rot.transpose())
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::{World, config};
    use super::super::trust_tests::{self, NONE, Trouble};
    use super::*;
    use nalgebra::Vector3;
    use plumbline_config::ImuSample;
    use std::f64::consts::TAU;

    /// First pose, s, and mean normalized squared error of the velocity over its expectation, of ten seconds with a vibration of
    /// this amplitude, m/s², that samples see at `hz`.
    fn fly(amplitude: f64, hz: f64) -> (f64, f64) {
        let imu = |t: f64, mut sample: ImuSample| {
            sample.accel += Vector3::from_fn(|axis, _| amplitude * libm::sin(TAU * hz * t + axis as f64));
            Some(sample)
        };
        let judged =
            trust_tests::fly(&mut World::new(&config(2), 3, 500), 10.0, &Trouble { imu: &imu, ..NONE });
        let sum: f64 = judged.iter().map(|pose| pose.velocity_nees).sum();
        (judged[0].time_s - 0.2, sum / judged.len() as f64)
    }

    #[test]
    fn the_velocity_is_as_uncertain_as_it_sways() {
        for hz in [27.0, 40.0, 80.0] {
            let (_, nees) = fly(30.0, hz);
            assert!((0.1..3.0).contains(&nees), "{hz} Hz: NEES {nees:.2}");
        }
    }

    #[test]
    fn a_vehicle_that_vibrates_starts_from_more_frames() {
        let (quiet_s, _) = fly(0.0, 27.0);
        let (shaken_s, _) = fly(30.0, 27.0);
        assert!(quiet_s < 0.2 && (0.5..0.7).contains(&shaken_s), "{quiet_s} and {shaken_s} s");
    }

    #[test]
    fn what_white_noise_explains_is_not_counted_twice() {
        let stated = ImuNoise { accel_density: 0.02, ..ImuNoise::NONE };
        let explained = 0.02_f64 * 0.02 * vibration::SPAN_S;
        let of = |variance: f64| {
            let velocity = Vector3::new(variance, 0.0, 0.0);
            sway(&Vibration { velocity, ..Vibration::default() }, &stated, &NavState::default())
        };
        assert_eq!(of(0.9 * explained), None);
        let beyond = of(3.0 * explained).unwrap();
        assert!((beyond[(0, 0)] - 2.0 * explained).abs() < 1e-12 && beyond[(1, 1)] == 0.0);
    }
}
