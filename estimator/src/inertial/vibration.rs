//! Vibration, as far as samples show it.
//!
//! Samples of a vibration that no filter took out before sampling are folded into lower frequencies. Their integral sways: the
//! velocity at an instant differs from that of the vehicle by as much, though no image can tell, since the sway averages out
//! within a frame or stands still from frame to frame. A vehicle's own motion is smooth for a tenth of a second: what a
//! parabola does not explain of the velocity in that time, and of the force, is vibration.

use nalgebra::{Matrix3, Vector3};
use plumbline_config::{ImuSample, Portable, Timestamp};

/// Time over which vibration is judged, s: two or three periods of what images do not see at 20 Hz.
pub const SPAN_S: f64 = 0.1;
/// Fewest samples that are judged: half as many again as a parabola takes.
const MIN_SAMPLES: f64 = 6.0;
/// Coefficients of a parabola.
const COEFFICIENTS: f64 = 3.0;

/// Variances of what is no smooth motion in the newest samples, by axis of the body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vibration {
    /// Variance of the force, m²/s⁴.
    pub force: Vector3<f64>,
    /// Variance of its integral, m²/s².
    pub velocity: Vector3<f64>,
}

impl Vibration {
    /// Vibration in `samples`, oldest first; none in too few of them.
    pub fn of<'a>(samples: impl Iterator<Item = &'a ImuSample>) -> Self {
        let (mut force, mut velocity) = (Parabola::default(), Parabola::default());
        let mut integral = Vector3::zeros();
        let mut before: Option<&ImuSample> = None;
        let mut begin = Timestamp::default();
        for sample in samples {
            match before {
                None => begin = sample.stamp,
                Some(last) => {
                    let dt_s = sample.stamp.seconds_since(last.stamp);
                    integral += (last.accel + sample.accel) * (0.5 * dt_s);
                }
            }
            // Times from -1 to 1 keep the sums well conditioned.
            let t = sample.stamp.seconds_since(begin) * (2.0 / SPAN_S) - 1.0;
            force.add(t, &sample.accel);
            velocity.add(t, &integral);
            before = Some(sample);
        }
        Self { force: force.variances(), velocity: velocity.variances() }
    }
}

/// Sums of a least-squares fit of a parabola to three components.
#[derive(Clone, Copy, Debug, Default)]
struct Parabola {
    moments: [f64; 5],
    by_moment: [Vector3<f64>; 3],
    squares: Vector3<f64>,
}

impl Parabola {
    fn add(&mut self, t: f64, value: &Vector3<f64>) {
        let mut power = 1.0;
        for (k, moment) in self.moments.iter_mut().enumerate() {
            *moment += power;
            if let Some(sum) = self.by_moment.get_mut(k) {
                *sum += value * power;
            }
            power *= t;
        }
        self.squares += value.component_mul(value);
    }

    /// Variance of the residuals of each component.
    fn variances(&self) -> Vector3<f64> {
        let [count, ..] = self.moments;
        if count < MIN_SAMPLES {
            return Vector3::zeros();
        }
        let normal = Matrix3::from_fn(|i, j| self.moments[i + j]);
        let Some(root) = normal.cholesky() else { return Vector3::zeros() };
        Vector3::from_fn(|axis, _| {
            let sums = Vector3::from_fn(|k, _| self.by_moment[k][axis]);
            let explained = sums.dot(&root.solve(&sums));
            ((self.squares[axis] - explained) / (count - COEFFICIENTS)).at_least(0.0)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// A tenth of a second at 200 Hz of this force along x beside gravity.
    fn vibration(force: impl Fn(f64) -> f64) -> Vibration {
        let samples: Vec<_> = (0..=20)
            .map(|k| {
                let stamp = Timestamp::from_nanos(7_000_000_000 + k * 5_000_000);
                let accel = Vector3::new(force(k as f64 * 0.005), 0.0, 9.81);
                ImuSample { stamp, gyro: Vector3::zeros(), accel }
            })
            .collect();
        Vibration::of(samples.iter())
    }

    #[test]
    fn the_velocity_of_a_vibration_sways_by_its_amplitude_over_its_frequency() {
        for (hz, phase) in [(27.0, 0.0), (40.0, 1.0), (53.0, 2.0)] {
            let seen = vibration(|t| 30.0 * libm::sin(TAU * hz * t + phase));
            // The trapezoids between samples have less than the integral, 1 / (2 pi f).
            let expected = 30.0 * 0.0025 / libm::tan(TAU * hz * 0.0025) / 2.0_f64.sqrt();
            let sigma = seen.velocity.x.sqrt();
            assert!((sigma / expected - 1.0).abs() < 0.2, "{hz} Hz: {sigma} of {expected} m/s");
            assert!((seen.force.x.sqrt() / (30.0 / 2.0_f64.sqrt()) - 1.0).abs() < 0.1);
            assert!(seen.velocity.z < 1e-12 && seen.force.z < 1e-9);
        }
    }

    #[test]
    fn a_motion_of_the_vehicle_is_no_vibration() {
        let smooth = vibration(|t| 5.0 * libm::sin(TAU * 1.5 * t));
        assert!(smooth.velocity.x.sqrt() < 1e-3, "{}", smooth.velocity.x.sqrt());
    }

    #[test]
    fn too_few_samples_say_nothing() {
        let sample = ImuSample { stamp: Timestamp::default(), gyro: Vector3::zeros(), accel: Vector3::x() };
        assert_eq!(Vibration::of([sample; 5].iter()), Vibration::default());
    }
}
