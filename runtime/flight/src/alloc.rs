//! A global allocator that counts: how often a thread allocates or frees in a given stretch, and how much the threads of the
//! network hold.
//!
//! Everything is passed on to the system's allocator; the cost is two thread-local additions.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicI64, Ordering};

/// A thread adds what it holds to what all hold when that has changed by so much, bytes.
const GRAIN: i64 = 16 * 1024;
/// Threads of the network by the beginnings of their names: Zenoh's, and ours.
const OF_NETWORK: [&[u8]; 7] =
    [b"rx-", b"tx-", b"net-", b"acc-", b"app-", b"plumbline-net", b"plumbline-ans"];

thread_local! {
    static EVENTS: Cell<u64> = const { Cell::new(0) };
    /// What the thread has allocated and not freed since it last told, bytes.
    static HELD: Cell<i64> = const { Cell::new(0) };
    static IS_OF_NETWORK: Cell<Option<bool>> = const { Cell::new(None) };
}

static HELD_BY_NETWORK: AtomicI64 = AtomicI64::new(0);

/// What the threads of the network have allocated and not freed, bytes, give or take 16 kB for each of them. What one of them
/// frees for another thread, or the other way round, is missing here; they have little to do with others.
#[must_use]
pub fn held_by_network() -> i64 {
    HELD_BY_NETWORK.load(Ordering::Relaxed)
}

/// The counting allocator; the binary installs it.
#[derive(Debug)]
pub struct CountingAllocator;

fn count(bytes: i64) {
    // During the end of a thread its locals may be gone: nobody counts there.
    let _ = EVENTS.try_with(|events| events.set(events.get() + 1));
    let _ = HELD.try_with(|held| {
        let sum = held.get() + bytes;
        held.set(sum);
        if sum.abs() >= GRAIN {
            held.set(0);
            settle(sum);
        }
    });
}

/// Not before a thread has allocated much, by when it has its name.
#[cold]
fn settle(bytes: i64) {
    let is_of_network = IS_OF_NETWORK.try_with(|known| {
        known.get().unwrap_or_else(|| {
            let is_of_network = rustix::thread::name()
                .is_ok_and(|name| OF_NETWORK.iter().any(|begin| name.as_bytes().starts_with(begin)));
            known.set(Some(is_of_network));
            is_of_network
        })
    });
    if is_of_network == Ok(true) {
        HELD_BY_NETWORK.fetch_add(bytes, Ordering::Relaxed);
    }
}

/// No object is larger than half of the address space.
fn signed(bytes: usize) -> i64 {
    i64::try_from(bytes).unwrap_or(i64::MAX)
}

// SAFETY: every call is passed on unchanged to the system's allocator, which upholds the contract. Counting touches
// thread-local `Cell`s without destructors, and holds none while it asks for the thread's name, which allocates: that is
// counted like anything else, and asks no more, since it is less than a grain.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(signed(layout.size()));
        // SAFETY: as the caller guarantees to us.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        count(-signed(layout.size()));
        // SAFETY: as the caller guarantees to us.
        unsafe { System.dealloc(ptr, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(signed(layout.size()));
        // SAFETY: as the caller guarantees to us.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count(signed(new_size) - signed(layout.size()));
        // SAFETY: as the caller guarantees to us.
        unsafe { System.realloc(ptr, layout, new_size) }
    }
}

/// Counts the allocations and frees of this thread while it lives. Counts may overlap.
#[derive(Debug)]
pub struct Count(u64);

impl Count {
    /// Begins at zero.
    #[must_use]
    pub fn begin() -> Self {
        Self(EVENTS.with(Cell::get))
    }

    /// Allocations and frees since the beginning.
    #[must_use]
    pub fn end(self) -> u64 {
        EVENTS.with(Cell::get) - self.0
    }
}
