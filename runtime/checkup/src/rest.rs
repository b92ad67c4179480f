//! IMU at rest: gravity, its direction, and the bias of the gyroscope.

use crate::statistics::mean_and_spread;
use nalgebra::Vector3;
use plumbline_config::{ImuSample, Timestamp};

/// Length of a piece that is looked at for rest, s.
const PIECE_S: f64 = 0.5;
/// The vehicle rests while the gyroscope (rad/s) and the accelerometer (m/s²) scatter by less; a hand scatters by more.
const STILL: (f64, f64) = (0.02, 0.35);
/// Least time at rest in one attitude, s.
const MIN_STAND_S: f64 = 1.0;
/// Measurements at rest.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rest {
    /// Time at rest, s.
    pub seconds: f64,
    /// Mean of the gyroscope, rad/s.
    pub gyro: Vector3<f64>,
    /// Mean magnitude of the specific force, m/s², whichever way the vehicle stands.
    pub gravity_m_s2: f64,
    /// Mean of the accelerometer in the first attitude at rest, m/s²; its direction is the vertical.
    pub accel: Vector3<f64>,
    /// End of the time in the first attitude at rest.
    pub first_end: Option<Timestamp>,
}

/// The times in which the vehicle rests.
pub fn rest(samples: &[ImuSample]) -> Rest {
    let mut pieces = Vec::new();
    let mut from = 0;
    while let Some(first) = samples.get(from) {
        let end = first.stamp.plus_seconds(PIECE_S);
        let count = samples[from..].partition_point(|sample| sample.stamp < end).max(1);
        pieces.push((end, still(&samples[from..from + count])));
        from += count;
    }
    let (mut found, mut all) = (Rest::default(), Vec::new());
    // In one attitude, and for more than a moment.
    let is_same_attitude =
        |(a, b): (Means, Means)| (a.0 - b.0).norm() < STILL.0 && (a.1 - b.1).norm() < STILL.1;
    for stand in pieces.chunk_by(|(_, a), (_, b)| a.zip(*b).is_some_and(is_same_attitude)) {
        let means: Vec<Means> = stand.iter().filter_map(|(_, means)| *means).collect();
        let count = means.len() as f64;
        if count * PIECE_S < MIN_STAND_S {
            continue;
        }
        if found.first_end.is_none() {
            found.first_end = stand.last().map(|(end, _)| *end);
            found.accel = means.iter().map(|(_, accel)| accel).sum::<Vector3<f64>>() / count;
        }
        all.extend(means);
    }
    let count = all.len().max(1) as f64;
    found.seconds = all.len() as f64 * PIECE_S;
    found.gyro = all.iter().map(|(gyro, _)| gyro).sum::<Vector3<f64>>() / count;
    found.gravity_m_s2 = all.iter().map(|(_, accel)| accel.norm()).sum::<f64>() / count;
    found
}

/// Mean of the gyroscope and of the accelerometer.
type Means = (Vector3<f64>, Vector3<f64>);

/// Means of gyroscope and accelerometer in a piece of time in which both scatter little.
fn still(piece: &[ImuSample]) -> Option<Means> {
    let span_s = piece.last()?.stamp.seconds_since(piece.first()?.stamp);
    let (gyro, turning) = mean_and_spread(piece.iter().map(|sample| sample.gyro));
    let (accel, shaking) = mean_and_spread(piece.iter().map(|sample| sample.accel));
    (span_s >= 0.8 * PIECE_S && turning < STILL.0 && shaking < STILL.1).then_some((gyro, accel))
}
