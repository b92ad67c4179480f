//! States at instants that somebody asks for: a camera's trigger, a payload, a list of stamps.
//!
//! Requests come over [`Instants`] from any thread, or stand there before the run. The tick answers them by the history of its
//! propagator ([`plumbline_estimator::propagator::history`]), after a reading or when a request wakes it. When it does is an
//! order of the run, and so the answers are the same in a re-execution.

use crate::schedule::queue::Queue;
use crate::schedule::ring::Bell;
use crate::schedule::ticker::Monotonic;
use parking_lot::Mutex;
use plumbline_config::Timestamp;
use plumbline_estimator::NoInstant;
use plumbline_record::{InstantOrder, InstantOutcome, InstantSource};
use std::collections::VecDeque;
use std::sync::{Arc, OnceLock};

/// Requests of programs, or triggers of the autopilot, that wait for the tick.
const QUEUE: usize = 64;
/// Requests that wait for their instant.
const WAITING: usize = 2 * QUEUE;
/// Answers at a time in a live run: the odometry comes first.
const ANSWERS: usize = 2;

/// Request of the state at an instant.
#[derive(Clone, Copy, Debug)]
pub struct InstantRequest {
    /// Number that the answer carries.
    pub number: u64,
    /// The instant, on the IMU's clock.
    pub stamp: Timestamp,
    /// Until when it may wait: what cannot be answered then is refused.
    pub until: Monotonic,
    /// True if the request waits for the estimate after the instant.
    pub is_settled: bool,
}

/// Entrance of requests to the tick. One thread may ask for each source.
#[derive(Debug)]
pub struct Instants {
    requests: Queue<InstantRequest>,
    triggers: Queue<InstantRequest>,
    list: Mutex<Vec<Timestamp>>,
    bell: OnceLock<Bell>,
}

impl Default for Instants {
    fn default() -> Self {
        Self {
            requests: Queue::new(QUEUE),
            triggers: Queue::new(QUEUE),
            list: Mutex::default(),
            bell: OnceLock::new(),
        }
    }
}

impl Instants {
    /// Asks for the state at each of these instants, as soon as it is settled; before the run. Numbers count them from 0.
    pub fn expect(&self, stamps: Vec<Timestamp>) {
        *self.list.lock() = stamps;
    }

    /// Asks for the state at an instant; `false` when too many requests wait.
    pub fn ask(&self, source: InstantSource, request: InstantRequest) -> bool {
        let queue = match source {
            InstantSource::Trigger => &self.triggers,
            InstantSource::Request | InstantSource::List => &self.requests,
        };
        let is_taken = queue.push(request).is_ok();
        if let Some(bell) = self.bell.get() {
            bell.ring();
        }
        is_taken
    }

    /// Requests ring this bell from now on.
    pub(super) fn ring_with(&self, bell: &Bell) {
        let _ = self.bell.set(bell.clone());
    }

    /// True if a request waits.
    pub(super) fn is_waiting(&self) -> bool {
        !self.requests.is_empty() || !self.triggers.is_empty()
    }

    fn next(&self) -> Option<(InstantSource, InstantRequest)> {
        let trigger = || Some((InstantSource::Trigger, self.triggers.pop()?));
        trigger().or_else(|| Some((InstantSource::Request, self.requests.pop()?)))
    }
}

/// Requests in the tick's hands.
pub struct InstantDesk {
    door: Arc<Instants>,
    /// Rows with their instants, in order of time.
    list: VecDeque<(u64, Timestamp)>,
    waiting: heapless::Vec<(InstantSource, InstantRequest), WAITING>,
}

/// Availability of the state at an instant.
pub struct Standing {
    /// True if the samples have reached the instant.
    pub is_reached: bool,
    /// True if the state is final.
    pub is_settled: bool,
}

impl InstantDesk {
    /// Takes over the list.
    pub fn new(door: Arc<Instants>) -> Self {
        let stamps = std::mem::take(&mut *door.list.lock());
        let mut rows: Vec<(u64, Timestamp)> = (0..).zip(stamps).collect();
        rows.sort_by_key(|(row, stamp)| (*stamp, *row));
        Self { door, list: rows.into(), waiting: heapless::Vec::new() }
    }

