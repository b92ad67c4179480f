//! The newest inertial samples, in order, in fixed memory.

use super::belief::{BelievedSample, SensorLimits};
use super::preintegration::{ImuNoise, Preintegration};
use super::stuck::{StuckWatch, Unmeasured};
use super::vibration::{self, Vibration};
use nalgebra::Vector3;
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Portable, Timestamp};
use std::collections::VecDeque;

/// Inertial samples are kept this long, s: the longest start and the longest gap between frames.
pub const IMU_MEMORY_S: f64 = 10.0;

/// Coverage of an integration by samples: gaps, saturation, unmeasured readings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Coverage {
    /// The interval was not covered by samples throughout.
    pub has_gap: bool,
    /// A sample was at the end of the sensor's range.
    pub is_saturated: bool,
    /// The sensors that did not measure throughout.
    pub unmeasured: Unmeasured,
}

impl Coverage {
    /// True if both sensors measured throughout.
    pub fn is_measured(&self) -> bool {
        !self.has_gap && !self.unmeasured.is_any()
    }
}

/// A ring of the newest samples. Full, it forgets the oldest.
#[derive(Clone, Debug)]
pub struct ImuBuffer {
    samples: VecDeque<BelievedSample>,
    capacity: usize,
    limits: SensorLimits,
    watch: StuckWatch,
    stuck: Unmeasured,
    /// Sensors whose samples are distrusted, whatever they read.
    distrusted: Unmeasured,
    /// Time after which samples are distrusted that may prove right.
    accused_since: Option<Timestamp>,
    /// Samples later than this are believed otherwise than when they came.
    revised_since: Option<Timestamp>,
}

impl ImuBuffer {
    /// Room for [`IMU_MEMORY_S`] of a sensor's samples. Saturated readings are kept as [`super::belief`] says.
    pub fn of(imu: &ImuConfig) -> Self {
        let capacity = (IMU_MEMORY_S * imu.rate_hz).ceil() as usize + 2;
        Self {
            samples: VecDeque::with_capacity(capacity),
            capacity,
            limits: SensorLimits::of(imu),
            watch: StuckWatch::of(imu),
            stuck: Unmeasured::default(),
            distrusted: Unmeasured::default(),
            accused_since: None,
            revised_since: None,
        }
    }

    /// Appends a sample of finite numbers. Those that are not earlier are forgotten: it is believed, they were wrong.
    pub fn push(&mut self, sample: &ImuSample) -> bool {
        if !sample.is_finite() {
            return false;
        }
        while self.samples.back().is_some_and(|last| sample.stamp <= last.sample.stamp) {
            self.samples.pop_back();
        }
        if self.samples.len() == self.capacity {
            self.samples.pop_front();
        }
        let mut believed = self.limits.believe(sample, self.samples.back());
        let stuck = self.watch.update(sample);
        let unmeasured = stuck.unmeasured();
        self.stuck = unmeasured;
        if unmeasured.is_any() {
            self.accused_since = None;
            self.revise(stuck.gyro, Unmeasured { gyro: true, accel: false });
            self.revise(stuck.accel, Unmeasured { gyro: false, accel: true });
        }
        believed.distrust(unmeasured.or(self.distrusted));
        self.samples.push_back(believed);
        true
    }

    /// Takes away what `unmeasured` sensors read after `since`, as far as it was believed.
    fn revise(&mut self, since: Option<Timestamp>, unmeasured: Unmeasured) {
        let Some(since) = since else { return };
        let is_new = |believed: &&mut BelievedSample| {
            believed.sample.stamp > since && believed.unmeasured.or(unmeasured) != believed.unmeasured
        };
        let mut is_revised = false;
        for believed in self.samples.iter_mut().rev().take_while(is_new) {
            believed.distrust(unmeasured);
            is_revised = true;
        }
        if is_revised {
            self.revised_since = Some(self.revised_since.map_or(since, |earlier| earlier.min(since)));
        }
    }

    /// The sensors that repeat their readings at the newest sample.
    pub fn stuck(&self) -> Unmeasured {
        self.stuck
    }

