//! Pools of large entries, handed from one thread to another in place.

use parking_lot::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Large entries that are made once: one is filled in place, read in place, and free again. One thread fills, one reads;
/// neither waits for the other, since nobody stops at a slot that the other is in.
#[derive(Debug)]
pub struct Pool<T> {
    slots: Vec<Slot<T>>,
    /// Entries filled so far.
    filled: AtomicU64,
    dropped: AtomicU64,
}

#[derive(Debug)]
struct Slot<T> {
    /// Number of the entry, from 1 on; 0 if there is nothing to read.
    number: AtomicU64,
    entry: Mutex<T>,
}

impl<T> Slot<T> {
    /// Number of the entry.
    fn number(&self) -> u64 {
        self.number.load(Ordering::Acquire)
    }
}

impl<T> Pool<T> {
    /// `count` entries, at least two: while one is read another is filled.
    pub fn new(count: usize, make: impl Fn() -> T) -> Self {
        let slot = |_| Slot { number: AtomicU64::new(0), entry: Mutex::new(make()) };
        let slots = (0..count.max(2)).map(slot).collect();
        Self { slots, filled: AtomicU64::new(0), dropped: AtomicU64::new(0) }
    }

    /// Fills an entry; without a free one the oldest that waits is taken, and counted. Nothing is allocated.
    pub fn fill(&self, fill: impl FnOnce(&mut T)) {
        // One that the reader is at is passed over; it is at one only.
        let mut busy = self.slots.len();
        for _ in 0..2 {
            let others = self.slots.iter().enumerate().filter(|(k, _)| *k != busy);
            let Some((k, slot)) = others.min_by_key(|(_, slot)| slot.number()) else { return };
            let Some(mut entry) = slot.entry.try_lock() else {
                busy = k;
                continue;
            };
            self.dropped.fetch_add(u64::from(slot.number() != 0), Ordering::Relaxed);
            slot.number.store(0, Ordering::Release);
            fill(&mut entry);
            slot.number.store(self.filled.fetch_add(1, Ordering::Relaxed) + 1, Ordering::Release);
            return;
        }
        self.dropped.fetch_add(1, Ordering::Relaxed);
    }

    /// Reads the oldest entry, which is free then.
    pub fn read<R>(&self, read: impl FnOnce(&mut T) -> R) -> Option<R> {
        for _ in 0..self.slots.len() {
            let waiting = self.slots.iter().filter(|slot| slot.number() != 0);
            let slot = waiting.min_by_key(|slot| slot.number())?;
            // Where it is being filled anew right now it is the newest soon.
            if let Some(mut entry) = slot.entry.try_lock().filter(|_| slot.number() != 0) {
                let result = read(&mut entry);
                slot.number.store(0, Ordering::Release);
                return Some(result);
            }
        }
        None
    }

    /// Entries that were not read in time.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pool_reuses_its_entries_and_forgets_the_oldest() {
        let pool = Pool::new(2, Vec::<u8>::new);
        for k in 0..5 {
            pool.fill(|entry| {
                entry.clear();
                entry.push(k);
            });
        }
        assert_eq!(pool.dropped(), 3);
        assert_eq!(pool.read(|entry| entry[0]), Some(3));
        assert_eq!(pool.read(|entry| entry[0]), Some(4));
        assert_eq!(pool.read(|entry| entry[0]), None);
    }

    #[test]
    fn whoever_fills_passes_over_what_is_being_read_and_over_what_a_death_has_left() {
        let pool = Pool::new(2, || 0);
        pool.fill(|entry| *entry = 1);
        let seen = pool.read(|entry| {
            (2..5).for_each(|k| pool.fill(|other| *other = k));
            *entry
        });
        assert_eq!((seen, pool.read(|entry| *entry), pool.read(|entry| *entry)), (Some(1), Some(4), None));
        assert_eq!(pool.dropped(), 2);
        let died =
            std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| pool.fill(|_| panic!("on purpose"))));
        assert!(died.is_err());
        (5..7).for_each(|k| pool.fill(|entry| *entry = k));
        assert_eq!((pool.read(|entry| *entry), pool.read(|entry| *entry)), (Some(5), Some(6)));
    }
}
