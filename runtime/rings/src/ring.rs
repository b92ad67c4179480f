//! Rings between threads: one writer, one reader, a fixed size, no locks and no waiting in the writer.
//!
//! The ring itself is `rtrb`'s, wait-free on both sides: a thread of high priority can never spin on one of
//! low priority. Beside it is what the reader sleeps on.

use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;
use std::sync::OnceLock;
use std::thread::Thread;
use std::time::{Duration, Instant};

/// Wakes the thread that waits; several rings may share one.
#[derive(Clone, Debug, Default)]
pub struct Bell(Arc<OnceLock<Thread>>);

impl Bell {
    /// The calling thread is the one to wake from now on. The first caller wins.
    pub fn listen(&self) {
        let _ = self.0.set(std::thread::current());
    }

    /// Wakes it.
    pub fn ring(&self) {
        if let Some(thread) = self.0.get() {
            thread.unpark();
        }
    }

    /// Sleeps, on the thread that listens, until `ready` gives something or `patience` has passed.
    pub fn wait<T>(&self, patience: Duration, mut ready: impl FnMut() -> Option<T>) -> Option<T> {
        let end = Instant::now() + patience;
        loop {
            if let Some(value) = ready() {
                return Some(value);
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return None;
            }
            std::thread::park_timeout(left);
        }
    }
}

/// The writing end.
#[derive(Debug)]
pub struct Writer<T> {
    ring: Producer<T>,
    bell: Bell,
    refused: u64,
}

/// The reading end.
#[derive(Debug)]
pub struct Reader<T> {
    ring: Consumer<T>,
    deepest: usize,
}

/// A ring for `capacity` entries whose reader sleeps on `bell`.
pub fn ring<T>(capacity: usize, bell: &Bell) -> (Writer<T>, Reader<T>) {
    let (producer, consumer) = RingBuffer::new(capacity);
    (Writer { ring: producer, bell: bell.clone(), refused: 0 }, Reader { ring: consumer, deepest: 0 })
}

impl<T> Writer<T> {
    /// Adds an entry and wakes the reader; gives it back, and counts it, when the ring is full.
    ///
    /// # Errors
    /// The entry.
    pub fn push(&mut self, entry: T) -> Result<(), T> {
        let outcome = self.ring.push(entry).map_err(|rtrb::PushError::Full(entry)| entry);
        self.refused += u64::from(outcome.is_err());
        self.bell.ring();
        outcome
    }

    /// Entries that found the ring full.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// True if the reader has gone: nothing reads what is written.
    pub fn is_closed(&self) -> bool {
        self.ring.is_abandoned()
    }

    /// True if an entry would find room.
    pub fn has_room(&self) -> bool {
        !self.ring.is_full()
    }
}

impl<T> Reader<T> {
    /// Takes the oldest entry.
    pub fn pop(&mut self) -> Option<T> {
        self.deepest = self.deepest.max(self.ring.slots());
        self.ring.pop().ok()
    }

    /// Waits on `bell` for the oldest entry, `nap` after `nap`; `None` when the writer has gone.
    pub fn next(&mut self, bell: &Bell, nap: Duration) -> Option<T> {
        loop {
            let entry = bell.wait(nap, || self.pop());
            if entry.is_some() || self.is_closed() {
                return entry;
            }
        }
    }

    /// Entries that it has room for.
    pub fn capacity(&self) -> usize {
        self.ring.buffer().capacity()
    }

    /// Entries that wait.
    pub fn waiting(&self) -> usize {
        self.ring.slots()
    }

    /// Looks at the oldest entry.
    pub fn peek(&self) -> Option<&T> {
        self.ring.peek().ok()
    }

    /// Most entries that ever waited when one was taken.
    pub fn deepest(&self) -> usize {
        self.deepest
    }

    /// True if the writer has gone and nothing is left.
    pub fn is_closed(&self) -> bool {
        self.ring.is_abandoned() && self.ring.is_empty()
    }
}

impl<T> Drop for Writer<T> {
    fn drop(&mut self) {
        self.bell.ring();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_come_in_order_and_a_full_ring_gives_them_back() {
        let (mut writer, mut reader) = ring(2, &Bell::default());
        assert_eq!((writer.push(1), writer.push(2), writer.push(3)), (Ok(()), Ok(()), Err(3)));
        assert_eq!(
            (reader.peek().copied(), reader.pop(), reader.pop(), reader.pop()),
            (Some(1), Some(1), Some(2), None)
        );
        assert_eq!((writer.refused(), reader.deepest()), (1, 2));
        assert!(!reader.is_closed());
        drop(writer);
        assert!(reader.is_closed());
    }

    #[test]
    fn a_sleeping_reader_is_woken() {
        let bell = Bell::default();
        let (mut writer, mut reader) = ring(1, &bell);
        std::thread::scope(|scope| {
            let reading = scope.spawn(move || {
                bell.listen();
                bell.wait(Duration::from_secs(20), || reader.pop())
            });
            std::thread::sleep(Duration::from_millis(20));
            writer.push(7).unwrap();
            assert_eq!(reading.join().unwrap(), Some(7));
        });
    }

    #[test]
    fn patience_ends() {
        let bell = Bell::default();
        bell.listen();
        assert_eq!(bell.wait(Duration::from_millis(5), || None::<()>), None);
    }
}
