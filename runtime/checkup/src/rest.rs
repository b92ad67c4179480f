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
    let mut found = Rest::default();
    // In one attitude, and for more than a moment.
    for stand in pieces.chunk_by(|(_, a), (_, b)| a.zip(*b).is_some_and(is_same_attitude)) {
        let means: Vec<_> = stand.iter().filter_map(|(_, means)| *means).collect();
        let seconds = means.len() as f64 * PIECE_S;
        if seconds < MIN_STAND_S {
            continue;
        }
        if found.first_end.is_none() {
            found.first_end = stand.last().map(|(end, _)| *end);
            found.accel = means.iter().map(|(_, accel)| accel).sum::<Vector3<f64>>() / means.len() as f64;
        }
        let weight = PIECE_S / (found.seconds + seconds);
        let (gyro, gravity) = means.iter().fold((Vector3::zeros(), 0.0), |(gyro, gravity), means| {
            (gyro + means.0, gravity + means.1.norm())
        });
        let before = found.seconds / (found.seconds + seconds);
        found.gyro = found.gyro * before + gyro * weight;
        found.gravity_m_s2 = found.gravity_m_s2 * before + gravity * weight;
        found.seconds += seconds;
    }
    found
}

/// Mean of the gyroscope and of the accelerometer.
type Means = (Vector3<f64>, Vector3<f64>);

fn is_same_attitude((a, b): (Means, Means)) -> bool {
    (a.0 - b.0).norm() < STILL.0 && (a.1 - b.1).norm() < STILL.1
}

/// Means of gyroscope and accelerometer in a piece of time in which both scatter little.
fn still(piece: &[ImuSample]) -> Option<Means> {
    let span_s = piece.last()?.stamp.seconds_since(piece.first()?.stamp);
    let (gyro, turning) = mean_and_spread(piece.iter().map(|sample| sample.gyro));
    let (accel, shaking) = mean_and_spread(piece.iter().map(|sample| sample.accel));
    (span_s >= 0.8 * PIECE_S && turning < STILL.0 && shaking < STILL.1).then_some((gyro, accel))
}