    /// True if the samples kept begin before `stamp`.
    pub fn reaches_back_to(&self, stamp: Timestamp) -> bool {
        self.samples.front().is_some_and(|first| first.sample.stamp <= stamp)
    }

    /// Believes neither sensor after `since` and in all samples to come, until [`Self::trust`].
    pub fn distrust(&mut self, since: Timestamp) {
        let is_marked = self.distrusted.is_any() && self.accused_since.is_none();
        let mut newest = self.samples.iter().rev().take_while(|believed| believed.sample.stamp > since);
        let is_sound = !is_marked && newest.all(|b| self.distrusted.is_any() || !b.unmeasured.is_any());
        self.accused_since = is_sound.then(|| self.accused_since.map_or(since, |earlier| earlier.min(since)));
        self.distrusted = Unmeasured::BOTH;
        self.revise(Some(since), Unmeasured::BOTH);
    }

    /// The samples that are distrusted are wrong: they are not believed again.
    pub fn convict(&mut self) {
        self.accused_since = None;
    }

    /// Believes the samples to come.
    pub fn trust(&mut self) {
        self.distrusted = Unmeasured::default();
        self.accused_since = None;
    }

    /// Believes the samples to come, and those that have been distrusted; but not those of [`Self::convict`].
    pub fn acquit(&mut self) {
        if let Some(since) = self.accused_since {
            let newest = self.samples.iter_mut().rev().take_while(|believed| believed.sample.stamp > since);
            newest.for_each(|believed| believed.unmeasured = Unmeasured::default());
            self.revised_since = Some(self.revised_since.map_or(since, |earlier| earlier.min(since)));
        }
        self.trust();
    }

    /// The time after which samples have lost or regained belief since the last call, if any have.
    pub fn take_revision(&mut self) -> Option<Timestamp> {
        self.revised_since.take()
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.samples.clear();
        self.watch.clear();
        (self.stuck, self.revised_since) = (Unmeasured::default(), None);
        self.trust();
    }

