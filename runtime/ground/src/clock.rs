//! Offset of a vehicle's clock against this host's, and round trip, estimated as NTP does.

use std::collections::VecDeque;

/// Exchanges that the estimate is made of.
const KEPT: usize = 16;

/// Times of one query and its reply.
#[derive(Clone, Copy, Debug)]
pub struct Exchange {
    /// The query was sent, by this host's clock, ns.
    pub asked_ns: i64,
    /// The vehicle received it, by its clock, ns.
    pub received_ns: i64,
    /// It replied, by its clock, ns.
    pub answered_ns: i64,
    /// The reply arrived, by this host's clock, ns.
    pub came_ns: i64,
}

impl Exchange {
    fn round_trip_ns(&self) -> i64 {
        self.came_ns.saturating_sub(self.asked_ns) - self.answered_ns.saturating_sub(self.received_ns)
    }

    /// Vehicle's clock minus this host's, for equal delays in both directions, ns.
    fn offset_ns(&self) -> i64 {
        let there = self.received_ns.saturating_sub(self.asked_ns);
        let back = self.answered_ns.saturating_sub(self.came_ns);
        there / 2 + back / 2
    }
}

/// The offset from the last exchanges: the one with the shortest round trip has the smallest error.
#[derive(Clone, Debug, Default)]
pub struct ClockEstimate {
    exchanges: VecDeque<Exchange>,
}

impl ClockEstimate {
    /// Adds an exchange; one whose times contradict each other is ignored.
    pub fn add(&mut self, exchange: Exchange) {
        if exchange.came_ns < exchange.asked_ns || exchange.round_trip_ns() < 0 {
            return;
        }
        if self.exchanges.len() == KEPT {
            self.exchanges.pop_front();
        }
        self.exchanges.push_back(exchange);
    }

    fn best(&self) -> Option<&Exchange> {
        self.exchanges.iter().min_by_key(|exchange| exchange.round_trip_ns())
    }

    /// Vehicle's clock minus this host's, ns.
    pub fn offset_ns(&self) -> Option<i64> {
        self.best().map(Exchange::offset_ns)
    }

    /// Round trip of the last exchange, ns.
    pub fn round_trip_ns(&self) -> Option<i64> {
        self.exchanges.back().map(Exchange::round_trip_ns)
    }

    /// Exchanges so far, up to what is kept.
    pub fn len(&self) -> usize {
        self.exchanges.len()
    }

    /// True if there was no exchange.
    pub fn is_empty(&self) -> bool {
        self.exchanges.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quickest_exchange_gives_the_offset() {
        let mut clock = ClockEstimate::default();
        let offset = 1_000_000;
        for (there, back) in [(900, 100), (50, 50), (100, 5_000)] {
            let received_ns = there + offset;
            let came_ns = there + 10 + back;
            clock.add(Exchange { asked_ns: 0, received_ns, answered_ns: received_ns + 10, came_ns });
        }
        assert_eq!(clock.offset_ns(), Some(offset));
        assert_eq!(clock.round_trip_ns(), Some(5_100));
    }

    #[test]
    fn impossible_exchanges_are_left_out() {
        let mut clock = ClockEstimate::default();
        clock.add(Exchange { asked_ns: 10, received_ns: 0, answered_ns: 0, came_ns: 5 });
        clock.add(Exchange { asked_ns: 0, received_ns: 0, answered_ns: i64::MAX, came_ns: 5 });
        assert!(clock.is_empty());
    }
}
