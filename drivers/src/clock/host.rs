//! The host's clock that all live stamps are of.

use rustix::time::{ClockId, clock_gettime};

/// Now on the host's monotonic clock (CLOCK_MONOTONIC), ns: what the kernel stamps frames of cameras with.
pub fn monotonic_ns() -> i64 {
    let time = clock_gettime(ClockId::Monotonic);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}
