//! Requests of states at instants: who asked, and how often anybody may.

use super::allowance::Allowance;
use super::reader::LocalReader;
use super::record::{Kind, encoded};
use super::request::{Answer, At, RequestStatus};
use crate::pipeline::{InstantRequest, Instants};
use crate::schedule::ticker::Monotonic;
use plumbline_record::{InstantAnswer, InstantSource, layout};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Requests that wait for their instants at a time, and those of one reader.
const MAX_WAITING: usize = 64;
const MAX_OF_A_READER: usize = 32;
/// An answer comes this long after the patience at most.
const LOST: Duration = Duration::from_secs(2);

/// Request that waits, and whose it is.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    /// Number in the flight.
    flight: u64,
    place: usize,
    /// Number of the reader.
    number: u64,
    /// An answer that has not come by then is lost.
    end: Instant,
}

/// Requests that wait.
#[derive(Debug)]
pub struct Asked {
    door: Arc<Instants>,
    waiting: Vec<Waiting>,
    next: u64,
    allowance: Allowance,
}

impl Asked {
    /// Requests to a run by its entrance.
    pub fn new(door: Arc<Instants>) -> Self {
        Self { door, waiting: Vec::with_capacity(MAX_WAITING), next: 0, allowance: Allowance::of_all() }
    }

    /// Passes on the request of the reader at `place`; the answer if it is refused.
    pub fn ask(&mut self, place: usize, reader: &mut LocalReader, number: u64, at: At) -> Option<Answer> {
        let now = Instant::now();
        self.waiting.retain(|waiting| waiting.end > now);
        let refused = |words: &str| {
            Some(Answer { number, status: RequestStatus::Failed, value: 0, words: words.into() })
        };
        let of_reader = self.waiting.iter().filter(|waiting| waiting.place == place).count();
        if of_reader == MAX_OF_A_READER || self.waiting.len() == MAX_WAITING {
            return refused("busy: too many instants are waited for; ask again when one is answered");
        }
        if !reader.allowance.take() || !self.allowance.take() {
            return refused("busy: at most 1,000 instants a second are answered to a program, 2,000 in all");
        }
        let flight = self.next;
        self.next += 1;
        let until = Monotonic::now().plus_nanos(i64::from(at.patience_ms) * 1_000_000);
        let request = InstantRequest { number: flight, stamp: at.stamp, until, is_settled: at.is_settled };
        let end = now + Duration::from_millis(at.patience_ms.into()) + LOST;
        self.waiting.push(Waiting { flight, place, number, end });
        if !self.door.ask(InstantSource::Request, request) {
            self.waiting.pop();
            return refused("busy: the flight takes no more requests at present; ask again");
        }
        None
    }

    /// The reader at `place` has gone.
    pub fn forget(&mut self, place: usize) {
        self.waiting.retain(|waiting| waiting.place != place);
    }

    /// Place of the reader who asked, and the record for it.
    pub fn answered(&mut self, answer: &InstantAnswer, handed_over_ns: i64) -> Option<(usize, Vec<u8>)> {
        let at = self.waiting.iter().position(|waiting| waiting.flight == answer.number)?;
        let Waiting { place, number, .. } = self.waiting.swap_remove(at);
        let record = encoded(Kind::Instant.kind(), number, |to| {
            layout::put_instant(&InstantAnswer { number, ..answer.clone() }, handed_over_ns, to);
        });
        Some((place, record))
    }
}
