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
use crate::estimate::{Estimate, HealthBits, Odometry};
use crate::geometry::log_so3;
use crate::inertial::{BelievedSample, StuckWatch, Unmeasured};
use crate::input::ImuAdmission;
use crate::origin::OriginUncertainty;
use crate::window::growth::GrowingCovariance;
use crate::window::state::NavState;
use blend::Blend;
use carry::{Base, Carrier};
use history::{History, Instant, NoInstant};
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
    /// The newest estimate, carried to the newest sample.
    carried: Base,
    /// True if it has a pose.
    has_pose: bool,
    origin: OriginUncertainty,
    blend: Blend,
    newest: Option<BelievedSample>,
    watch: StuckWatch,
    /// Sensors whose samples are distrusted, whatever they read.
    distrusted: Unmeasured,
    /// Attitude of the last estimate, and its time.
    turned: Option<(UnitQuaternion<f64>, Timestamp)>,
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
            carried: Base::default(),
            has_pose: false,
            origin: OriginUncertainty::default(),
            blend: Blend::default(),
            newest: None,
            watch: StuckWatch::of(&setup.imu),
            distrusted: Unmeasured::default(),
            turned: None,
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
        let told = self.told().filter(|_| estimate.reset_counter == self.carried.reset_counter);
        self.carried.state = estimate.state;
        self.carried.quality = estimate.quality;
        self.carried.reset_counter = estimate.reset_counter;
        if !estimate.has_pose() || !self.reaches_back_to(estimate.stamp) {
            self.end();
            return;
        }
        self.has_pose = true;
        self.carried.nav = NavState::of(estimate);
        self.carried.covariance = GrowingCovariance::new(estimate.covariance, &estimate.bias_variances);
        self.origin.clone_from(&estimate.origin);
        if !self.is_finite() {
            self.end();
            return;
        }
        (self.carried.stamp, self.carried.estimated) = (estimate.stamp, estimate.stamp);
        self.history.begin(self.carried.clone());
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
        self.has_pose = false;
        self.history.end(self.samples.back().map(|newest| newest.sample.stamp));
    }

    /// State at `stamp`, which may lie between two samples, by the estimates before and after it: see [`history`].
    ///
    /// # Errors
    /// When no state at `stamp` is available.
    pub fn at(&self, stamp: Timestamp) -> Result<Instant, NoInstant> {
        self.history.at(stamp, &self.samples, &self.carrier)
    }

    /// True if the samples have reached `stamp`.
    pub fn has_reached(&self, stamp: Timestamp) -> bool {
        self.samples.back().is_some_and(|newest| newest.sample.stamp >= stamp)
    }

    /// True if the state at `stamp` is final: there is an estimate after it, or none is expected any more.
    pub fn is_settled(&self, stamp: Timestamp) -> bool {
        let is_old =
            self.samples.back().is_some_and(|newest| newest.sample.stamp.seconds_since(stamp) > STALE_S);
        is_old || self.history.reaches(stamp)
    }

    /// Follows the rate of the estimates, which stands in for that of a gyroscope that does not measure.
    fn follow_turn(&mut self, estimate: &Estimate) {
        let now = (estimate.pose_o_b.rotation, estimate.stamp);
        let goes_on = estimate.reset_counter == self.carried.reset_counter;
        self.carried.rate_b = match self.turned.filter(|_| goes_on) {
            Some((before, stamp)) if now.1 > stamp => {
                log_so3(&(before.inverse() * now.0)) / now.1.seconds_since(stamp)
            }
            _ => Vector3::zeros(),
        };
        self.turned = estimate.has_pose().then_some(now);
    }

    /// State to be published and its time.
    fn told(&self) -> Option<(NavState, Timestamp)> {
        self.has_pose.then(|| (self.blend.told(&self.carried.nav), self.carried.stamp))
    }

    /// Lets the state that was corrected go on from what was published of it before, unless it is of a start. A step without a
    /// reset is counted, once for each odometry that others have.
    fn begin_blend(&mut self, told: Option<(NavState, Timestamp)>) {
        self.blend = Blend::default();
        let is_continued = told.is_some_and(|(mut told, stamp)| {
            // Where samples are missing the estimate may be newer than what was told.
            told.p_o_b += told.v_o_b * self.carried.stamp.seconds_since(stamp);
            self.blend.begin(&told, &self.carried.nav)
        });
        if !is_continued && self.followed.take() == Some(self.carried.reset_counter) {
            self.jumps = self.jumps.wrapping_add(1);
        }
    }

    /// True if a sample follows those before it: see [`crate::admission`].
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
                (self.has_pose, self.newest) = (false, None);
                self.history.clear();
            }
            _ => return None,
        }
        let believed = self.believe(sample);
        if self.samples.len() == self.capacity {
            self.samples.pop_front();
        }
        self.samples.push_back(believed);
        let before = self.carried.stamp;
        self.advance(&believed);
        self.blend.advance(self.carried.stamp.seconds_since(before));
        if !self.is_finite() {
            // A reading beyond all bounds, as far as it counts: the next estimate begins anew.
            self.end();
        }
        // No estimate has come for long.
        if self.has_pose && self.history.wants_mark(self.carried.stamp) {
            self.history.begin(self.carried.clone());
        }
        let (told, stamp) = self.told()?;
        if sample.stamp < stamp {
            return None;
        }
        let (state, quality) = self.carried.trust();
        let odometry = Odometry {
            sequence: self.sequence,
            stamp: sample.stamp,
            pose_o_b: told.pose_o_b(),
            v_o_b: told.v_o_b,
            angular_rate_b: match believed.unmeasured.gyro {
                true => self.carried.rate_b,
                false => believed.sample.gyro - told.bias_gyro,
            },
            covariance: self.blend.covariance(&self.carried.covariance.nav),
            state,
            quality,
            reset_counter: self.carried.reset_counter,
            jumps: self.jumps,
            origin: self.origin.clone(),
        };
        self.followed = Some(self.carried.reset_counter);
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
        (!self.has_pose || self.carried.nav.is_finite()) && self.carried.covariance.is_finite()
    }

    /// Integrates from the present time to that of `next`.
    fn advance(&mut self, next: &BelievedSample) {
        let last = self.newest.unwrap_or(*next);
        let until = next.sample.stamp;
        if self.has_pose && until > self.carried.stamp {
            self.carrier.carry(&mut self.carried, until, (&last, next));
        }
        self.newest = Some(*next);
    }
}

/// Samples of so long, s, and both ends.
fn samples_in(seconds: f64, setup: &ValidSetup) -> usize {
    (seconds * setup.imu.rate_hz).ceil() as usize + 2
}

#[cfg(test)]
mod tests;
