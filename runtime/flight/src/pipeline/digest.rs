//! SHA-256 over the bits of what was estimated: two runs agree in it or differ.
//!
//! It holds what a user of the estimate acts on. Left out are the figures of a frame, the sigma of the time offset, and
//! of odometry its number, state and quality: `verify` of the flight log compares these too, field by field.

use nalgebra::{Isometry3, Vector3};
use plumbline_config::Config;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, NavCovariance, Odometry};
use sha2::{Digest as _, Sha256};

/// A running digest.
#[derive(Clone, Debug, Default)]
pub struct Digest(Sha256);

impl Digest {
    /// Adds an estimate.
    pub fn estimate(&mut self, e: &Estimate) {
        self.integer(e.stamp.as_nanos());
        self.integer(e.frame_sequence as i64);
        self.pose(&e.pose_o_b);
        for v in [&e.v_o_b, &e.bias_gyro, &e.bias_accel] {
            self.vector(v);
        }
        self.covariance(&e.covariance);
        self.number(e.time_offset_s);
        self.pose(&e.pose_b_c0);
        self.integer(e.state as i64);
        self.integer(i64::from(e.quality));
        self.integer(i64::from(e.health.0));
        self.integer(i64::from(e.reset_counter));
    }

    /// Adds odometry.
    pub fn odometry(&mut self, o: &Odometry) {
        self.integer(o.stamp.as_nanos());
        self.pose(&o.pose_o_b);
        self.vector(&o.v_o_b);
        self.vector(&o.angular_rate_b);
        self.covariance(&o.covariance);
        self.integer(i64::from(o.steps()));
    }

    /// Adds where the odometry lies in the map.
    pub fn map_estimate(&mut self, m: &MapEstimate) {
        self.integer(m.stamp.as_nanos());
        self.integer(m.frame_sequence as i64);
        self.integer(i64::from(m.pose_m_o.is_some()));
        if let Some(pose_m_o) = &m.pose_m_o {
            self.pose(pose_m_o);
        }
        self.integer(i64::from(m.reset_counter));
        for count in [m.keyframes, m.sightings, m.loops_used] {
            self.integer(i64::from(count));
        }
    }

    /// The digest so far, in hexadecimal.
    #[must_use]
    pub fn hex(&self) -> String {
        self.0.clone().finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    fn integer(&mut self, value: i64) {
        self.0.update(value.to_le_bytes());
    }

    fn number(&mut self, value: f64) {
        self.0.update(value.to_bits().to_le_bytes());
    }

    fn vector(&mut self, v: &Vector3<f64>) {
        v.iter().for_each(|x| self.number(*x));
    }

    fn pose(&mut self, pose: &Isometry3<f64>) {
        self.vector(&pose.translation.vector);
        pose.rotation.coords.iter().for_each(|x| self.number(*x));
    }

    fn covariance(&mut self, covariance: &NavCovariance) {
        covariance.iter().for_each(|x| self.number(*x));
    }
}

/// SHA-256 of the configuration as TOML.
#[must_use]
pub fn config_hash(config: &Config) -> String {
    hash_of(&config.to_toml().unwrap_or_default())
}

/// SHA-256 of a text, in hexadecimal.
#[must_use]
pub fn hash_of(text: &str) -> String {
    Sha256::digest(text.as_bytes()).iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bit_makes_another_digest() {
        let (mut a, mut b) = (Digest::default(), Digest::default());
        a.number(1.0);
        b.number(f64::from_bits(1.0f64.to_bits() + 1));
        assert_ne!(a.hex(), b.hex());
        assert_eq!(a.hex().len(), 64);
    }
}
