//! Odometry at IMU rate: the newest estimate carried forward by every inertial sample.
//!
//! Between two samples the mean angular rate and the specific force of both ends hold, as in
//! [`crate::inertial::preintegration`]. The covariance of position, attitude and velocity grows by the
//! IMU's white noise; that of the biases enters through the estimate it starts from.

use crate::admission::ImuDoor;
use crate::estimate::{Estimate, NavCovariance, Odometry, TrackingState};
use crate::inertial::{ImuNoise, Preintegration};
use crate::input::ImuAdmission;
use crate::window::state::NavState;
use nalgebra::Vector3;
use plumbline_config::{ImuSample, Timestamp, ValidSetup};
use std::collections::VecDeque;

/// Samples are kept this long, s: an estimate must arrive within it.
const MEMORY_S: f64 = 1.0;
/// Odometry that rests on an estimate older than this goes on by the IMU alone, and says so, s.
const STALE_S: f64 = 0.5;

/// Carries the newest estimate forward at IMU rate. Belongs to the tick thread; allocates nothing.
#[derive(Clone, Debug)]
pub struct Propagator {
    noise: ImuNoise,
    gravity_o: Vector3<f64>,
    door: ImuDoor,
    samples: VecDeque<ImuSample>,
    capacity: usize,
    nav: Option<NavState>,
    covariance: NavCovariance,
    stamp: Timestamp,
    estimated: Timestamp,
    newest: Option<ImuSample>,
    state: TrackingState,
    quality: i8,
    reset_counter: u32,
    sequence: u64,
}

impl Propagator {
    /// A propagator without a state.
    #[must_use]
    pub fn new(setup: &ValidSetup) -> Self {
        let capacity = (MEMORY_S * setup.imu.rate_hz).ceil() as usize + 2;
        Self {
            noise: ImuNoise::of(&setup.imu),
            gravity_o: Vector3::new(0.0, 0.0, -setup.imu.gravity_m_s2),
            door: ImuDoor::of(&setup.imu),
            samples: VecDeque::with_capacity(capacity),
            capacity,
            nav: None,
            covariance: NavCovariance::zeros(),
            stamp: Timestamp::default(),
            estimated: Timestamp::default(),
            newest: None,
            state: TrackingState::Initialising,
            quality: -1,
            reset_counter: 0,
            sequence: 0,
        }
    }

    /// Corrects by the estimate of a frame: the state is propagated anew from its time to the newest sample.
    /// An estimate without a pose, one that is not finite, and one from before the samples that are kept, end the odometry
    /// until there is another. That of a frame that was refused says nothing.
    pub fn correct(&mut self, estimate: &Estimate) {
        if estimate.is_refused() {
            return;
        }
        self.state = estimate.state;
        self.quality = estimate.quality;
        self.reset_counter = estimate.reset_counter;
        if !estimate.has_pose() || !self.reaches_back_to(estimate.stamp) {
            self.nav = None;
            return;
        }
        self.nav = Some(NavState {
            p_o_b: estimate.pose_o_b.translation.vector,
            rot_o_b: estimate.pose_o_b.rotation,
            v_o_b: estimate.v_o_b,
            bias_gyro: estimate.bias_gyro,
            bias_accel: estimate.bias_accel,
        });
        self.covariance = estimate.covariance;
        if !self.is_finite() {
            self.nav = None;
            return;
        }
        self.stamp = estimate.stamp;
        self.estimated = estimate.stamp;
        let first = self.samples.partition_point(|s| s.stamp <= estimate.stamp);
        self.newest = first.checked_sub(1).map(|k| self.samples[k]);
        for k in first..self.samples.len() {
            let sample = self.samples[k];
            self.advance(&sample);
        }
    }

    /// Whether a sample follows those before it: see [`crate::admission`].
    #[must_use]
    pub fn expects(&self, sample: &ImuSample) -> bool {
        self.door.expects(sample)
    }

