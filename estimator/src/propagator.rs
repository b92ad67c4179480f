//! Odometry at IMU rate: the newest estimate carried forward by every inertial sample.
//!
//! Between two samples the mean angular rate and the specific force of both ends hold, as in
//! [`crate::inertial::preintegration`]. The covariance of position, attitude and velocity grows by the
//! IMU's white noise, by what is not known of its biases ([`crate::window::growth`]), and by what it did not measure
//! while it was saturated or silent ([`crate::inertial::belief`]). What an estimate corrects enters at a bounded rate, or, where
//! it is large, at once ([`blend`]).

pub mod blend;
pub mod carry;
pub mod history;

use crate::admission::ImuDoor;
use crate::estimate::{BiasVariances, Estimate, HealthBits, NavCovariance, Odometry, TrackingState};
use crate::geometry::log_so3;
use crate::inertial::{BelievedSample, StuckWatch, Unmeasured};
use crate::input::ImuAdmission;
use crate::origin::OriginUncertainty;
use crate::window::growth::GrowingCovariance;
use crate::window::state::NavState;
use blend::Blend;
use carry::Carrier;
use history::{Base, History, Instant, NoInstant};
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::{ImuSample, Timestamp, ValidSetup};
use std::collections::VecDeque;

/// Samples are kept this long, s: an estimate must arrive within it.
const MEMORY_S: f64 = 1.0;
/// Odometry that rests on an estimate older than this goes on by the IMU alone, and says so, s.
const STALE_S: f64 = 0.5;

/// Carries the newest estimate forward at IMU rate. Belongs to the tick thread; allocates nothing.
#[derive(Clone, Debug)]
pub struct Propagator {
    carrier: Carrier,
    door: ImuDoor,
    samples: VecDeque<BelievedSample>,
    /// Samples that estimates may reach back to; the history may hold more.
    reach: usize,
    capacity: usize,
    history: History,
    nav: Option<NavState>,
    covariance: GrowingCovariance,
    origin: OriginUncertainty,
    blend: Blend,
    stamp: Timestamp,
    estimated: Timestamp,
    newest: Option<BelievedSample>,
    watch: StuckWatch,
    /// Sensors whose samples are distrusted, whatever they read.
    distrusted: Unmeasured,
    /// Attitude of the last estimate, its time, and the mean rate between the last two, rad/s in `B`.
    turned: Option<(UnitQuaternion<f64>, Timestamp)>,
    rate_b: Vector3<f64>,
    state: TrackingState,
    quality: i8,
    reset_counter: u32,
    jumps: u32,
    /// Reset counter of the last odometry that was handed out, which the next one follows.
    followed: Option<u32>,
    sequence: u64,
}

impl Propagator {
    /// A propagator without a state.
    #[must_use]
    pub fn new(setup: &ValidSetup) -> Self {
        let capacity = samples_in(history::HISTORY_S, setup);
        Self {
            carrier: Carrier::new(setup),
            door: ImuDoor::of(&setup.imu),
            samples: VecDeque::with_capacity(capacity),
            reach: samples_in(MEMORY_S, setup),
            capacity,
            history: History::new(setup),
            nav: None,
            covariance: GrowingCovariance::new(NavCovariance::zeros(), &BiasVariances::zeros()),
            origin: OriginUncertainty::default(),
            blend: Blend::default(),
            stamp: Timestamp::default(),
            estimated: Timestamp::default(),
            newest: None,
            watch: StuckWatch::of(&setup.imu),
            distrusted: Unmeasured::default(),
            turned: None,
            rate_b: Vector3::zeros(),
            state: TrackingState::Initialising,
            quality: -1,
            reset_counter: 0,
            jumps: 0,
            followed: None,
            sequence: 0,
        }
    }

