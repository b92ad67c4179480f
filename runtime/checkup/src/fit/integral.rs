//! Inertial samples between two keyframes: rotation, velocity and position against free fall, by the trapezoidal rule.

use super::rig::{
    ACCEL, ALTERNATING, BIASES, CALIBRATION, CLOCK_RATE, DELAY, GYRO, Key, OF_KEY, OF_VIEWS, Rig,
};
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};
use plumbline_estimator::geometry::{exp_so3, log_so3};

/// Samples further apart than this are a gap, s.
const MAX_GAP_S: f64 = 0.05;
/// Steps of the numeric derivatives: states, matrices and biases, and times (s).
const STEPS: (f64, f64) = (1e-5, 1e-4);
/// Unknowns of the biases of a piece, and of two keyframes with them.
pub(super) const OF_BIASES: usize = 6;
pub(super) const OF_SAMPLES: usize = 2 * OF_KEY + OF_BIASES;

/// A sample by the clock of the inertial sensor, s from the middle of the recording.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reading {
    pub(crate) t_s: f64,
    pub(crate) gyro: Vector3<f64>,
    pub(crate) accel: Vector3<f64>,
}

/// Correction of the readings and of their clock.
#[derive(Clone, Copy)]
pub(super) struct Sensors {
    gyro: (Matrix3<f64>, Vector3<f64>),
    accel: (Matrix3<f64>, Vector3<f64>),
    /// Rate of the clock of the samples against that of the images, less 1.
    fast: f64,
}

/// Motion between two keyframes.
struct Delta {
    rot: UnitQuaternion<f64>,
    v: Vector3<f64>,
    p: Vector3<f64>,
    dt_s: f64,
}

/// Residuals of rotation, velocity and position between two keyframes, with their derivatives.
pub(super) struct Link {
    pub(super) residual: SVector<f64, 9>,
    /// By the states of the first and of the second keyframe, by the biases of the piece, and by the unknowns from [`OF_VIEWS`] on; in the
    /// last column the residuals.
    pub(super) by: SMatrix<f64, 9, { OF_SAMPLES + CALIBRATION - OF_VIEWS + 1 }>,
    pub(super) dt_s: f64,
}

/// Samples around a time, interpolated there; `None` in a gap.
pub(super) fn reading_at(readings: &[Reading], t_s: f64) -> Option<Reading> {
    let after = readings.partition_point(|reading| reading.t_s < t_s);
    let (a, b) = (readings.get(after.checked_sub(1)?)?, readings.get(after)?);
    let span_s = b.t_s - a.t_s;
    (span_s <= MAX_GAP_S && span_s > 0.0).then(|| {
        let share = (t_s - a.t_s) / span_s;
        Reading { t_s, gyro: a.gyro.lerp(&b.gyro, share), accel: a.accel.lerp(&b.accel, share) }
    })
}

impl Sensors {
    /// Correction by a calibration and the biases of a piece.
    pub(super) fn of(rig: &Rig, biases: &SVector<f64, 6>) -> Self {
        let add = |(matrix, bias): (Matrix3<f64>, Vector3<f64>), at: usize| {
            (matrix, bias + biases.fixed_rows::<3>(at))
        };
        let fast = rig.steps()[CLOCK_RATE];
        Self { gyro: add(rig.sensor(GYRO), 0), accel: add(rig.sensor(ACCEL), 3), fast }
    }

    /// Rate of the body, rad/s.
    pub(super) fn rate(&self, reading: &Reading) -> Vector3<f64> {
        self.gyro.0 * reading.gyro - self.gyro.1
    }

    /// Specific force, m/s².
    pub(super) fn force(&self, reading: &Reading) -> Vector3<f64> {
        self.accel.0 * reading.accel - self.accel.1
    }

