//! Quantities that the inertial messages of a topic hold.

use super::messages::ImuMessage;
use nalgebra::Vector3;

/// Quantities in the messages of a topic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Holds {
    /// Rates of rotation and accelerations in each message, as far as can be told.
    #[default]
    Both,
    /// Rates of rotation alone.
    Gyro,
    /// Accelerations alone.
    Accel,
    /// Messages of either kind.
    Mixed,
}

impl Holds {
    /// Content of a topic with these messages.
    pub(crate) fn of(messages: &[ImuMessage]) -> Self {
        let all = messages.len();
        let count = |wanted: [bool; 2]| messages.iter().filter(|message| has(message) == wanted).count();
        let (both, gyro, accel) = (count([true, true]), count([true, false]), count([false, true]));
        match (gyro, accel) {
            _ if 5 * gyro >= all && 5 * accel >= all && 10 * both <= all && all > 0 => Self::Mixed,
            (1.., 0) if 20 * both <= all => Self::Gyro,
            (0, 1..) if 20 * both <= all => Self::Accel,
            _ => Self::Both,
        }
    }
}

/// Quantities in a message: rates of rotation, accelerations. A quantity is absent if it is zero in all axes,
/// not a number, or denied by its covariance. A driver that writes -1 into all covariances denies nothing.
fn has(message: &ImuMessage) -> [bool; 2] {
    let is_there =
        |vector: &Vector3<f64>| vector.iter().any(|x| *x != 0.0) && !vector.iter().all(|x| x.is_nan());
    let [gyro, accel] = message.is_denied;
    [is_there(&message.sample.gyro) && (!gyro || accel), is_there(&message.sample.accel) && (!accel || gyro)]
}

/// True for a gyroscope's message on a topic that carries both kinds; at rest its rates may be zero.
pub(super) fn is_gyro(message: &ImuMessage) -> bool {
    matches!((has(message), message.is_denied), ([true, _], _) | (_, [false, true]))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use plumbline_config::{ImuSample, Timestamp};

    pub(crate) const MS: i64 = 1_000_000;

    pub(crate) fn message(at_ms: f64, gyro: f64, accel: f64, is_denied: [bool; 2]) -> ImuMessage {
        let of = |x: f64| if x == 0.0 || x.is_nan() { Vector3::repeat(x) } else { Vector3::new(x, 0.0, 9.0) };
        let stamp = Timestamp::from_nanos((at_ms * MS as f64) as i64);
        ImuMessage { sample: ImuSample { stamp, gyro: of(gyro), accel: of(accel) }, is_denied }
    }

    #[test]
    fn what_a_topic_holds_is_told_by_its_values_and_covariances() {
        let of = |messages: &[ImuMessage]| Holds::of(messages);
        let gyro = message(1.0, 2.0, 0.0, [false, true]);
        let accel = message(2.0, 0.0, 3.0, [true, false]);
        let both = message(3.0, 2.0, 3.0, [false, false]);
        assert_eq!(
            (of(&[gyro; 9]), of(&[accel; 9]), of(&[both; 9])),
            (Holds::Gyro, Holds::Accel, Holds::Both)
        );
        // No covariance says so, or the other quantity is no number.
        assert_eq!(of(&[message(1.0, 2.0, 0.0, [false; 2])]), Holds::Gyro);
        assert_eq!(of(&[message(1.0, f64::NAN, 3.0, [false; 2])]), Holds::Accel);
        // Values that are there are believed, although a driver denies everything.
        assert_eq!(of(&[message(1.0, 2.0, 3.0, [true; 2])]), Holds::Both);
        assert_eq!(of(&[message(1.0, 2.0, 3.0, [false, true])]), Holds::Gyro);
        assert_eq!(of(&[gyro, accel, gyro, gyro, accel]), Holds::Mixed);
        // A simulator at rest, whose gyroscope is exactly zero now and then.
        assert_eq!(of(&[both, both, message(4.0, 0.0, 3.0, [false; 2])]), Holds::Both);
        assert_eq!(of(&[]), Holds::Both);
    }
}