    /// Corrects by the estimate of a frame: the state is propagated anew from its time to the newest sample. What is published
    /// of it moves there at a bounded rate. A large correction, a reset, and the end of an interruption take effect at once.
    /// An estimate without a pose, one that is not finite, and one from before the samples that are kept, end the odometry
    /// until there is another. That of a frame that was refused says nothing.
    pub fn correct(&mut self, estimate: &Estimate) {
        if estimate.is_refused() {
            return;
        }
        self.follow_turn(estimate);
        let told = self.told().filter(|_| estimate.reset_counter == self.reset_counter);
        self.state = estimate.state;
        self.quality = estimate.quality;
        self.reset_counter = estimate.reset_counter;
        if !estimate.has_pose() || !self.reaches_back_to(estimate.stamp) {
            self.end();
            return;
        }
        self.nav = Some(NavState::of(estimate));
        self.covariance = GrowingCovariance::new(estimate.covariance, &estimate.bias_variances);
        self.origin.clone_from(&estimate.origin);
        if !self.is_finite() {
            self.end();
            return;
        }
        (self.stamp, self.estimated) = (estimate.stamp, estimate.stamp);
        self.keep_base();
        let first = self.samples.partition_point(|s| s.sample.stamp <= estimate.stamp);
        let is_any = |bits: [HealthBits; 3]| bits.iter().any(|bit| estimate.health.contains(*bit));
        let [late, early] = [HealthBits::IMU_LATE, HealthBits::IMAGES_LATE];
        self.distrusted = Unmeasured {
            gyro: is_any([late, early, HealthBits::GYRO_CONTRADICTED]),
            accel: is_any([late, early, HealthBits::ACCEL_CONTRADICTED]),
        };
        self.samples.range_mut(first..).for_each(|believed| believed.distrust(self.distrusted));
        self.newest = first.checked_sub(1).map(|k| self.samples[k]);
        for k in first..self.samples.len() {
            let believed = self.samples[k];
            self.advance(&believed);
        }
        self.begin_blend(told);
    }

    /// There is no state any more.
    fn end(&mut self) {
        self.nav = None;
        self.history.end(self.samples.back().map(|newest| newest.sample.stamp));
    }

    /// Keeps the state for the history.
    fn keep_base(&mut self) {
        if let Some(nav) = &self.nav {
            self.history.begin(Base {
                stamp: self.stamp,
                estimated: self.estimated,
                nav: nav.clone(),
                covariance: self.covariance.clone(),
                rate_b: self.rate_b,
                state: self.state,
                quality: self.quality,
                reset_counter: self.reset_counter,
            });
        }
    }

    /// State at `stamp`, which may lie between two samples, by the estimates before and after it: see [`history`].
    ///
    /// # Errors
    /// When no state at `stamp` is available.
    pub fn at(&self, stamp: Timestamp) -> Result<Instant, NoInstant> {
        self.history.at(stamp, &self.samples, &self.carrier)
    }

    /// True if the samples have reached `stamp`.
    #[must_use]
    pub fn has_reached(&self, stamp: Timestamp) -> bool {
        self.samples.back().is_some_and(|newest| newest.sample.stamp >= stamp)
    }

    /// True if the state at `stamp` is final: there is an estimate after it, or none is expected any more.
    #[must_use]
    pub fn is_settled(&self, stamp: Timestamp) -> bool {
        let is_old =
            self.samples.back().is_some_and(|newest| newest.sample.stamp.seconds_since(stamp) > STALE_S);
        is_old || self.history.reaches(stamp)
    }

    /// Follows the rate of the estimates, which stands in for that of a gyroscope that does not measure.
    fn follow_turn(&mut self, estimate: &Estimate) {
        let now = (estimate.pose_o_b.rotation, estimate.stamp);
        self.rate_b = match self.turned.filter(|_| estimate.reset_counter == self.reset_counter) {
            Some((before, stamp)) if now.1 > stamp => {
                log_so3(&(before.inverse() * now.0)) / now.1.seconds_since(stamp)
            }
            _ => Vector3::zeros(),
        };
        self.turned = estimate.has_pose().then_some(now);
    }

    /// State to be published and its time.
    fn told(&self) -> Option<(NavState, Timestamp)> {
        self.nav.as_ref().map(|nav| (self.blend.told(nav), self.stamp))
    }

    /// Lets the state that was corrected go on from what was published of it before, unless it is of a start. A step without a
    /// reset is counted, once for each odometry that others have.
    fn begin_blend(&mut self, told: Option<(NavState, Timestamp)>) {
        self.blend = Blend::default();
        let is_continued = match (&self.nav, told) {
            (Some(nav), Some((mut told, stamp))) => {
                // Where samples are missing the estimate may be newer than what was told.
                told.p_o_b += told.v_o_b * self.stamp.seconds_since(stamp);
                self.blend.begin(&told, nav)
            }
            _ => false,
        };
        if !is_continued && self.followed.take() == Some(self.reset_counter) {
            self.jumps = self.jumps.wrapping_add(1);
        }
    }