    fn integrate(&self, readings: &[Reading], from_s: f64, to_s: f64) -> Option<Delta> {
        let inner = readings.partition_point(|r| r.t_s <= from_s)..readings.partition_point(|r| r.t_s < to_s);
        let (first, last) = (reading_at(readings, from_s)?, reading_at(readings, to_s)?);
        let mut delta = Delta {
            rot: UnitQuaternion::identity(),
            v: Vector3::zeros(),
            p: Vector3::zeros(),
            dt_s: (to_s - from_s) / (1.0 + self.fast),
        };
        let mut before = first;
        for now in readings.get(inner)?.iter().chain([&last]) {
            let dt_s = (now.t_s - before.t_s) / (1.0 + self.fast);
            if dt_s > MAX_GAP_S {
                return None;
            }
            let turn = exp_so3(&((self.rate(&before) + self.rate(now)) * (0.5 * dt_s)));
            let rot = delta.rot * turn;
            let force = (delta.rot * self.force(&before) + rot * self.force(now)) * 0.5;
            delta.p += delta.v * dt_s + force * (0.5 * dt_s * dt_s);
            delta.v += force * dt_s;
            delta.rot = rot;
            before = *now;
        }
        Some(delta)
    }
}

impl Delta {
    fn residual(&self, keys: [&Key; 2], gravity_w: &Vector3<f64>) -> SVector<f64, 9> {
        let [a, b] = keys;
        let (back, dt_s) = (a.pose_w_b.rotation.inverse(), self.dt_s);
        let moved = b.pose_w_b.translation.vector - a.pose_w_b.translation.vector - a.v_w * dt_s;
        let turned = log_so3(&(self.rot.inverse() * back * b.pose_w_b.rotation));
        let v = back * (b.v_w - a.v_w - gravity_w * dt_s) - self.v;
        let p = back * (moved - gravity_w * (0.5 * dt_s * dt_s)) - self.p;
        SVector::from_column_slice(Matrix3::from_columns(&[turned, v, p]).as_slice())
    }
}

impl Link {
    /// Link between two keyframes; `None` where samples are missing.
    pub(super) fn new(
        rig: &Rig,
        biases: &SVector<f64, OF_BIASES>,
        readings: &[Reading],
        keys: [&Key; 2],
    ) -> Option<Self> {
        let [from_s, to_s] = keys.map(|key| rig.imu_time_s(key));
        let sensors = Sensors::of(rig, biases);
        let delta = sensors.integrate(readings, from_s, to_s)?;
        let residual = delta.residual(keys, &rig.gravity_w);
        let slope = |other: Delta, step: f64| (other.residual(keys, &rig.gravity_w) - residual) / step;
        let mut by = SMatrix::<f64, 9, { OF_SAMPLES + CALIBRATION - OF_VIEWS + 1 }>::zeros();
        for k in 0..2 * OF_KEY {
            let (which, mut pair) = (k / OF_KEY, keys);
            let moved = keys[which].moved(&SVector::ith(k % OF_KEY, STEPS.0));
            pair[which] = &moved;
            by.set_column(k, &((delta.residual(pair, &rig.gravity_w) - residual) / STEPS.0));
        }
        let by_from = slope(sensors.integrate(readings, from_s + STEPS.1, to_s)?, STEPS.1);
        let by_to = slope(sensors.integrate(readings, from_s, to_s + STEPS.1)?, STEPS.1);
        let by_sensors = |k: usize| {
            let changed = Sensors::of(&rig.plus(&SVector::ith(k, STEPS.0)), biases);
            Some(slope(changed.integrate(readings, from_s, to_s)?, STEPS.0))
        };
        let [a, b] = keys;
        let place = |k: usize| OF_SAMPLES + k - OF_VIEWS;
        by.set_column(place(DELAY), &(by_from + by_to));
        by.set_column(place(CLOCK_RATE), &(by_from * a.t_s + by_to * b.t_s + by_sensors(CLOCK_RATE)?));
        by.set_column(place(ALTERNATING), &(by_from * a.parity + by_to * b.parity));
        for k in GYRO..BIASES + OF_BIASES {
            by.set_column(place(k), &by_sensors(k)?);
        }
        // Those of the recording are those of a piece too.
        let biases = by.fixed_columns::<OF_BIASES>(place(BIASES)).into_owned();
        by.fixed_columns_mut::<OF_BIASES>(2 * OF_KEY).copy_from(&biases);
        by.set_column(place(CALIBRATION), &residual);
        Some(Self { residual, by, dt_s: delta.dt_s })
    }
}
