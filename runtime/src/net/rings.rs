//! What joins the estimator to the network: rings that forget the oldest rather than make anybody wait.

use super::picture::Shot;
use crossbeam_queue::ArrayQueue;
use plumbline_config::ValidConfig;
use plumbline_estimator::{Estimate, MapSnapshot, Odometry};
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use tokio::sync::Notify;

/// Odometry that waits for the network: a quarter of a second.
const ODOMETRY_RING: usize = 50;
/// Estimates that wait for the network: two seconds.
const ESTIMATE_RING: usize = 40;
/// Map snapshots of the window that are filled, wait or are read: they come with keyframes, a few a second.
const SNAPSHOTS: usize = 8;
/// Pictures that are filled, wait or are read.
const SHOTS: usize = 3;

/// A bounded ring that forgets its oldest entry rather than make the writer wait.
#[derive(Debug)]
pub struct DropOldest<T> {
    queue: ArrayQueue<T>,
    dropped: AtomicU64,
}

impl<T> DropOldest<T> {
    /// Room for `capacity` entries.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        Self { queue: ArrayQueue::new(capacity), dropped: AtomicU64::new(0) }
    }

    /// Adds an entry; full, the oldest goes and is counted.
    pub fn push(&self, entry: T) {
        if self.queue.force_push(entry).is_some() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Takes the oldest entry.
    pub fn pop(&self) -> Option<T> {
        self.queue.pop()
    }

    /// Entries forgotten so far.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

/// A ring of large entries that are made once: an entry is filled in place, read, and goes back.
#[derive(Debug)]
pub struct Pool<T> {
    spare: ArrayQueue<Box<T>>,
    filled: ArrayQueue<Box<T>>,
    dropped: AtomicU64,
}

impl<T> Pool<T> {
    /// `count` entries.
    #[must_use]
    pub fn new(count: usize, make: impl Fn() -> T) -> Self {
        let pool = Self {
            spare: ArrayQueue::new(count),
            filled: ArrayQueue::new(count),
            dropped: AtomicU64::new(0),
        };
        for _ in 0..count {
            let _ = pool.spare.push(Box::new(make()));
        }
        pool
    }

    /// Fills an entry; without a spare one the oldest that waits is taken, and counted. Nothing is
    /// allocated.
    pub fn fill(&self, fill: impl FnOnce(&mut T)) {
        let entry = self.spare.pop().or_else(|| {
            let oldest = self.filled.pop();
            self.dropped.fetch_add(1, Ordering::Relaxed);
            oldest
        });
        let Some(mut entry) = entry else { return };
        fill(&mut entry);
        let _ = self.filled.push(entry);
    }

    /// Takes a spare entry to fill at leisure; `None` when all wait to be read.
    pub fn spare(&self) -> Option<Box<T>> {
        self.spare.pop()
    }

    /// Offers a filled entry.
    pub fn offer(&self, entry: Box<T>) {
        let _ = self.filled.push(entry);
    }

    /// Reads the oldest entry, which then goes back.
    pub fn read<R>(&self, read: impl FnOnce(&mut T) -> R) -> Option<R> {
        let mut entry = self.filled.pop()?;
        let result = read(&mut entry);
        let _ = self.spare.push(entry);
        Some(result)
    }

    /// Entries that were not read in time.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

/// Everything that is handed over.
#[derive(Debug)]
pub struct Rings {
    /// Odometry, with the time it was handed over, ns since 1970.
    pub odometry: DropOldest<(Odometry, i64)>,
    /// Odometry for ROS 2, where that is enabled.
    pub ros: Option<DropOldest<Odometry>>,
    /// Estimates, with what the frame took, ms.
    pub estimates: DropOldest<(Estimate, f64)>,
    /// What the window holds, after each keyframe.
    pub snapshots: Pool<MapSnapshot>,
    /// Left pictures with what is tracked in them.
    pub shots: Pool<Shot>,
    /// Somebody looks at pictures.
    pub is_watched: AtomicBool,
    /// Step of the degradation ladder.
    pub rung: AtomicU8,
    /// Wakes who sends odometry.
    pub odometry_wake: Notify,
    /// Wakes who empties the other rings.
    pub wake: Notify,
    /// Wakes who sends pictures.
    pub picture_wake: Notify,
    /// The flight is over.
    pub stop: AtomicBool,
}

impl Rings {
    /// Everything allocated for the configuration.
    #[must_use]
    pub fn new(config: &ValidConfig) -> Self {
        Self {
            odometry: DropOldest::new(ODOMETRY_RING),
            ros: config.ros.enabled.then(|| DropOldest::new(ODOMETRY_RING)),
            estimates: DropOldest::new(ESTIMATE_RING),
            snapshots: Pool::new(SNAPSHOTS, || MapSnapshot::new(config.setup())),
            shots: Pool::new(SHOTS, || Shot::new(config)),
            is_watched: AtomicBool::new(false),
            rung: AtomicU8::new(0),
            odometry_wake: Notify::new(),
            wake: Notify::new(),
            picture_wake: Notify::new(),
            stop: AtomicBool::new(false),
        }
    }

    /// The flight is over: who empties the rings sends what is left, and ends.
    pub fn end(&self) {
        self.stop.store(true, Ordering::Relaxed);
        self.odometry_wake.notify_one();
        self.wake.notify_one();
    }

    /// Entries forgotten because the network was slower than the vehicle.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.odometry.dropped() + self.estimates.dropped() + self.snapshots.dropped()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_ring_forgets_the_oldest_and_counts_it() {
        let ring = DropOldest::new(3);
        (0..5).for_each(|k| ring.push(k));
        assert_eq!(ring.dropped(), 2);
        assert_eq!(std::iter::from_fn(|| ring.pop()).collect::<Vec<_>>(), [2, 3, 4]);
    }

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
        assert!(pool.spare().is_some());
    }
}
