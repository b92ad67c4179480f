//! How hard a sensor must vibrate to clip a given share of its samples.

use super::imu::ImuModel;
use super::trajectory::Trajectory;

/// Moments of the flight that are looked at: a prime number of milliseconds apart, so that they meet every phase.
const STEP_S: f64 = 0.017;
/// Halvings of the interval in which the amplitude lies: to a millionth of the range.
const HALVINGS: usize = 20;

/// Amplitude of the vibration (m/s²) at which the share of clipped samples along `flight` is that which `sensor` asks for; 0 if
/// the flight alone clips more. The whole flight counts, so that a shorter part of it has the same samples.
pub(super) fn amplitude(sensor: &ImuModel, flight: &Trajectory) -> f64 {
    let (share, range) = sensor.clipped();
    let span_s = flight.end().seconds_since(flight.begin());
    let count = (span_s / STEP_S) as usize;
    let moments: Vec<_> = (0..count)
        .map(|k| {
            let t = k as f64 * STEP_S;
            (sensor.force(&flight.motion_at(t)), sensor.vibration(t, 1))
        })
        .collect();
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
