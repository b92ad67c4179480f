//! Rings that forget the oldest rather than make anybody wait: from one thread of a run to one reader.

use super::ring::{Bell, Reader, Writer, ring};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A lane has room for so many times what its reader keeps.
const ROOM_PER_KEPT: usize = 4;

/// A ring from one thread of a run to one task: [`lane`] makes both ends.
#[derive(Debug)]
pub struct LaneWriter<T> {
    ring: Writer<T>,
    /// Entries that found no room.
    refused: Arc<AtomicU64>,
}

/// The reading end of a lane.
#[derive(Debug)]
pub struct LaneReader<T> {
    ring: Reader<T>,
    keep: usize,
    refused: Arc<AtomicU64>,
    /// Refused entries that were noticed.
    noticed: u64,
    forgotten: Arc<AtomicU64>,
}

/// Entries of a lane that were lost, seen from anywhere.
#[derive(Clone, Debug)]
pub struct LaneLosses {
    refused: Arc<AtomicU64>,
    forgotten: Arc<AtomicU64>,
}

/// A ring that forgets the oldest: its reader keeps the newest `keep` entries of those that wait, and counts the
/// others. Writing is wait-free: a thread of high priority never spins on a reader that it has interrupted, as it could
/// if it took the oldest out itself. The price is that a reader which was away for long, so that the writer found no
/// room, finds old entries only; it forgets them all.
pub fn lane<T>(keep: usize) -> (LaneWriter<T>, LaneReader<T>, LaneLosses) {
    let (writer, reader) = ring(ROOM_PER_KEPT * keep, &Bell::default());
    let losses = LaneLosses { refused: Arc::default(), forgotten: Arc::default() };
    let LaneLosses { refused, forgotten } = losses.clone();
    let reader = LaneReader { ring: reader, keep, refused: Arc::clone(&refused), noticed: 0, forgotten };
    (LaneWriter { ring: writer, refused }, reader, losses)
}

impl<T> LaneWriter<T> {
    /// Adds an entry; without room it is lost, and counted.
    pub fn push(&mut self, entry: T) {
        if self.ring.push(entry).is_err() {
            self.refused.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl<T> LaneReader<T> {
    /// Takes the oldest entry that is worth keeping.
    pub fn pop(&mut self) -> Option<T> {
        let refused = self.refused.load(Ordering::Relaxed);
        let keep = if refused == self.noticed { self.keep } else { 0 };
        self.noticed = refused;
        for _ in keep..self.ring.waiting() {
            self.forgotten.fetch_add(u64::from(self.ring.pop().is_some()), Ordering::Relaxed);
        }
        self.ring.pop()
    }
}

impl LaneLosses {
    /// Entries lost so far.
    pub fn count(&self) -> u64 {
        self.refused.load(Ordering::Relaxed) + self.forgotten.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_reader_finds_the_newest_and_the_others_are_counted() {
        let (mut writer, mut reader, losses) = lane(3);
        (0..5).for_each(|k| writer.push(k));
        assert_eq!(std::iter::from_fn(|| reader.pop()).collect::<Vec<_>>(), [2, 3, 4]);
        assert_eq!(losses.count(), 2);
    }

    #[test]
    fn a_reader_that_was_away_for_long_starts_with_what_is_new() {
        let (mut writer, mut reader, losses) = lane(3);
        (0..100).for_each(|k| writer.push(k));
        assert_eq!(reader.pop(), None);
        assert_eq!(losses.count(), 100);
        writer.push(100);
        assert_eq!((reader.pop(), losses.count()), (Some(100), 100));
    }
}
