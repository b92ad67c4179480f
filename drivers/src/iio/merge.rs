//! Brings the samples of an accelerometer to the times of a gyroscope.

use nalgebra::Vector3;
use std::collections::VecDeque;

/// Samples of each that wait for the other: more than either brings in a quarter of a second at 1 kHz.
const WAITING: usize = 256;
/// Between samples of the accelerometer further apart than this nothing is interpolated, ns.
const LONGEST_NS: i64 = 50_000_000;

/// A vector and its time, ns.
pub type StampedVector = (i64, Vector3<f64>);

/// Both streams on their way together. Allocates at its construction alone.
#[derive(Debug)]
pub struct Merge {
    gyro: VecDeque<StampedVector>,
    accel: VecDeque<StampedVector>,
    /// Samples of the gyroscope without an accelerometer around them.
    alone: u64,
}

impl Default for Merge {
    fn default() -> Self {
        let waiting = || VecDeque::with_capacity(WAITING);
        Self { gyro: waiting(), accel: waiting(), alone: 0 }
    }
}

impl Merge {
    /// Takes a sample of the gyroscope; stamps rise.
    pub fn gyro(&mut self, sample: StampedVector) {
        if self.gyro.len() == WAITING {
            self.gyro.pop_front();
            self.alone += 1;
        }
        self.gyro.push_back(sample);
    }

    /// Takes a sample of the accelerometer; stamps rise.
    pub fn accel(&mut self, sample: StampedVector) {
        if self.accel.len() == WAITING {
            self.accel.pop_front();
        }
        self.accel.push_back(sample);
    }

    /// Forgets what waits.
    pub fn clear(&mut self) {
        self.gyro.clear();
        self.accel.clear();
    }

    /// The next sample of the gyroscope, and the accelerometer at its time.
    pub fn next(&mut self) -> Option<(StampedVector, Vector3<f64>)> {
        loop {
            let gyro = *self.gyro.front()?;
            while self.accel.len() > 1 && self.accel[1].0 <= gyro.0 {
                self.accel.pop_front();
            }
            let before = *self.accel.front()?;
            if before.0 == gyro.0 {
                self.gyro.pop_front();
                return Some((gyro, before.1));
            }
            let after = match before.0 < gyro.0 {
                true => Some(*self.accel.get(1)?),
                false => None,
            };
            self.gyro.pop_front();
            match after.filter(|after| after.0 - before.0 <= LONGEST_NS) {
                Some(after) => return Some((gyro, between(before, after, gyro.0))),
                None => self.alone += 1,
            }
        }
    }

    /// Samples of the gyroscope that were given up.
    pub fn alone(&self) -> u64 {
        self.alone
    }
}

fn between(before: StampedVector, after: StampedVector, at_ns: i64) -> Vector3<f64> {
    let share = (at_ns - before.0) as f64 / (after.0 - before.0) as f64;
    before.1.lerp(&after.1, share)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn of(x: f64) -> Vector3<f64> {
        Vector3::new(x, 0.0, 1.0)
    }

    fn all(merge: &mut Merge) -> Vec<(i64, f64)> {
        std::iter::from_fn(|| merge.next()).map(|(gyro, accel)| (gyro.0 / MS, accel.x)).collect()
    }

    #[test]
    fn before_the_first_and_within_a_long_gap_there_is_no_accelerometer() {
        let mut merge = Merge::default();
        [1, 2, 3, 20, 70].into_iter().for_each(|ms| merge.gyro((ms * MS, of(0.0))));
        [2, 4, 69, 71].into_iter().for_each(|ms| merge.accel((ms * MS, of(ms as f64))));
        assert_eq!(all(&mut merge), [(2, 2.0), (3, 3.0), (70, 70.0)]);
        assert_eq!(merge.alone(), 2);
    }

    #[test]
    fn an_accelerometer_that_fell_silent_fills_no_memory() {
        let mut merge = Merge::default();
        merge.accel((0, of(0.0)));
        (1..1000).for_each(|ms| merge.gyro((ms * MS, of(0.0))));
        assert_eq!((merge.gyro.len(), merge.alone()), (WAITING, 999 - WAITING as u64));
        assert_eq!(merge.gyro.capacity(), Merge::default().gyro.capacity());
    }
}