    /// Whether the samples that are kept lead on from `stamp`.
    fn reaches_back_to(&self, stamp: Timestamp) -> bool {
        self.samples.front().is_none_or(|first| first.stamp.seconds_since(stamp) <= STALE_S)
    }

    /// Advances to an inertial sample; the odometry at its time, once there has been an estimate with a pose.
    /// A sample that the front-end refuses is refused here too. Where the clock was set the odometry ends until there
    /// is an estimate of the new time.
    pub fn tick(&mut self, sample: &ImuSample) -> Option<Odometry> {
        match self.door.admit(sample) {
            ImuAdmission::Accepted => {}
            ImuAdmission::ClockSet => {
                self.samples.clear();
                (self.nav, self.newest) = (None, None);
            }
            _ => return None,
        }
        if self.samples.len() == self.capacity {
            self.samples.pop_front();
        }
        self.samples.push_back(*sample);
        self.advance(sample);
        if !self.is_finite() {
            // A reading beyond all bounds, as far as it counts: the next estimate begins anew.
            self.nav = None;
        }
        let nav = self.nav.as_ref()?;
        if sample.stamp < self.stamp {
            return None;
        }
        let is_stale = sample.stamp.seconds_since(self.estimated) > STALE_S;
        let odometry = Odometry {
            sequence: self.sequence,
            stamp: sample.stamp,
            pose_o_b: nav.pose_o_b(),
            v_o_b: nav.v_o_b,
            angular_rate_b: sample.gyro - nav.bias_gyro,
            covariance: self.covariance,
            state: if is_stale { TrackingState::Blind } else { self.state },
            quality: if is_stale { self.quality.min(0) } else { self.quality },
            reset_counter: self.reset_counter,
        };
        self.sequence += 1;
        Some(odometry)
    }

    /// Whether the state carried, if there is one, is made of finite numbers.
    fn is_finite(&self) -> bool {
        self.nav.as_ref().is_none_or(NavState::is_finite) && self.covariance.iter().all(|x| x.is_finite())
    }

