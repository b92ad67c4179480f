//! A queue from many threads to one, of a fixed size, in which nobody of high priority waits for anybody of low priority.
//!
//! The queue itself is `crossbeam`'s. Where it is full, or empty, it looks whether the thread on the other side is about to
//! change that, and spins until that has happened: for ever, if it has interrupted that very thread on its processor.
//! Here who writes has a place before it touches the queue, and who reads gives a place back when it has left the queue:
//! so a writer never meets a reader, and never finds the queue full. (The reader may meet a writer that was interrupted
//! while others have written behind it, and spins then: where it is the one of high priority, let one alone write.)

use crossbeam_queue::ArrayQueue;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The queue. Any thread writes, one reads.
#[derive(Debug)]
pub struct Queue<T> {
    entries: ArrayQueue<T>,
    /// Places that are given away: to entries that wait, are being written or are being taken.
    given: AtomicUsize,
    /// Entries that are whole, and have not been taken.
    whole: AtomicUsize,
}

impl<T> Queue<T> {
    /// With room for so many entries, at least one.
    pub fn new(capacity: usize) -> Self {
        let capacity = capacity.max(1);
        Self { entries: ArrayQueue::new(capacity), given: AtomicUsize::new(0), whole: AtomicUsize::new(0) }
    }

    /// A place for an entry, if there is room.
    pub fn place(&self) -> Option<QueueSlot<'_, T>> {
        let capacity = self.entries.capacity();
        // Release of the reader's last: the place that is given is one that it has left.
        let taken = self.given.fetch_update(Ordering::AcqRel, Ordering::Relaxed, |given| {
            (given < capacity).then_some(given + 1)
        });
        taken.is_ok().then(|| QueueSlot { queue: self })
    }

    /// Adds an entry.
    ///
    /// # Errors
    /// The entry, where there is no room.
    pub fn push(&self, entry: T) -> Result<(), T> {
        match self.place() {
            Some(place) => {
                place.fill(entry);
                Ok(())
            }
            None => Err(entry),
        }
    }

    /// True if no entry is whole.
    pub fn is_empty(&self) -> bool {
        self.whole.load(Ordering::Acquire) == 0
    }

    /// Takes the oldest entry that is whole. For one thread: two would give back each other's places.
    pub fn pop(&self) -> Option<T> {
        self.whole.fetch_update(Ordering::AcqRel, Ordering::Relaxed, |whole| whole.checked_sub(1)).ok()?;
        let entry = self.entries.pop();
        self.given.fetch_sub(1, Ordering::AcqRel);
        entry
    }
}

/// A place in a queue, to be filled or left.
#[derive(Debug)]
pub struct QueueSlot<'a, T> {
    queue: &'a Queue<T>,
}

impl<T> QueueSlot<'_, T> {
    /// Puts the entry there.
    pub fn fill(self, entry: T) {
        let queue = self.queue;
        // The place is now the entry's, which gives it back when it is taken.
        std::mem::forget(self);
        let refused = queue.entries.push(entry);
        debug_assert!(refused.is_ok(), "there are as many places as the queue has room");
        queue.whole.fetch_add(1, Ordering::AcqRel);
    }
}

impl<T> Drop for QueueSlot<'_, T> {
    fn drop(&mut self) {
        self.queue.given.fetch_sub(1, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicBool;

    #[test]
    fn entries_come_in_order_a_full_queue_gives_them_back_and_a_place_that_is_left_is_free() {
        let queue = Queue::new(2);
        let place = queue.place().unwrap();
        assert_eq!((queue.push(1), queue.push(2), queue.pop()), (Ok(()), Err(2), Some(1)));
        drop(place);
        assert_eq!((queue.push(3), queue.push(4), queue.push(5)), (Ok(()), Ok(()), Err(5)));
        assert_eq!((queue.pop(), queue.pop(), queue.pop()), (Some(3), Some(4), None));
    }

    #[test]
    fn nothing_is_lost_or_doubled_between_four_who_write_and_one_who_reads() {
        const EACH: usize = 500;
        let (queue, is_over) = (Queue::new(7), AtomicBool::new(false));
        let mut seen = vec![Vec::new(); 4];
        std::thread::scope(|scope| {
            let (queue, is_over) = (&queue, &is_over);
            let writers: Vec<_> = (0..4)
                .map(|who| {
                    scope.spawn(move || {
                        for k in 0..EACH {
                            while queue.push((who, k)).is_err() {
                                std::thread::yield_now();
                            }
                        }
                    })
                })
                .collect();
            let reader = scope.spawn(move || {
                let mut seen = vec![Vec::new(); 4];
                loop {
                    let was_over = is_over.load(Ordering::Acquire);
                    while let Some((who, k)) = queue.pop() {
                        let seen: &mut Vec<usize> = &mut seen[who];
                        seen.push(k);
                    }
                    if was_over {
                        return seen;
                    }
                    std::thread::yield_now();
                }
            });
            writers.into_iter().for_each(|writer| writer.join().unwrap());
            is_over.store(true, Ordering::Release);
            seen = reader.join().unwrap();
        });
        assert!(seen.iter().all(|seen| seen.iter().copied().eq(0..EACH)));
    }
}
