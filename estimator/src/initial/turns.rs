//! Turns of the body by the gyroscope alone, between any two times and at any small bias.
//!
//! Rotations are multiplied up over the samples once. Between the times `i` and `j`
//!
//! ```text
//! R_ij(b) ~ R_ij Exp(-R_j' (B_j - B_i) b),   B(t) = integral of R dt
//! ```
//!
//! with attitudes `R` against the first sample. Source: Forster et al. 2017, equation 44, summed from one beginning.

use crate::geometry::exp_so3;
use crate::inertial::ImuBuffer;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use plumbline_config::Timestamp;

/// Attitude at a time, what a bias changes of it, and the reading, rad/s, bias included.
#[derive(Clone, Copy, Debug)]
pub struct Turned {
    stamp: Timestamp,
    /// Attitude against the first sample.
    pub rot: UnitQuaternion<f64>,
    /// Integral of the attitude since then, s.
    pub by_bias: Matrix3<f64>,
    /// Reading of the gyroscope, rad/s.
    pub gyro_b: Vector3<f64>,
}

impl Turned {
    /// Derivative of the turn to `other` by the bias: on the right, in the axes of `other`.
    #[must_use]
    pub fn to_by_bias(&self, other: &Self) -> Matrix3<f64> {
        other.rot.inverse().to_rotation_matrix().into_inner() * (self.by_bias - other.by_bias)
    }

    fn after(&self, dt_s: f64, gyro_b: Vector3<f64>) -> Self {
        let mean_b = (self.gyro_b + gyro_b) * 0.5;
        let half = self.rot * exp_so3(&(mean_b * (0.5 * dt_s)));
        let rot = self.rot * exp_so3(&(mean_b * dt_s));
        Self {
            stamp: self.stamp.plus_seconds(dt_s),
            rot: UnitQuaternion::new_normalize(rot.into_inner()),
            by_bias: self.by_bias + half.to_rotation_matrix().into_inner() * dt_s,
            gyro_b,
        }
    }
}

/// Attitudes at all samples that are kept.
#[derive(Clone, Debug, Default)]
pub struct Turns {
    all: Vec<Turned>,
}

impl Turns {
    /// Room for so many samples.
    #[must_use]
    pub fn new(samples: usize) -> Self {
        Self { all: Vec::with_capacity(samples) }
    }

    /// Multiplies the samples of `imu` up, from `since` on.
    pub fn integrate(&mut self, imu: &ImuBuffer, since: Timestamp) {
        self.all.clear();
        for sample in imu.iter().filter(|s| s.stamp >= since).take(self.all.capacity()) {
            let turned = match self.all.last() {
                Some(last) => Turned {
                    stamp: sample.stamp,
                    ..last.after(sample.stamp.seconds_since(last.stamp), sample.gyro)
                },
                None => Turned {
                    stamp: sample.stamp,
                    rot: UnitQuaternion::identity(),
                    by_bias: Matrix3::zeros(),
                    gyro_b: sample.gyro,
                },
            };
            self.all.push(turned);
        }
    }

    /// Attitude at `stamp`; `None` before the first sample, and by more than the last interval after the last one.
    #[must_use]
    pub fn at(&self, stamp: Timestamp) -> Option<Turned> {
        let next =
            self.all.partition_point(|turned| turned.stamp <= stamp).min(self.all.len().checked_sub(1)?);
        let (before, after) = (self.all.get(next.checked_sub(1)?)?, self.all.get(next)?);
        let share = stamp.seconds_since(before.stamp) / after.stamp.seconds_since(before.stamp);
        (share <= 2.0).then(|| {
            before.after(stamp.seconds_since(before.stamp), before.gyro_b.lerp(&after.gyro_b, share))
        })
    }

    /// Turn between two times, as one from the axes of the second to those of the first, at a bias, rad/s; `None` outside of the samples.
    #[must_use]
    pub fn between(&self, stamps: [Timestamp; 2], bias_gyro: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
        let [first, second] = stamps.map(|stamp| self.at(stamp));
        let (first, second) = (first?, second?);
        Some(first.rot.inverse() * second.rot * exp_so3(&(first.to_by_bias(&second) * bias_gyro)))
    }
}
