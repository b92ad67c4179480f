//! The integral of the gyroscope's readings, against which turns that images tell are held.

use super::super::stamp::noise::MOST_S;
use crate::inertial::belief::GAP_PERIODS;
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Timestamp};
use std::collections::VecDeque;

/// Turns that are kept: those of 1.6 s at 20 Hz.
pub(super) const MAX_TURNS: usize = 32;
/// Samples of the gyroscope are kept this long, s: the turns, and as much before them as images may be late.
const MEMORY_S: f64 = 2.5;
/// The newest reading holds for so long after its sample, ns: as far as a stamp is off.
const HOLDS_NS: i64 = (MOST_S * 1e9) as i64;

/// A turn as the images of two frames tell it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    /// Frames between which it lies.
    pub(super) from: Timestamp,
    pub(super) to: Timestamp,
    /// Rotation vector from the earlier to the later body, rad.
    pub(super) seen: Vector3<f64>,
    /// Attitude of the later body by known landmarks.
    pub(super) rot_o_b: Option<UnitQuaternion<f64>>,
    /// Variance of the turn, rad².
    pub(super) variance: f64,
}

impl Turn {
    /// Time it takes, s.
    pub(super) fn dt_s(&self) -> f64 {
        self.to.seconds_since(self.from)
    }

    /// Speed at which the images turn, rad/s.
    pub(super) fn rate_rad_s(&self) -> f64 {
        self.seen.norm() / self.dt_s()
    }
}

/// The integral of the gyroscope's readings up to a sample.
#[derive(Clone, Copy, Debug)]
struct Angle {
    stamp: Timestamp,
    rad: Vector3<f64>,
    /// Holes in the stream so far.
    holes: u32,
}

/// The time between two samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gap {
    /// Latest stamp before it.
    pub(super) since: Timestamp,
    /// Its length; negative where the clock was set back.
    pub(super) length_ns: i64,
}

/// Angles of the last [`MEMORY_S`].
#[derive(Clone, Debug)]
pub(super) struct GyroAngles {
    max_gap_ns: i64,
    capacity: usize,
    angles: VecDeque<Angle>,
    last: Option<ImuSample>,
    /// Latest stamp of a sample.
    latest: Option<Timestamp>,
}

impl GyroAngles {
    pub(super) fn new(imu: &ImuConfig) -> Self {
        let capacity = (MEMORY_S * imu.rate_hz).ceil() as usize + 2;
        Self {
            max_gap_ns: (GAP_PERIODS * 1e9 / imu.rate_hz) as i64,
            capacity,
            angles: VecDeque::with_capacity(capacity),
            last: None,
            latest: None,
        }
    }

    /// Forgets all samples.
    pub(super) fn clear(&mut self) {
        self.angles.clear();
        (self.last, self.latest) = (None, None);
    }

    /// Takes a sample, as it was read; returns the time since the one before.
    pub(super) fn add(&mut self, sample: &ImuSample) -> Option<Gap> {
        let newest = self.angles.back().copied();
        let mut angle = newest.unwrap_or(Angle { stamp: sample.stamp, rad: Vector3::zeros(), holes: 0 });
        let mut gap = None;
        if let Some(last) = &self.last {
            let length_ns = sample.stamp.nanos_since(last.stamp);
            if length_ns <= 0 || length_ns > self.max_gap_ns {
                angle.holes += 1;
            } else {
                angle.rad += (last.gyro + sample.gyro) * (0.5e-9 * length_ns as f64);
            }
            // A clock that was set back for a while has not taken the samples before that with it.
            let since = self.latest.filter(|latest| *latest < sample.stamp).unwrap_or(last.stamp);
            gap = Some(Gap { since, length_ns });
            if length_ns <= 0 {
                self.angles.clear();
            }
        }
        self.latest = self.latest.max(Some(sample.stamp));
        angle.stamp = sample.stamp;
        if self.angles.len() == self.capacity {
            self.angles.pop_front();
        }
        self.angles.push_back(angle);
        self.last = Some(*sample);
        gap
    }

    /// The angle at `stamp`; `None` where there are no samples.
    fn angle_at(&self, stamp: Timestamp) -> Option<(Vector3<f64>, u32)> {
        let next = self.angles.partition_point(|a| a.stamp < stamp);
        let after = self.angles.get(next)?;
        if after.stamp == stamp {
            return Some((after.rad, after.holes));
        }
        let before = self.angles.get(next.checked_sub(1)?)?;
        let share = stamp.seconds_since(before.stamp) / after.stamp.seconds_since(before.stamp);
        (before.holes == after.holes).then(|| (before.rad.lerp(&after.rad, share), after.holes))
    }

    /// The angle at `stamp`, which may lie shortly after the newest sample if its reading `holds`.
    fn angle_until(&self, stamp: Timestamp, holds: bool) -> Option<(Vector3<f64>, u32)> {
        self.angle_at(stamp).or_else(|| {
            let (newest, last) = (self.angles.back()?, self.last.as_ref()?);
            let beyond_ns = stamp.nanos_since(newest.stamp);
            let is_near = holds && (0..=HOLDS_NS).contains(&beyond_ns);
            is_near.then(|| (newest.rad + last.gyro * (beyond_ns as f64 * 1e-9), newest.holes))
        })
    }

    /// Difference between a turn as the gyroscope measured it `lag_ns` later, and `turn`; `None` without samples throughout.
    pub(super) fn difference(
        &self,
        turn: &Turn,
        lag_ns: i64,
        bias_gyro: &Vector3<f64>,
    ) -> Option<Vector3<f64>> {
        let (from, holes) = self.angle_at(turn.from.plus_nanos(lag_ns))?;
        let (to, holes_after) = self.angle_until(turn.to.plus_nanos(lag_ns), lag_ns == 0)?;
        let measured = to - from - bias_gyro * turn.dt_s();
        (holes == holes_after).then(|| turn.seen - measured)
    }
}
