//! Readings that jump from one sample to the next.
//!
//! A sensor that fails, or is struck, in the middle of a frame has hardly changed the mean of that frame ([`super::sudden_force`] sees the next
//! one), and no image contradicts it yet; but what it did to the newest state counts. Vehicles move more smoothly than that, and what
//! vibrates does so all the time: a reading that differs from the one before by a multiple of what is usual makes attitude or velocity uncertain by a
//! share of what it has added since.

use super::sudden_force::{MEMORY_S, MOST_S, SIGMA_SHARE};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use plumbline_config::{ImuSample, Portable, Timestamp};

/// A difference of two readings is a jump from this multiple of the usual one, and from these on, rad/s and m/s².
const JUMP_SHARE: f64 = 6.0;
const LEAST_JUMPS: [f64; 2] = [0.2, 1.0];
/// No sensor measures more, rad/s or m/s².
const MOST_JUMP: f64 = 1e3;
/// Jumps that are remembered.
const JUMPS: usize = 8;
/// Images have contradicted a jump after this time, s, within which the first one counts.
const HELD_S: f64 = 0.15;

/// A change of a reading.
#[derive(Clone, Copy, Debug)]
struct Jump {
    /// The samples before and after it.
    since: Timestamp,
    until: Timestamp,
    /// rad/s or m/s² in `B`.
    size_b: Vector3<f64>,
}

/// Readings of a sensor.
#[derive(Clone, Copy, Debug, Default)]
struct Readings {
    last: Option<(Timestamp, Vector3<f64>)>,
    /// Mean square of the differences of two readings.
    mean_square: f64,
    /// The last jumps, newest first: samples may come before the frames that they lead to.
    jumps: [Option<Jump>; JUMPS],
}

impl Readings {
    /// Takes a reading; differences smaller than `least` are none.
    fn add(&mut self, stamp: Timestamp, reading_b: Vector3<f64>, least: f64) {
        let Some((since, before_b)) = self.last.replace((stamp, reading_b)) else { return };
        let size_b = (reading_b - before_b).map(|x| x.clamp(-MOST_JUMP, MOST_JUMP));
        let dt_s = stamp.seconds_since(since);
        if !size_b.iter().all(|x| x.is_finite()) || !(0.0..MOST_S).contains(&dt_s) {
            return self.last = None;
        }
        let most = JUMP_SHARE.squared() * self.mean_square.at_least((least / JUMP_SHARE).squared());
        let squared = size_b.norm_squared();
        let is_held = self.jumps[0].is_some_and(|jump| stamp.seconds_since(jump.since) < HELD_S);
        if squared > most && !is_held {
            self.jumps.rotate_right(1);
            self.jumps[0] = Some(Jump { since, until: stamp, size_b });
        }
        self.mean_square += (squared.at_most(most) - self.mean_square) * (dt_s / MEMORY_S);
    }

    /// What the last jump until `stamp` may have added to then, one standard deviation, rad or m/s in `B`. Samples after it change nothing.
    fn added_b(&self, stamp: Timestamp) -> Option<Vector3<f64>> {
        let Jump { since, size_b, .. } = self.jumps.iter().flatten().find(|jump| jump.until <= stamp)?;
        let acted_s = stamp.seconds_since(*since);
        (0.0..HELD_S).contains(&acted_s).then(|| *size_b * (SIGMA_SHARE * acted_s.at_most(MOST_S)))
    }
}

/// Watches the readings of gyroscope and accelerometer for jumps.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SuddenSample {
    gyro: Readings,
    accel: Readings,
}

impl SuddenSample {
    pub(super) fn add(&mut self, sample: &ImuSample) {
        self.gyro.add(sample.stamp, sample.gyro, LEAST_JUMPS[0]);
        self.accel.add(sample.stamp, sample.accel, LEAST_JUMPS[1]);
    }

    /// Covariance of an attitude at `stamp` by a jump of the gyroscope, rad² in `B`.
    pub(super) fn of_attitude(&self, stamp: Timestamp) -> Option<Matrix3<f64>> {
        self.gyro.added_b(stamp).map(|added| added * added.transpose())
    }

    /// Covariance of a velocity at `stamp` by a jump of the accelerometer, m²/s² in `O`.
    pub(super) fn of_velocity(
        &self,
        stamp: Timestamp,
        rot_o_b: &UnitQuaternion<f64>,
    ) -> Option<Matrix3<f64>> {
        self.accel.added_b(stamp).map(|added| rot_o_b * added).map(|added| added * added.transpose())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Standard deviations of attitude, rad, and velocity, m/s, by jumps, `after_s` seconds after 2 s of samples of 200 Hz; from the last
    /// centisecond on they read `more`.
    fn sigmas(more: [Vector3<f64>; 2], after_s: f64) -> [f64; 2] {
        let mut watch = SuddenSample::default();
        let at = |k: i32| Timestamp::default().plus_seconds(0.005 * f64::from(k));
        for k in 0..=400 {
            let t = 0.005 * f64::from(k);
            let shaken = Vector3::new(libm::sin(900.0 * t), libm::cos(500.0 * t), libm::sin(700.0 * t));
            let [gyro, accel] = if k >= 399 { more } else { Default::default() };
            let sample = ImuSample { stamp: at(k), gyro: shaken * 0.05 + gyro, accel: shaken * 0.3 + accel };
            watch.add(&sample);
        }
        let stamp = at(400).plus_seconds(after_s);
        let of_attitude = watch.of_attitude(stamp);
        [of_attitude, watch.of_velocity(stamp, &UnitQuaternion::identity())]
            .map(|covariance| covariance.map_or(0.0, |covariance| covariance.trace().sqrt()))
    }

    #[test]
    fn shaking_leaves_the_state_certain() {
        assert_eq!(sigmas([Vector3::zeros(); 2], 0.0), [0.0; 2]);
    }

    #[test]
    fn a_jump_makes_what_it_adds_uncertain_at_once_and_for_a_while() {
        let [attitude, velocity] = sigmas([Vector3::x() * 4.0, Vector3::y() * 10.0], 0.0);
        assert!((attitude - 0.3 * 4.0 * 0.01).abs() < 1e-3 && (velocity - 0.3 * 10.0 * 0.01).abs() < 6e-3);
        assert_eq!(sigmas([Vector3::x() * 4.0, Vector3::y() * 10.0], 0.2), [0.0; 2]);
    }

    #[test]
    fn samples_that_come_before_their_frame_change_nothing() {
        let at = |k: i32| Timestamp::default().plus_seconds(0.005 * f64::from(k));
        let known_at = |last: i32| {
            let mut readings = Readings::default();
            // Jumps after 0.1, 0.3 and 0.5 s.
            (0..=last).for_each(|k| readings.add(at(k), Vector3::x() * f64::from(5 * ((k + 20) / 40)), 1.0));
            [20, 25, 30].map(|frame| readings.added_b(at(frame)))
        };
        assert_eq!(known_at(30), known_at(120));
        assert!(known_at(30).iter().all(Option::is_some));
    }

    #[test]
    fn each_sensor_spoils_its_own_part_of_the_state() {
        let [attitude, velocity] = sigmas([Vector3::zeros(), Vector3::y() * 10.0], 0.0);
        assert!(attitude == 0.0 && velocity > 0.02);
        let [attitude, velocity] = sigmas([Vector3::x() * 4.0, Vector3::zeros()], 0.0);
        assert!(attitude > 0.01 && velocity == 0.0);
    }
}
