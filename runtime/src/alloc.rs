//! A global allocator that counts on request: how often a thread allocates or frees in a given stretch.
//!
//! Everything is passed on to the system's allocator; outside a [`Count`] the cost is one thread-local
//! read.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static EVENTS: Cell<Option<u64>> = const { Cell::new(None) };
}

/// The counting allocator; the binary installs it.
#[derive(Debug)]
pub struct CountingAllocator;

fn count() {
    // During the end of a thread its locals may be gone: then nothing is being counted.
    let _ = EVENTS.try_with(|events| events.set(events.get().map(|n| n + 1)));
}

// SAFETY: every call is passed on unchanged to the system's allocator, which upholds the contract; counting
// touches a thread-local `Cell` without a destructor and never allocates.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: as the caller guarantees to us.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        count();
        // SAFETY: as the caller guarantees to us.
        unsafe { System.dealloc(ptr, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: as the caller guarantees to us.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count();
        // SAFETY: as the caller guarantees to us.
        unsafe { System.realloc(ptr, layout, new_size) }
    }
}

/// Counts the allocations and frees of this thread while it lives.
#[derive(Debug)]
pub struct Count(());

impl Count {
    /// Begins at zero.
    #[must_use]
    pub fn begin() -> Self {
        EVENTS.with(|events| events.set(Some(0)));
        Self(())
    }

    /// Allocations and frees since the beginning.
    #[must_use]
    pub fn end(self) -> u64 {
        EVENTS.with(|events| events.take().unwrap_or(0))
    }
}
