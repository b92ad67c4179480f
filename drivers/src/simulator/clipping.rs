//! Vibration with which a sensor clips a given share of its samples.

use nalgebra::Vector3;

/// Moments of the flight that are looked at: a prime number of milliseconds apart, so that they meet every phase.
const STEP_S: f64 = 0.017;
/// Halvings of the interval in which the amplitude lies: to a millionth of the range.
const HALVINGS: usize = 20;

/// Amplitude of the vibration (m/s²) at which `share` of the samples of a flight of `span_s` seconds is beyond `range`, m/s²; 0 if
/// the flight alone clips more. `force_and_shake` gives the specific force at a time of the flight, m/s², and the vibration of
/// unit amplitude. The whole flight counts, so that a shorter part of it has the same samples.
pub(super) fn amplitude(
    share: f64,
    range: f64,
    span_s: f64,
    force_and_shake: impl Fn(f64) -> (Vector3<f64>, Vector3<f64>),
) -> f64 {
    let count = (span_s / STEP_S) as usize;
    let moments: Vec<_> = (0..count).map(|k| force_and_shake(k as f64 * STEP_S)).collect();
    let clipped = |amplitude: f64| {
        let beyond = moments.iter().filter(|(force, shake)| (force + shake * amplitude).amax() >= range);
        beyond.count() as f64 / count as f64
    };
    let (mut low, mut high) = (0.0, 2.0 * range);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if clipped(middle) < share { low = middle } else { high = middle }
    }
    low
}
