//! One step of a state by the inertial sensor.

use crate::estimate::TrackingState;
use crate::inertial::{BelievedSample, ImuNoise, Preintegration, SensorLimits};
use crate::window::growth::GrowingCovariance;
use crate::window::state::NavState;
use nalgebra::Vector3;
use plumbline_config::{ImuSample, Portable, Timestamp, ValidSetup};

/// Estimate, or a state on its way from one to an instant.
#[derive(Clone, Debug, Default)]
pub struct Base {
    /// Time of the state.
    pub stamp: Timestamp,
    /// Time of the estimate: earlier where the state was carried on since.
    pub estimated: Timestamp,
    /// State of motion at `stamp`.
    pub nav: NavState,
    /// Covariance of `nav`.
    pub covariance: GrowingCovariance,
    /// Mean rate since the estimate before it, rad/s.
    pub rate_b: Vector3<f64>,
    /// Tracking state of the estimate.
    pub state: TrackingState,
    /// Quality of the estimate.
    pub quality: i8,
    /// Resets until then.
    pub reset_counter: u32,
}

/// Carries states by inertial samples.
#[derive(Clone, Debug)]
pub struct Carrier {
    noise: ImuNoise,
    /// Limits of the sensor.
    pub limits: SensorLimits,
    gravity_o: Vector3<f64>,
}

impl Carrier {
    /// Carrier by the configured sensor.
    #[must_use]
    pub fn new(setup: &ValidSetup) -> Self {
        Self {
            noise: ImuNoise::of(&setup.imu),
            limits: SensorLimits::of(&setup.imu),
            gravity_o: Vector3::new(0.0, 0.0, -setup.imu.gravity_m_s2),
        }
    }

    /// Carries a state and its covariance to a later time, both times between the samples `last` and `next`. The rate of the estimates
    /// stands in for a gyroscope that does not measure.
    pub fn carry(&self, base: &mut Base, until: Timestamp, (last, next): (&BelievedSample, &BelievedSample)) {
        let nav = &base.nav;
        let (from, to) = (&last.sample, &between(&last.sample, &next.sample, until));
        let dt = until.seconds_since(base.stamp);
        // The estimate may lie anywhere between two samples.
        let apart = next.sample.stamp.seconds_since(from.stamp).at_least(dt);
        let saturated = last.saturated.or(next.saturated);
        let noise = self.limits.noise_of_step(&self.noise, dt, apart, saturated);
        let unmeasured = last.unmeasured.or(next.unmeasured);
        let noise = unmeasured.noise(noise);
        let (mut gyro, mut accels) = ((from.gyro + to.gyro) * 0.5, [from.accel, to.accel]);
        if unmeasured.gyro {
            gyro = base.rate_b + nav.bias_gyro;
        }
        if unmeasured.accel {
            // A steady velocity.
            accels = [nav.rot_o_b.inverse() * -self.gravity_o + nav.bias_accel; 2];
        }
        let mut step = Preintegration::new(&nav.bias_gyro, &nav.bias_accel);
        step.integrate(dt, &gyro, &accels[0], &accels[1], &noise);
        base.covariance.grow(nav, &step, &self.noise);
        base.nav = nav.after(&step, &self.gravity_o);
        base.stamp = until;
    }
}

/// Readings at `stamp`, between two samples: those of `next` at its time.
#[must_use]
pub fn between(last: &ImuSample, next: &ImuSample, stamp: Timestamp) -> ImuSample {
    let span_s = next.stamp.seconds_since(last.stamp);
    if stamp >= next.stamp || span_s <= 0.0 {
        return *next;
    }
    let share = stamp.seconds_since(last.stamp).at_least(0.0) / span_s;
    let mixed = |a: &Vector3<f64>, b: &Vector3<f64>| a + (b - a) * share;
    ImuSample { stamp, gyro: mixed(&last.gyro, &next.gyro), accel: mixed(&last.accel, &next.accel) }
}
