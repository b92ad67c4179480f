//! What joins a run to the network: rings that forget the oldest rather than make anybody wait.

use super::picture::Shot;
use super::task_bell::TaskBell;
use plumbline_config::ValidConfig;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_estimator::{Estimate, MapSnapshot, Odometry};
use plumbline_flight::schedule::ring::{Bell, Reader, Writer, ring};
use plumbline_flight::schedule::tasks::TaskId;
use plumbline_flight::schedule::watchdog::Pulse;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};

/// Odometry that waits for the network: a quarter of a second.
const ODOMETRY_RING: usize = 50;
/// Estimates that wait for the network: two seconds.
const ESTIMATE_RING: usize = 40;
/// A lane has room for so many times what its reader keeps.
const ROOM_PER_KEPT: usize = 4;
/// Map snapshots of the window that are filled, wait or are read: they come with keyframes, a few a second.
const SNAPSHOTS: usize = 8;
/// Corrected paths that are filled, wait or are read: only the newest counts.
const PATHS: usize = 3;
/// Pictures that are filled, wait or are read.
const SHOTS: usize = 3;

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
#[must_use]
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
    #[must_use]
    pub fn count(&self) -> u64 {
        self.refused.load(Ordering::Relaxed) + self.forgotten.load(Ordering::Relaxed)
    }
}

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
    /// Whether there is something to read.
    fn number(&self) -> u64 {
        self.number.load(Ordering::Acquire)
    }

    /// The entry, unless the other thread is at it.
    fn enter(&self) -> Option<MutexGuard<'_, T>> {
        match self.entry.try_lock() {
            Ok(entry) => Some(entry),
            // A thread died at it: it is filled anew.
            Err(TryLockError::Poisoned(entry)) => Some(entry.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }
}

impl<T> Pool<T> {
    /// `count` entries, at least two: while one is read another is filled.
    #[must_use]
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
            let Some(mut entry) = slot.enter() else {
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
            if let Some(mut entry) = slot.enter().filter(|_| slot.number() != 0) {
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

/// What the run writes, each from one thread.
#[derive(Debug)]
pub struct Written {
    /// Odometry, with the time it was handed over, ns since 1970: from the tick.
    pub odometry: LaneWriter<(Odometry, i64)>,
    /// Estimates, with what the frame took, ms: from the window.
    pub estimates: LaneWriter<(Estimate, f64)>,
    /// Where the odometry lies in the map: from the window.
    pub places: LaneWriter<MapEstimate>,
}

/// Reading ends of [`Written`].
#[derive(Debug)]
pub struct ToSend {
    /// Odometry, with the time it was handed over, ns since 1970; taken by the task that sends it.
    pub odometry: Option<LaneReader<(Odometry, i64)>>,
    /// Estimates, with what the frame took, ms.
    pub estimates: LaneReader<(Estimate, f64)>,
    /// Where the odometry lies in the map.
    pub places: LaneReader<MapEstimate>,
}

/// Everything else that run and network share.
#[derive(Debug)]
pub struct Rings {
    /// What the window holds, after each keyframe.
    pub snapshots: Pool<MapSnapshot>,
    /// The corrected path, after each frame that was taken into the map.
    pub paths: Pool<MapPath>,
    /// Left pictures with what is tracked in them.
    pub shots: Pool<Shot>,
    /// Whether the camera has subscribers.
    pub is_watched: AtomicBool,
    /// Step of the degradation ladder.
    pub rung: AtomicU8,
    /// Signs of life of the task that sends odometry.
    pub odometry_pulse: Arc<Pulse>,
    /// There is such a task.
    pub sends_odometry: AtomicBool,
    /// Those of the thread that sends everything else.
    pub pulse: Arc<Pulse>,
    /// Wakes the task that sends odometry.
    pub odometry_bell: TaskBell,
    /// Wakes who sends estimates and snapshots.
    pub bell: TaskBell,
    /// Wakes the task that sends camera images.
    pub picture_bell: TaskBell,
    /// The flight is over.
    pub stop: AtomicBool,
    losses: [LaneLosses; 3],
}

impl Rings {
    /// Everything allocated for the configuration; corrected paths have at most `path_poses` poses.
    ///
    /// # Errors
    /// When the system has no more file descriptors.
    pub fn new(config: &ValidConfig, path_poses: usize) -> std::io::Result<(Self, Written, ToSend)> {
        let (odometry_in, odometry, odometry_losses) = lane(ODOMETRY_RING);
        let (estimates_in, estimates, estimate_losses) = lane(ESTIMATE_RING);
        let (places_in, places, place_losses) = lane(ESTIMATE_RING);
        let rings = Self {
            snapshots: Pool::new(SNAPSHOTS, || MapSnapshot::new(config.setup())),
            paths: Pool::new(PATHS, || MapPath::new(path_poses)),
            shots: Pool::new(SHOTS, || Shot::new(config)),
            is_watched: AtomicBool::new(false),
            rung: AtomicU8::new(0),
            sends_odometry: AtomicBool::new(false),
            odometry_pulse: Arc::new(Pulse::new(TaskId::Odometry)),
            pulse: Arc::new(Pulse::new(TaskId::Network)),
            odometry_bell: TaskBell::new()?,
            bell: TaskBell::new()?,
            picture_bell: TaskBell::new()?,
            stop: AtomicBool::new(false),
            losses: [odometry_losses, estimate_losses, place_losses],
        };
        let written = Written { odometry: odometry_in, estimates: estimates_in, places: places_in };
        Ok((rings, written, ToSend { odometry: Some(odometry), estimates, places }))
    }

    /// Ends the flight: the tasks send what is left, and end.
    pub fn end(&self) {
        self.stop.store(true, Ordering::Relaxed);
        self.odometry_bell.ring();
        self.bell.ring();
    }

    /// Entries dropped because the network was slower than the vehicle.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.losses.iter().map(LaneLosses::count).sum::<u64>() + self.snapshots.dropped()
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
