//! Interface of a protocol: its frames, their content, and the host's requests to the device.

use super::framing::Scan;
use nalgebra::Vector3;
use plumbline_protocol::MAX_FRAME;

/// A protocol of a serial line.
pub trait Protocol: Send {
    /// Scans the beginning of `bytes`, of which there is at least one.
    fn scan(&self, bytes: &[u8]) -> Scan;

    /// Decodes a frame that [`Self::scan`] has found.
    fn decode(&mut self, frame: &[u8]) -> Content;

    /// Unit of the device's time.
    fn time_unit(&self) -> TimeUnit;

    /// Bits of the counter of samples, where there is one.
    fn counter_bits(&self) -> u32 {
        64
    }

    /// True if the device is expected to answer time requests.
    fn asks_time(&self) -> bool {
        false
    }

    /// Writes the request that is due at `now_ns` of the host, if any.
    fn request(&mut self, _now_ns: i64, _into: &mut Outgoing) {}

    /// The line was opened anew: another device may be there.
    fn restart(&mut self) {}
}

/// Unit and width of a device's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeUnit {
    /// Bits of its counter.
    pub bits: u32,
    /// One tick, ns.
    pub tick_ns: i64,
}

impl TimeUnit {
    /// Nanoseconds that never begin anew.
    pub const NANOS: Self = Self { bits: 64, tick_ns: 1 };
}

/// Content of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Content {
    /// A sample.
    Sample(DeviceSample),
    /// The answer to a question for the time.
    Answer(TimeAnswer),
    /// Nothing that concerns us.
    Other,
    /// A frame of the right kind that lacks what a sample needs, in words.
    Lacking(&'static str),
    /// A frame whose fields make no sense.
    Malformed,
}

/// A sample by its device's clock, in the sensor's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeviceSample {
    /// Time of measurement, in ticks of the device.
    pub ticks: u64,
    /// Number of the sample, where the device counts.
    pub counter: Option<u64>,
    /// Angular rate, rad/s.
    pub gyro: Vector3<f64>,
    /// Specific force, m/s².
    pub accel: Vector3<f64>,
    /// The device says that a range was exceeded.
    pub is_saturated: bool,
    /// The device says that its sensor failed.
    pub is_failed: bool,
}

/// The answer to a question for the time: the host's time of the question, and when the device received it and answered by
/// its own clock, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeAnswer {
    /// Departure of the question.
    pub asked_ns: i64,
    /// Arrival of the question at the device.
    pub device_received_ns: i64,
    /// Departure of the answer from the device.
    pub device_sent_ns: i64,
}

/// Bytes on their way to the device.
#[derive(Clone, Debug)]
pub struct Outgoing {
    bytes: [u8; Self::CAPACITY],
    length: usize,
}

impl Default for Outgoing {
    fn default() -> Self {
        Self { bytes: [0; Self::CAPACITY], length: 0 }
    }
}

impl Outgoing {
    /// Room for a few messages.
    const CAPACITY: usize = 4 * MAX_FRAME;

    /// Adds a message, or nothing where it does not fit whole.
    pub fn push(&mut self, message: &[u8]) {
        if let Some(place) = self.bytes.get_mut(self.length..self.length + message.len()) {
            place.copy_from_slice(message);
            self.length += message.len();
        }
    }

    /// Bytes to be sent.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// Removes the first `count` bytes: the line has taken them.
    pub fn sent(&mut self, count: usize) {
        let count = count.min(self.length);
        self.bytes.copy_within(count..self.length, 0);
        self.length -= count;
    }

    /// Forgets what a line that is no more did not take.
    pub fn clear(&mut self) {
        self.length = 0;
    }
}

/// Questions for the time that are on their way.
#[derive(Clone, Debug, Default)]
pub(super) struct Questions {
    asked_ns: [Option<i64>; Self::AT_A_TIME],
    next: usize,
    due_ns: Option<i64>,
}

impl Questions {
    /// Answered late is not answered.
    const AT_A_TIME: usize = 8;
    /// From one question to the next, ns.
    const PERIOD_NS: i64 = 100_000_000;

    /// True if a question is due, which then counts as asked.
    pub(super) fn is_due(&mut self, now_ns: i64) -> bool {
        if self.due_ns.is_some_and(|due_ns| now_ns < due_ns) {
            return false;
        }
        self.due_ns = Some(now_ns.saturating_add(Self::PERIOD_NS));
        self.asked_ns[self.next % Self::AT_A_TIME] = Some(now_ns);
        self.next = self.next.wrapping_add(1);
        true
    }

    /// True if this question was asked and not yet answered.
    pub(super) fn take(&mut self, asked_ns: i64) -> bool {
        let found = self.asked_ns.iter_mut().find(|asked| **asked == Some(asked_ns));
        found.and_then(Option::take).is_some()
    }
}

/// A vector of three numbers, none where one is not finite.
pub(super) fn vector(values: [f64; 3]) -> Option<Vector3<f64>> {
    values.iter().all(|value| value.is_finite()).then(|| Vector3::from(values))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn questions_are_asked_ten_times_a_second_and_answered_once() {
        let mut questions = Questions::default();
        let asked: Vec<i64> =
            (0..2000).map(|ms| ms * 1_000_000).filter(|now| questions.is_due(*now)).collect();
        assert_eq!(asked.len(), 20);
        assert!(!questions.take(asked[0]), "a question of two seconds ago is forgotten");
        assert!(questions.take(asked[19]) && !questions.take(asked[19]));
        assert!(!questions.take(asked[18] + 1));
    }

    #[test]
    fn what_a_line_does_not_take_at_once_is_kept_and_a_message_is_whole_or_not_at_all() {
        let mut outgoing = Outgoing::default();
        outgoing.push(b"first");
        outgoing.push(&[1; Outgoing::CAPACITY]);
        outgoing.push(b"second");
        outgoing.sent(3);
        assert_eq!(outgoing.bytes(), b"stsecond");
        outgoing.sent(99);
        assert_eq!(outgoing.bytes(), b"");
    }
}
