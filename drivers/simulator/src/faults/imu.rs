//! Faults of inertial samples: a decorator around any source.

use super::InjectedFault;
use super::kinds::{Change, Effect, Sensor, Target};
use crate::random::Draws;
use nalgebra::Vector3;
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Portable, Timestamp};
use plumbline_drivers::{DriverError, Faults, ImuReading, ImuSource};
use std::collections::VecDeque;

/// Inertial source with faults.
#[derive(Debug)]
pub struct InjectedImu<S> {
    source: S,
    begin: Timestamp,
    slots: Vec<Slot>,
    missing: u64,
}

impl<S: ImuSource> InjectedImu<S> {
    /// Wraps `source` of a sensor of `config`, in a flight whose first frame is at `begin`.
    pub fn new(source: S, config: &ImuConfig, begin: Timestamp, faults: &[InjectedFault], seed: u64) -> Self {
        let slot =
            |(place, fault): (usize, &InjectedFault)| Slot::new(*fault, fault.seed(seed, place), config);
        Self { source, begin, slots: faults.iter().enumerate().map(slot).collect(), missing: 0 }
    }
}

impl<S: ImuSource> ImuSource for InjectedImu<S> {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        while let Some(mut reading) = self.source.next_reading()? {
            let time_s = reading.sample.stamp.seconds_since(self.begin);
            let mut is_lost = false;
            for slot in &mut self.slots {
                is_lost |= slot.strike(&mut reading, time_s);
            }
            if !is_lost {
                return Ok(Some(reading));
            }
            self.missing += 1;
        }
        Ok(None)
    }

    fn faults(&self) -> Faults {
        let theirs = self.source.faults();
        Faults { missing: theirs.missing + self.missing, ..theirs }
    }
}

/// One fault, with what it remembers.
#[derive(Debug)]
struct Slot {
    fault: InjectedFault,
    seed: u64,
    /// Standard deviation of the noise of a reading: gyroscope, rad/s, and accelerometer, m/s².
    noise: [f64; 2],
    /// Last readings before the fault.
    held: Option<[Vector3<f64>; 2]>,
    /// Samples that are still to be delivered late.
    past: VecDeque<ImuSample>,
}

impl Slot {
    fn new(fault: InjectedFault, seed: u64, config: &ImuConfig) -> Self {
        let noise = [config.gyro_noise_density, config.accel_noise_density]
            .map(|density| density * config.rate_hz.sqrt());
        let delay_s = match fault.kind.effect {
            Effect::Reading(_, Change::Late) => 1e-3 * fault.doses[0],
            _ => 0.0,
        };
        let past = VecDeque::with_capacity((delay_s * config.rate_hz).ceil() as usize + 4);
        Self { fault, seed, noise, held: None, past }
    }

    /// Changes the reading at `time_s`; returns whether it is lost.
    fn strike(&mut self, reading: &mut ImuReading, time_s: f64) -> bool {
        let acts = self.fault.acts_at(time_s);
        let dose = self.fault.doses[0];
        match self.fault.kind.effect {
            Effect::ImuGap => return acts,
            Effect::ImuStamps if acts => {
                reading.sample.stamp = reading.sample.stamp.plus_seconds(1e-3 * dose)
            }
            Effect::Clocks if acts => reading.sample.stamp = reading.sample.stamp.plus_seconds(-dose),
            Effect::Reading(sensor, change) => self.change(sensor, change, reading, acts),
            _ => {}
        }
        false
    }

    fn change(&mut self, sensor: Sensor, change: Change, reading: &mut ImuReading, acts: bool) {
        let sample = &mut reading.sample;
        let before = [sample.gyro, sample.accel];
        if !acts || self.held.is_none() {
            self.held = Some(before);
        }
        let late = matches!(change, Change::Late).then(|| self.delayed(sample));
        if !acts {
            return;
        }
        let held = self.held.unwrap_or(before);
        let parts = [(Sensor::Gyro, &mut sample.gyro), (Sensor::Accel, &mut sample.accel)];
        for (part, (name, value)) in parts.into_iter().enumerate() {
            if sensor != name && sensor != Sensor::Both {
                continue;
            }
            let mut draws = Draws::new(self.seed, self.fault.purpose(), 2 * reading.sequence + part as u64);
            match late {
                Some(late) => self.take(value, &late[part]),
                None => self.alter(change, value, &held[part], self.noise[part], &mut draws),
            }
        }
    }

    /// True if the fault affects axis `k`.
    fn is_about(&self, k: usize) -> bool {
        matches!(self.fault.target, Target::Axes(axes) if axes[k])
    }

    /// Takes the axes that the fault is about from `other`.
    fn take(&self, value: &mut Vector3<f64>, other: &Vector3<f64>) {
        (0..3).filter(|k| self.is_about(*k)).for_each(|k| value[k] = other[k]);
    }

    fn alter(
        &self,
        change: Change,
        value: &mut Vector3<f64>,
        held: &Vector3<f64>,
        sigma: f64,
        draws: &mut Draws,
    ) {
        let [dose, size] = self.fault.doses;
        if let Change::Exchange = change {
            let mut axes = (0..3).filter(|k| self.is_about(*k));
            if let (Some(a), Some(b)) = (axes.next(), axes.next()) {
                value.swap_rows(a, b);
            }
            return;
        }
        for k in (0..3).filter(|k| self.is_about(*k)) {
            value[k] = match change {
                Change::Add => value[k] + dose,
                Change::Clip => value[k].at_most(dose).at_least(-dose),
                Change::Dead => dose * sigma * draws.normal(),
                Change::Freeze => held[k] + dose * sigma * draws.normal(),
                Change::Negate => -value[k],
                Change::Scale => dose * value[k],
                Change::Spikes => {
                    let (is_hit, is_up) = (draws.unit() < dose, draws.unit() < 0.5);
                    let spike = if is_up { size } else { -size };
                    if is_hit { value[k] + spike } else { value[k] }
                }
                Change::Exchange | Change::Late => value[k],
            };
        }
    }

    /// Readings as they were the delay before `sample`, between samples by a straight line; the oldest if there is none as old.
    fn delayed(&mut self, sample: &ImuSample) -> [Vector3<f64>; 2] {
        let wanted = sample.stamp.plus_seconds(-1e-3 * self.fault.doses[0]);
        // A clock that was set back would leave samples here for ever.
        if self.past.len() == self.past.capacity() {
            self.past.pop_front();
        }
        self.past.push_back(*sample);
        while self.past.get(1).is_some_and(|next| next.stamp <= wanted) {
            self.past.pop_front();
        }
        let (Some(before), after) = (self.past.front(), self.past.get(1)) else {
            return [sample.gyro, sample.accel];
        };
        let Some(after) = after else { return [before.gyro, before.accel] };
        let step_s = after.stamp.seconds_since(before.stamp);
        let share = (wanted.seconds_since(before.stamp) / step_s.at_least(1e-9)).clamp(0.0, 1.0);
        [(before.gyro, after.gyro), (before.accel, after.accel)].map(|(a, b)| a + (b - a) * share)
    }
}
