//! Axes that moved: only such are known to be alive, or can be found to fail.

use super::piece::{FLOORS, limit_of_noise, scatter};
use plumbline_config::ImuSample;

/// Length of the pieces that are looked at, s, and those that an axis has to move in.
const PIECE_S: f64 = 2.0;
const MIN_PIECES: usize = 3;
/// Scatter of readings, rad/s and m/s², that is a motion: that of a dead axis could not be explained without a fault.
const MOVED: (f64, f64) = (0.03, 0.3);

/// The axes of gyroscope and accelerometer whose readings show a motion.
pub(crate) fn moved(samples: &[ImuSample]) -> [[bool; 3]; 2] {
    let mut pieces = [[0; 3]; 2];
    let mut rest = samples;
    while let Some(first) = rest.first() {
        let end = first.stamp.plus_seconds(PIECE_S);
        let (piece, after) = rest.split_at(rest.partition_point(|sample| sample.stamp < end).max(1));
        let found = [
            scatter(piece, |sample| sample.gyro / FLOORS.0).map(|found| (found, MOVED.0 / FLOORS.0)),
            scatter(piece, |sample| sample.accel / FLOORS.1).map(|found| (found, MOVED.1 / FLOORS.1)),
        ];
        for (pieces, found) in pieces.iter_mut().zip(found) {
            let Some(((scatter, white), least)) = found else { continue };
            for k in 0..3 {
                let is_motion = scatter[k] > limit_of_noise(white[k]).max(least * least);
                pieces[k] += usize::from(is_motion);
            }
        }
        rest = after;
    }
    pieces.map(|axes| axes.map(|pieces| pieces >= MIN_PIECES))
}