    /// The next request to be answered now, at most [`ANSWERS`] of those that programs sent.
    pub fn next(
        &mut self,
        answered: &mut usize,
        standing: impl Fn(Timestamp) -> Standing,
    ) -> Option<(InstantSource, u64, Timestamp)> {
        if let Some((row, stamp)) = self.list.pop_front_if(|(_, stamp)| standing(*stamp).is_settled) {
            return Some((InstantSource::List, row, stamp));
        }
        if *answered == ANSWERS {
            return None;
        }
        while let Some(request) = self.door.next() {
            // One for which there is no room waits no longer: the door is never left full.
            if let Err((source, request)) = self.waiting.push(request) {
                *answered += 1;
                return Some((source, request.number, request.stamp));
            }
        }
        if self.waiting.is_empty() {
            return None;
        }
        let now = Monotonic::now();
        let is_due = |(_, request): &(InstantSource, InstantRequest)| {
            let at = standing(request.stamp);
            now >= request.until || (at.is_reached && (at.is_settled || !request.is_settled))
        };
        let place = self.waiting.iter().position(is_due)?;
        let (source, request) = self.waiting.remove(place);
        *answered += 1;
        Some((source, request.number, request.stamp))
    }

    /// Entrance for requests.
    pub fn door(&self) -> &Arc<Instants> {
        &self.door
    }

    /// Next request that is still open at the end of the run.
    pub fn rest(&mut self) -> Option<(InstantSource, u64, Timestamp)> {
        let list = self.list.pop_front().map(|(row, stamp)| (InstantSource::List, row, stamp));
        list.or_else(|| {
            let (source, request) = self.waiting.pop().or_else(|| self.door.next())?;
            Some((source, request.number, request.stamp))
        })
    }
}

/// Outcome of a refusal.
pub fn outcome(refusal: NoInstant) -> InstantOutcome {
    match refusal {
        NoInstant::NoPose => InstantOutcome::NoPose,
        NoInstant::TooOld => InstantOutcome::TooOld,
        NoInstant::Ahead => InstantOutcome::Ahead,
    }
}

/// Order of a request that is answered after so many readings.
pub fn order((source, number, stamp): (InstantSource, u64, Timestamp), readings_before: u64) -> InstantOrder {
    InstantOrder { number, stamp, readings_before, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(number: u64, stamp_ns: i64) -> InstantRequest {
        let until = Monotonic::now().plus_nanos(60_000_000_000);
        InstantRequest { number, stamp: Timestamp::from_nanos(stamp_ns), until, is_settled: false }
    }

    fn ahead(_: Timestamp) -> Standing {
        Standing { is_reached: false, is_settled: false }
    }

    #[test]
    fn requests_without_room_wait_no_longer_and_the_door_is_never_left_full() {
        let door = Arc::new(Instants::default());
        let mut desk = InstantDesk::new(Arc::clone(&door));
        let mut refused = 0;
        for k in 0..10 * WAITING as u64 {
            assert!(door.ask(InstantSource::Request, request(k, 5)), "{k}");
            refused += u64::from(desk.next(&mut 0, ahead).is_some());
            assert!(!door.is_waiting());
        }
        assert_eq!(refused, 9 * WAITING as u64);
    }

    #[test]
    fn a_live_run_answers_two_at_a_time_and_a_list_all_at_once() {
        let door = Arc::new(Instants::default());
        door.expect([30, 10, 20].map(Timestamp::from_nanos).into());
        let mut desk = InstantDesk::new(Arc::clone(&door));
        for k in 0..3 {
            door.ask(InstantSource::Request, request(k, 5));
        }
        let settled = |stamp: Timestamp| {
            let is_reached = stamp.as_nanos() < 25;
            Standing { is_reached, is_settled: is_reached }
        };
        let mut answered = 0;
        let mut served = std::iter::from_fn(|| desk.next(&mut answered, settled));
        let numbers: Vec<(InstantSource, u64)> =
            served.by_ref().map(|(source, number, _)| (source, number)).collect();
        let (list, program) = (InstantSource::List, InstantSource::Request);
        assert_eq!(numbers, [(list, 1), (list, 2), (program, 0), (program, 1)]);
        let rest: Vec<_> =
            std::iter::from_fn(|| desk.rest()).map(|(source, number, _)| (source, number)).collect();
        assert_eq!(rest, [(list, 0), (program, 2)]);
    }
}