    /// Integrates from the present time to that of `sample`.
    fn advance(&mut self, sample: &ImuSample) {
        let dt = sample.stamp.seconds_since(self.stamp);
        let last = self.newest.unwrap_or(*sample);
        if dt > 0.0
            && let Some(nav) = &mut self.nav
        {
            let mut step = Preintegration::new(&nav.bias_gyro, &nav.bias_accel);
            step.integrate(dt, &((last.gyro + sample.gyro) * 0.5), &last.accel, &sample.accel, &self.noise);
            self.covariance = nav.covariance_after(&self.covariance, &step);
            *nav = nav.after(&step, &self.gravity_o);
            self.stamp = sample.stamp;
        }
        self.newest = Some(*sample);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::{FrameFigures, HealthBits};
    use nalgebra::Isometry3;
    use plumbline_config::Config;

    fn estimate() -> Estimate {
        Estimate {
            frame_sequence: 0,
            stamp: Timestamp::from_nanos(1_000_000_000),
            state: TrackingState::Tracking,
            pose_o_b: Isometry3::identity(),
            v_o_b: Vector3::zeros(),
            bias_gyro: Vector3::zeros(),
            bias_accel: Vector3::zeros(),
            covariance: NavCovariance::identity() * 1e-4,
            time_offset_s: 0.0,
            time_offset_sigma_s: 0.0,
            pose_b_c0: Isometry3::identity(),
            quality: 90,
            health: HealthBits::default(),
            reset_counter: 0,
            figures: FrameFigures::default(),
        }
    }

    #[test]
    fn odometry_without_news_of_the_cameras_goes_on_and_says_that_it_is_blind() {
        let config = Config::preset("sim").expect("is valid");
        let mut propagator = Propagator::new(config.setup());
        propagator.correct(&estimate());
        let outputs: Vec<_> = (1..=200)
            .filter_map(|k| {
                let stamp = Timestamp::from_nanos(1_000_000_000 + k * 5_000_000);
                let accel = Vector3::new(0.0, 0.0, config.imu.gravity_m_s2);
                propagator.tick(&ImuSample { stamp, gyro: Vector3::zeros(), accel })
            })
            .collect();
        assert_eq!(outputs.len(), 200);
        let said = |k: usize| (outputs[k].state, outputs[k].quality);
        assert_eq!(said(90), (TrackingState::Tracking, 90));
        assert_eq!(said(199), (TrackingState::Blind, 0));
        assert!(outputs[199].covariance[(0, 0)] > outputs[0].covariance[(0, 0)]);
    }

    fn is_finite(odometry: &Odometry) -> bool {
        let pose = &odometry.pose_o_b;
        let vectors = [&pose.translation.vector, &odometry.v_o_b, &odometry.angular_rate_b];
        vectors
            .into_iter()
            .flatten()
            .chain(pose.rotation.coords.iter())
            .chain(&odometry.covariance)
            .all(|x| x.is_finite())
    }

    /// A second of odometry at rest, sample `k` and what comes of the estimate as they are made.
    fn run(
        propagator: &mut Propagator,
        from_ms: i64,
        mut sample: impl FnMut(i64, &mut ImuSample),
    ) -> Vec<Odometry> {
        (1..=200)
            .filter_map(|k| {
                let stamp = Timestamp::from_nanos((from_ms + 5 * k) * 1_000_000);
                let mut reading =
                    ImuSample { stamp, gyro: Vector3::zeros(), accel: Vector3::new(0.0, 0.0, 9.81) };
                sample(k, &mut reading);
                propagator.tick(&reading)
            })
            .collect()
    }

    #[test]
    fn readings_that_are_no_numbers_or_beyond_all_bounds_never_reach_the_odometry() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e200, -1e300, f64::MAX] {
            for axis in 0..6 {
                let mut propagator = Propagator::new(Config::preset("sim").expect("is valid").setup());
                propagator.correct(&estimate());
                let odometry = run(&mut propagator, 1000, |k, reading| {
                    let part = if axis < 3 { &mut reading.gyro } else { &mut reading.accel };
                    if k == 50 {
                        part[axis % 3] = value
                    }
                });
                assert!(odometry.len() >= 49 && odometry.iter().all(is_finite), "{value} on axis {axis}");
                // An estimate from after it sets it right.
                let mut next = estimate();
                next.stamp = Timestamp::from_nanos(2_000_000_000);
                propagator.correct(&next);
                let odometry = run(&mut propagator, 2000, |_, _| {});
                assert!(odometry.len() == 200 && odometry.iter().all(is_finite), "{value} on axis {axis}");
            }
        }
    }

    #[test]
    fn an_estimate_that_is_not_finite_ends_the_odometry_until_the_next() {
        for value in [f64::NAN, f64::INFINITY] {
            let poisons: [fn(&mut Estimate, f64); 5] = [
                |e, x| e.pose_o_b.translation.vector.y = x,
                |e, x| e.v_o_b.x = x,
                |e, x| e.bias_gyro.z = x,
                |e, x| e.bias_accel.x = x,
                |e, x| e.covariance[(3, 3)] = x,
            ];
            for (which, poison) in poisons.iter().enumerate() {
                let mut propagator = Propagator::new(Config::preset("sim").expect("is valid").setup());
                let mut bad = estimate();
                poison(&mut bad, value);
                propagator.correct(&bad);
                assert!(run(&mut propagator, 1000, |_, _| {}).is_empty(), "{which}: {value}");
                let mut good = estimate();
                good.stamp = Timestamp::from_nanos(2_000_000_000);
                propagator.correct(&good);
                assert_eq!(run(&mut propagator, 2000, |_, _| {}).len(), 200);
            }
        }
    }
}
