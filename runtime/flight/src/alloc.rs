//! A global allocator that counts how often a thread allocates or frees in a given stretch.
//!
//! Everything is passed on to the system's allocator; the cost is a thread-local addition.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static EVENTS: Cell<u64> = const { Cell::new(0) };
}

/// The counting allocator; the binary installs it.
#[derive(Debug)]
pub struct CountingAllocator;

fn count() {
    // During the end of a thread its locals may be gone: nobody counts there.
    let _ = EVENTS.try_with(|events| events.set(events.get() + 1));
}

// SAFETY: every call is passed on unchanged to the system's allocator, which upholds the contract. Counting touches a
// thread-local `Cell` without destructor.
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

/// Counts the allocations and frees of this thread while it lives. Counts may overlap.
#[derive(Debug)]
pub struct Count(u64);

impl Count {
    /// Begins at zero.
    pub fn begin() -> Self {
        Self(EVENTS.with(Cell::get))
    }

    /// Allocations and frees since the beginning.
    #[must_use]
    pub fn end(self) -> u64 {
        EVENTS.with(Cell::get) - self.0
    }
}
