//! Turns of the body by the gyroscope alone, between any two times.

use crate::geometry::exp_so3;
use crate::inertial::ImuBuffer;
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::Timestamp;

/// Attitude at a time, and the reading of the gyroscope, rad/s; both by readings that still hold their bias.
#[derive(Clone, Copy, Debug)]
pub struct Turned {
    stamp: Timestamp,
    /// Attitude against the first sample.
    pub rot: UnitQuaternion<f64>,
    /// Reading of the gyroscope, rad/s.
    pub gyro_b: Vector3<f64>,
}

impl Turned {
    fn after(&self, stamp: Timestamp, gyro_b: Vector3<f64>) -> Self {
        let half_s = 0.5 * stamp.seconds_since(self.stamp);
        Self { stamp, rot: self.rot * exp_so3(&((self.gyro_b + gyro_b) * half_s)), gyro_b }
    }
}

/// Attitudes at all samples that are kept.
#[derive(Clone, Debug)]
pub struct Turns(Vec<Turned>);

impl Turns {
    /// Room for so many samples.
    pub fn new(samples: usize) -> Self {
        Self(Vec::with_capacity(samples))
    }

    /// Multiplies the samples of `imu` in `[from, to]` up.
    pub fn integrate(&mut self, imu: &ImuBuffer, [from, to]: [Timestamp; 2]) {
        self.0.clear();
        for believed in imu.within(from, to).take(self.0.capacity()) {
            let (stamp, gyro_b) = (believed.sample.stamp, believed.sample.gyro);
            let first = Turned { stamp, rot: UnitQuaternion::identity(), gyro_b };
            self.0.push(self.0.last().map_or(first, |last| last.after(stamp, gyro_b)));
        }
    }

    /// Attitude at `stamp`; `None` where there are no samples around it.
    pub fn at(&self, stamp: Timestamp) -> Option<Turned> {
        let next = self.0.partition_point(|turned| turned.stamp <= stamp);
        let (before, after) = (self.0.get(next.checked_sub(1)?)?, self.0.get(next)?);
        let share = stamp.seconds_since(before.stamp) / after.stamp.seconds_since(before.stamp);
        Some(before.after(stamp, before.gyro_b.lerp(&after.gyro_b, share)))
    }
}
