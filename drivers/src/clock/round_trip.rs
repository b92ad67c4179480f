//! Questions for a device's time, and their answers.
//!
//! A question left the host before the device saw it, and its answer reached the host after the device gave it. So the
//! device's clock lies between two lines: above that of the questions, below that of the answers. The promptest of each
//! way decide, on their own ([`LowerEnvelope`]); the middle is wrong by at most half the difference of both ways.

use super::envelope::{LowerEnvelope, SPAN_NS};

/// A question and its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RoundTrip {
    /// Departure of the question, by the host's clock, ns.
    pub sent_ns: i64,
    /// Arrival of the question at the device, by its own clock, ns.
    pub device_received_ns: i64,
    /// Departure of the answer from the device, by its own clock, ns; the same as above where the device gives one time only.
    pub device_sent_ns: i64,
    /// Arrival of the answer, by the host's clock, ns.
    pub received_ns: i64,
}

/// Round trips that are needed.
const ENOUGH: u64 = 8;
/// Time that they span at least, ns.
const ENOUGH_NS: i64 = 700_000_000;
/// A longer round trip says nothing, ns.
const LONGEST_NS: i64 = 500_000_000;

/// Both lines, in coordinates of device time (x) and host less device (y).
#[derive(Clone, Debug, Default)]
pub struct RoundTrips {
    answers: LowerEnvelope,
    /// Mirrored at the x axis: what limits from below is an upper hull.
    questions: LowerEnvelope,
    latest_x: Option<i64>,
    quickest_ns: Option<i64>,
}

impl RoundTrips {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.answers.clear();
        self.questions.clear();
        (self.latest_x, self.quickest_ns) = (None, None);
    }

    /// Takes a round trip whose device times are relative to `origin` as `(device, host)`, ns. Whether it was sensible.
    pub fn push(&mut self, trip: &RoundTrip, origin: (i64, i64)) -> bool {
        let way_ns = trip.received_ns.saturating_sub(trip.sent_ns);
        let there_ns = trip.device_sent_ns.saturating_sub(trip.device_received_ns);
        if !(0..=LONGEST_NS).contains(&way_ns) || !(0..=LONGEST_NS).contains(&there_ns) {
            return false;
        }
        let point = |device_ns: i64, host_ns: i64| {
            let x = device_ns.saturating_sub(origin.0);
            (x, host_ns.saturating_sub(origin.1).saturating_sub(x))
        };
        let (x, y) = point(trip.device_sent_ns, trip.received_ns);
        if self.latest_x.is_some_and(|latest| x <= latest) {
            return false;
        }
        self.answers.push(x, y);
        let (asked_x, asked_y) = point(trip.device_received_ns, trip.sent_ns);
        self.questions.push(asked_x, asked_y.saturating_neg());
        self.latest_x = Some(x);
        self.quickest_ns = Some(self.quickest_ns.map_or(way_ns, |quickest| quickest.min(way_ns)));
        true
    }

    /// Host less device at `x`, ns, and its slope, when enough recent round trips are there.
    pub fn offset(&self, x: i64) -> Option<(i64, f64)> {
        let is_recent = self.latest_x.is_some_and(|latest| x.saturating_sub(latest) <= SPAN_NS);
        if !is_recent || self.answers.points() < ENOUGH || self.answers.age_ns() < ENOUGH_NS {
            return None;
        }
        let (above, below) = (self.answers.line()?, self.questions.line()?);
        let middle = above.at(x) / 2 - below.at(x) / 2;
        Some((middle, 0.5 * (above.slope - below.slope)))
    }

    /// The quickest round trip, ns.
    pub fn quickest_ns(&self) -> Option<i64> {
        self.quickest_ns
    }
}