    /// Mean angular rate, rad/s, and specific force, m/s², of the samples in `[from, to]`, both in the body frame,
    /// biases included; `None` without samples there.
    pub fn mean(&self, from: Timestamp, to: Timestamp) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let mut sum = (Vector3::zeros(), Vector3::zeros());
        let mut count = 0.0;
        for believed in self.within(from, to) {
            sum.0 += believed.gyro();
            sum.1 += believed.sample.accel;
            count += 1.0;
        }
        (count > 0.0).then(|| (sum.0 / count, sum.1 / count))
    }

    /// Mean of the angular rates that were measured in `[from, to]`, rad/s, bias included; `None` where none was.
    pub fn mean_rate(&self, from: Timestamp, to: Timestamp) -> Option<Vector3<f64>> {
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for believed in self.within(from, to).filter(|s| !s.unmeasured.gyro) {
            sum += believed.sample.gyro;
            count += 1.0;
        }
        (count > 0.0).then(|| sum / count)
    }

    /// Vibration in the samples up to `to`.
    pub fn vibration(&self, to: Timestamp) -> Vibration {
        let samples = self.within(to.plus_seconds(-vibration::SPAN_S), to);
        Vibration::of(samples.map(|believed| &believed.sample))
    }

    /// Samples in `[from, to]`, in order.
    pub fn within(&self, from: Timestamp, to: Timestamp) -> impl Iterator<Item = &BelievedSample> {
        let first = self.samples.partition_point(|s| s.sample.stamp < from);
        self.samples.range(first..).take_while(move |s| s.sample.stamp <= to)
    }

    /// Preintegrates `[from, to]` with the given biases. Samples at the ends are interpolated; where
    /// samples are missing the nearest ones stand in, with larger noise, and the coverage says so.
    pub fn preintegrate(
        &self,
        from: Timestamp,
        to: Timestamp,
        bias_gyro: &Vector3<f64>,
        bias_accel: &Vector3<f64>,
        noise: &ImuNoise,
    ) -> (Preintegration, Coverage) {
        let mut result = Preintegration::new(bias_gyro, bias_accel);
        let mut coverage = Coverage::default();
        let mut previous = self.at(from);
        let mut hole_s = self.hole_around(from);
        let first = self.samples.partition_point(|s| s.sample.stamp <= from);
        for sample in self.samples.range(first..).take_while(|s| s.sample.stamp < to) {
            self.step(&mut result, &mut coverage, &mut previous, (*sample, hole_s), noise);
            hole_s = 0.0;
        }
        if let Some(last) = self.at(to) {
            let hole_s = hole_s.at_least(self.hole_around(to));
            self.step(&mut result, &mut coverage, &mut previous, (last, hole_s), noise);
        }
        (result, coverage)
    }

    /// The last sample before `stamp`, and the first that is not.
    fn around(&self, stamp: Timestamp) -> (Option<&BelievedSample>, Option<&BelievedSample>) {
        let next = self.samples.partition_point(|s| s.sample.stamp < stamp);
        (next.checked_sub(1).and_then(|k| self.samples.get(k)), self.samples.get(next))
    }

    /// Interval between the two samples around `stamp`, s; 0 at a sample, and outside of them.
    fn hole_around(&self, stamp: Timestamp) -> f64 {
        match self.around(stamp) {
            (Some(before), Some(after)) if after.sample.stamp > stamp => {
                after.sample.stamp.seconds_since(before.sample.stamp)
            }
            _ => 0.0,
        }
    }

    /// Integrates from `previous` to `next`. An end that lies between two samples is worth as little as they are far apart:
    /// `hole_s`, s.
    fn step(
        &self,
        result: &mut Preintegration,
        coverage: &mut Coverage,
        previous: &mut Option<BelievedSample>,
        (next, hole_s): (BelievedSample, f64),
        noise: &ImuNoise,
    ) {
        if let Some(last) = *previous {
            let saturated = last.saturated.or(next.saturated);
            let unmeasured = last.unmeasured.or(next.unmeasured);
            let (from, to) = (&last.sample, &next.sample);
            let dt = to.stamp.seconds_since(from.stamp);
            let uncovered = self.distance_to_samples(from.stamp) + self.distance_to_samples(to.stamp);
            let apart = dt.at_least(uncovered).at_least(hole_s);
            coverage.has_gap |= self.limits.is_gap(apart);
            coverage.is_saturated |= saturated.is_any();
            coverage.unmeasured = coverage.unmeasured.or(unmeasured);
            if dt > 0.0 {
                let noise = self.limits.noise_of_step(noise, dt, apart, saturated);
                let noise = unmeasured.noise(noise);
                result.integrate(dt, &((last.gyro() + next.gyro()) * 0.5), &from.accel, &to.accel, &noise);
            }
        }
        *previous = Some(next);
    }

    /// Distance of a stamp from the buffered time, s; 0 within it.
    fn distance_to_samples(&self, stamp: Timestamp) -> f64 {
        match (self.samples.front(), self.samples.back()) {
            (Some(first), Some(last)) => {
                let before = first.sample.stamp.seconds_since(stamp);
                before.at_least(stamp.seconds_since(last.sample.stamp)).at_least(0.0)
            }
            _ => f64::INFINITY,
        }
    }

    /// The sample at `stamp`: interpolated inside, the nearest one outside.
    fn at(&self, stamp: Timestamp) -> Option<BelievedSample> {
        let (before, after) = match self.around(stamp) {
            (Some(a), Some(b)) => (a, b),
            (Some(s), None) | (None, Some(s)) => {
                return Some(BelievedSample { sample: ImuSample { stamp, ..s.sample }, ..*s });
            }
            (None, None) => return None,
        };
        let (a, b) = (&before.sample, &after.sample);
        let share = stamp.seconds_since(a.stamp) / b.stamp.seconds_since(a.stamp);
        Some(BelievedSample {
            sample: ImuSample {
                stamp,
                gyro: a.gyro.lerp(&b.gyro, share),
                accel: a.accel.lerp(&b.accel, share),
            },
            saturated: before.saturated.or(after.saturated),
            unmeasured: before.unmeasured.or(after.unmeasured),
        })
    }
}

#[cfg(test)]
#[path = "buffer_tests.rs"]
mod tests;