    /// True if a sample follows those before it: see [`crate::admission`].
    #[must_use]
    pub fn expects(&self, sample: &ImuSample) -> bool {
        self.door.expects(sample)
    }

    /// True if the samples kept continue from `stamp`.
    fn reaches_back_to(&self, stamp: Timestamp) -> bool {
        let first = self.samples.get(self.samples.len().saturating_sub(self.reach));
        first.is_none_or(|first| first.sample.stamp.seconds_since(stamp) <= STALE_S)
    }

    /// Advances to an inertial sample; the odometry at its time, once there has been an estimate with a pose.
    /// A sample that the front-end refuses is refused here too. Where the clock was set the odometry ends until there
    /// is an estimate of the new time.
    pub fn tick(&mut self, sample: &ImuSample) -> Option<Odometry> {
        match self.door.admit(sample) {
            ImuAdmission::Accepted => {}
            ImuAdmission::ClockSet => {
                self.samples.clear();
                self.watch.clear();
                (self.nav, self.newest) = (None, None);
                self.history.clear();
            }
            _ => return None,
        }
        let believed = self.believe(sample);
        if self.samples.len() == self.capacity {
            self.samples.pop_front();
        }
        self.samples.push_back(believed);
        let before = self.stamp;
        self.advance(&believed);
        self.blend.advance(self.stamp.seconds_since(before));
        if !self.is_finite() {
            // A reading beyond all bounds, as far as it counts: the next estimate begins anew.
            self.end();
        }
        // No estimate has come for long.
        if self.history.wants_mark(self.stamp) {
            self.keep_base();
        }
        let (told, stamp) = self.told()?;
        if sample.stamp < stamp {
            return None;
        }
        let is_stale = sample.stamp.seconds_since(self.estimated) > STALE_S;
        let odometry = Odometry {
            sequence: self.sequence,
            stamp: sample.stamp,
            pose_o_b: told.pose_o_b(),
            v_o_b: told.v_o_b,
            angular_rate_b: match believed.unmeasured.gyro {
                true => self.rate_b,
                false => believed.sample.gyro - told.bias_gyro,
            },
            covariance: self.blend.covariance(&self.covariance.nav),
            state: if is_stale { TrackingState::Blind } else { self.state },
            quality: if is_stale { self.quality.min(0) } else { self.quality },
            reset_counter: self.reset_counter,
            jumps: self.jumps,
            origin: self.origin.clone(),
        };
        self.followed = Some(self.reset_counter);
        self.sequence += 1;
        Some(odometry)
    }

    /// The sample as it is believed. Those before it that a stuck sensor repeated lose belief: the next estimate goes by that.
    fn believe(&mut self, sample: &ImuSample) -> BelievedSample {
        let stuck = self.watch.update(sample);
        if stuck.unmeasured().is_any() {
            for believed in &mut self.samples {
                believed.distrust(stuck.at(believed.sample.stamp));
            }
        }
        let mut believed = self.carrier.limits.believe(sample, self.samples.back());
        believed.distrust(stuck.unmeasured().or(self.distrusted));
        believed
    }

    /// True if the state carried, if there is one, is finite.
    fn is_finite(&self) -> bool {
        self.nav.as_ref().is_none_or(NavState::is_finite) && self.covariance.is_finite()
    }

    /// Integrates from the present time to that of `next`.
    fn advance(&mut self, next: &BelievedSample) {
        let last = self.newest.unwrap_or(*next);
        let until = next.sample.stamp;
        if until > self.stamp
            && let Some(nav) = &mut self.nav
        {
            self.carrier.carry((nav, &mut self.covariance), (self.stamp, until), (&last, next), &self.rate_b);
            self.stamp = until;
        }
        self.newest = Some(*next);
    }
}

/// Samples of so long, s, and both ends.
fn samples_in(seconds: f64, setup: &ValidSetup) -> usize {
    (seconds * setup.imu.rate_hz).ceil() as usize + 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::{FrameFigures, HealthBits};
    use nalgebra::Isometry3;
    use plumbline_config::{Config, ValidConfig};

    /// The rig of the tests, whose readings repeat.
    fn sensor_without_noise() -> ValidConfig {
        let config = Config::preset("sim").expect("is valid");
        config.with("test", |c| c.imu.stuck_after_s = 0.0).expect("is valid")
    }

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
            origin: OriginUncertainty::default(),
            bias_variances: BiasVariances::zeros(),
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
        let config = sensor_without_noise();
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

    /// Standard deviations of position and velocity, m and m/s, a second after `estimate`, of samples that `spoil` changes.
    fn sigmas(estimate: &Estimate, spoil: fn(i64, &mut ImuSample), skips: fn(i64) -> bool) -> [f64; 2] {
        let mut propagator = Propagator::new(sensor_without_noise().setup());
        propagator.correct(estimate);
        let sample = |k: i64| {
            let stamp = Timestamp::from_nanos((1000 + 5 * k) * 1_000_000);
            let mut reading =
                ImuSample { stamp, gyro: Vector3::zeros(), accel: Vector3::new(0.0, 0.0, 9.81) };
            spoil(k, &mut reading);
            reading
        };
        let odometry = (1..=200).filter(|k| !skips(*k)).filter_map(|k| propagator.tick(&sample(k)));
        let odometry = odometry.reduce(|_, newest| newest);
        let covariance = odometry.expect("there is a pose").covariance;
        [covariance[(0, 0)].sqrt(), covariance[(6, 6)].sqrt()]
    }

    #[test]
    fn biases_gaps_and_saturation_cost_certainty() {
        let known = estimate();
        let variances = BiasVariances::from_column_slice(&[0.0, 0.0, 0.0, 0.01, 0.01, 0.01]);
        let unsure = Estimate { bias_variances: variances, ..known.clone() };
        let [position_m, velocity_m_s] = sigmas(&known, |_, _| {}, |_| false);
        assert!(position_m < 0.06 && velocity_m_s < 0.15, "{position_m} {velocity_m_s}");
        // A bias of 0.1 m/s² is 0.1 m/s and 5 cm after a second.
        let [of_bias_m, of_bias_m_s] = sigmas(&unsure, |_, _| {}, |_| false);
        let hypot = |a: f64, b: f64| (a * a + b * b).sqrt();
        assert!((of_bias_m / hypot(position_m, 0.05) - 1.0).abs() < 0.02, "{of_bias_m}");
        assert!((of_bias_m_s / hypot(velocity_m_s, 0.1) - 1.0).abs() < 0.02, "{of_bias_m_s}");
        let [_, of_gap_m_s] = sigmas(&known, |_, _| {}, |k| (80..120).contains(&k));
        assert!(of_gap_m_s > 0.8, "0.2 s without a sample: {of_gap_m_s} m/s");
        let hit = |k: i64, reading: &mut ImuSample| {
            if (80..140).contains(&k) {
                reading.accel = Vector3::new(156.9, -156.9, 156.9);
            }
        };
        let [_, of_blow_m_s] = sigmas(&known, hit, |_| false);
        assert!(of_blow_m_s > 2.0, "0.3 s at the end of the range: {of_blow_m_s} m/s");
    }

    #[test]
    fn sensors_that_are_contradicted_carry_no_state() {
        let carried = |bit: HealthBits| {
            let mut propagator = Propagator::new(sensor_without_noise().setup());
            propagator.correct(&Estimate { health: bit, ..estimate() });
            let wrong = |_: i64, reading: &mut ImuSample| {
                reading.accel.x += 5.0;
                reading.gyro.z += 0.5;
            };
            let newest = run(&mut propagator, 1000, wrong).swap_remove(20);
            let sigma = |part: usize| newest.covariance[(part, part)].sqrt();
            (newest.v_o_b.x, sigma(6), newest.pose_o_b.rotation.angle(), sigma(3))
        };
        let (gained_m_s, sigma_m_s, ..) = carried(HealthBits::ACCEL_CONTRADICTED);
        assert!(gained_m_s.abs() < 0.05 && sigma_m_s > 0.1, "{gained_m_s}, {sigma_m_s} m/s");
        let (.., turned_rad, sigma_rad) = carried(HealthBits::GYRO_CONTRADICTED);
        assert!(turned_rad < 1e-3 && sigma_rad > 0.02, "{turned_rad}, {sigma_rad} rad");
        let (gained_m_s, _, turned_rad, _) = carried(HealthBits::default());
        assert!(gained_m_s > 0.4 && turned_rad > 0.04, "sensors that are believed carry it");
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
                let mut propagator = Propagator::new(sensor_without_noise().setup());
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
    fn a_correction_enters_at_a_bounded_rate_and_that_of_a_reset_at_once() {
        let mut propagator = Propagator::new(sensor_without_noise().setup());
        propagator.correct(&estimate());
        let before = run(&mut propagator, 1000, |_, _| {}).pop().expect("flies");
        let at = |seconds: i64, x: f64, reset_counter: u32| Estimate {
            stamp: Timestamp::from_nanos(seconds * 1_000_000_000),
            pose_o_b: Isometry3::translation(x, 0.0, 0.0),
            reset_counter,
            ..estimate()
        };
        propagator.correct(&at(2, 0.06, 0));
        let after = run(&mut propagator, 2000, |_, _| {});
        let x = |o: &Odometry| o.pose_o_b.translation.x;
        let steps = std::iter::once(&before).chain(&after).zip(&after).map(|(a, b)| x(b) - x(a));
        let largest = steps.fold(0.0, |most: f64, step| most.max(step.abs()));
        assert!(largest <= blend::MAX_SPEED_M_S * 0.005 + 1e-6, "a step of {largest} m");
        assert!(after[0].covariance[(0, 0)].sqrt() > 0.058, "it is told what is still to come");
        assert!((x(&after[199]) - 0.06).abs() < 1e-4, "{} m in the end", x(&after[199]));
        propagator.correct(&at(3, 5.0, 1));
        let reset = run(&mut propagator, 3000, |_, _| {});
        assert!((x(&reset[0]) - 5.0).abs() < 1e-4, "a reset is told as one");
        assert!(after.iter().chain(&reset).all(|o| o.jumps == 0) && reset[0].steps() == 1);
    }

    #[test]
    fn a_large_correction_is_taken_at_once_and_counted() {
        let mut propagator = Propagator::new(Config::preset("sim").expect("is valid").setup());
        propagator.correct(&estimate());
        run(&mut propagator, 1000, |_, _| {});
        // The first estimate after darkness, which knew nothing of the velocity, and the next, which does.
        let mut right = Estimate { stamp: Timestamp::from_nanos(2_000_000_000), ..estimate() };
        right.v_o_b = Vector3::new(1.2, 0.0, 0.0);
        propagator.correct(&right);
        let after = run(&mut propagator, 2000, |_, _| {});
        assert!((after[0].v_o_b.x - 1.2).abs() < 1e-3, "{}", after[0].v_o_b);
        assert!(after.iter().all(|o| (o.reset_counter, o.jumps, o.steps()) == (0, 1, 1)));
    }

    #[test]
    fn odometry_that_resumes_without_a_reset_is_counted_as_a_step() {
        let mut propagator = Propagator::new(Config::preset("sim").expect("is valid").setup());
        propagator.correct(&estimate());
        assert!(run(&mut propagator, 1000, |_, _| {}).iter().all(|o| o.jumps == 0));
        propagator.correct(&Estimate { state: TrackingState::Failed, ..estimate() });
        assert!(run(&mut propagator, 2000, |_, _| {}).is_empty());
        let mut next = estimate();
        next.stamp = Timestamp::from_nanos(3_000_000_000);
        propagator.correct(&next);
        propagator.correct(&next);
        assert!(run(&mut propagator, 3000, |_, _| {}).iter().all(|o| o.jumps == 1));
    }

    #[test]
    fn an_estimate_from_before_the_samples_that_are_kept_ends_the_odometry() {
        let mut propagator = Propagator::new(sensor_without_noise().setup());
        let _ = run(&mut propagator, 5000, |_, _| {});
        let _ = run(&mut propagator, 6000, |_, _| {});
        propagator.correct(&estimate());
        assert!(run(&mut propagator, 7000, |_, _| {}).is_empty());
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
                let mut propagator = Propagator::new(sensor_without_noise().setup());
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
