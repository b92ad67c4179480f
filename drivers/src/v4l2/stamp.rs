//! Time of an image's measurement: the middle of its exposure, on the monotonic clock of this computer.
//!
//! Drivers stamp a buffer at the start of the exposure or at the end of the frame, and most by the monotonic clock. A
//! flag says so, but it is the same flag where `uvcvideo` was told to take the system clock: so the stamp itself is
//! asked which clock it is near to. One that is near neither, or later than now, is no measurement, and the arrival
//! stands for the end of the frame.

use super::sys::abi::{FLAG_SOURCE_MASK, FLAG_SOURCE_START};
use rustix::time::{ClockId, Timespec, clock_gettime};

/// A stamp this close to a clock is of that clock, ns: images come within a second, and clocks differ by far more.
const NEAR_NS: i64 = 10_000_000_000;
/// A stamp may be this far ahead of the clock, ns: some drivers count in microseconds, or round up.
const AHEAD_NS: i64 = 1_000_000;

/// The clocks of this computer when a buffer arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Arrival {
    /// CLOCK_MONOTONIC, ns.
    pub(crate) monotonic_ns: i64,
    /// CLOCK_REALTIME, ns.
    pub(crate) system_ns: i64,
}

/// The clocks of this computer.
pub(crate) fn clocks() -> Arrival {
    let ns = |id| {
        let Timespec { tv_sec, tv_nsec } = clock_gettime(id);
        tv_sec * 1_000_000_000 + tv_nsec
    };
    Arrival { monotonic_ns: ns(ClockId::Monotonic), system_ns: ns(ClockId::Realtime) }
}

/// Origin of a stamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    /// The driver's, on the monotonic clock.
    Driver,
    /// The driver's, on the system clock, brought to the monotonic one.
    SystemClock,
    /// The arrival, since the driver's makes no sense.
    Arrival,
}

/// Time from a stamp to the middle of the exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Exposure {
    /// Length of the exposure, ns.
    pub(crate) exposure_ns: i64,
    /// From its end to the end of the frame, ns.
    pub(crate) readout_ns: i64,
}

/// The driver's stamp on the monotonic clock, ns, and how it was found.
pub(crate) fn on_monotonic_clock(stamp_ns: i64, at: Arrival) -> (i64, Source) {
    let is_near = |now: i64| {
        let age = now.saturating_sub(stamp_ns);
        (-AHEAD_NS..NEAR_NS).contains(&age)
    };
    if is_near(at.monotonic_ns) {
        (stamp_ns.min(at.monotonic_ns), Source::Driver)
    } else if is_near(at.system_ns) {
        let age = at.system_ns.saturating_sub(stamp_ns).max(0);
        (at.monotonic_ns.saturating_sub(age), Source::SystemClock)
    } else {
        (at.monotonic_ns, Source::Arrival)
    }
}

/// The middle of the exposure, ns of the monotonic clock; `flags` are the buffer's.
pub(crate) fn mid_exposure(stamp_ns: i64, source: Source, flags: u32, exposure: Exposure) -> i64 {
    let Exposure { exposure_ns, readout_ns } = exposure;
    let is_start = source != Source::Arrival && flags & FLAG_SOURCE_MASK == FLAG_SOURCE_START;
    match is_start {
        true => stamp_ns.saturating_add(exposure_ns / 2),
        false => stamp_ns.saturating_sub(readout_ns).saturating_sub(exposure_ns / 2),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Arrival = Arrival { monotonic_ns: 5_000_000_000_000, system_ns: 1_790_000_000_000_000_000 };
    const EXPOSURE: Exposure = Exposure { exposure_ns: 8_000_000, readout_ns: 12_000_000 };

    #[test]
    fn the_middle_of_the_exposure_is_after_its_start_and_before_the_end_of_the_frame() {
        let stamp = NOW.monotonic_ns - 30_000_000;
        let middle = |flags| mid_exposure(stamp, Source::Driver, flags, EXPOSURE) - stamp;
        // V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC, with and without ..._TSTAMP_SRC_SOE.
        assert_eq!(middle(0x2000 | 0x1_0000), 4_000_000);
        assert_eq!(middle(0x2000), -16_000_000);
    }

    #[test]
    fn stamps_of_the_system_clock_are_brought_to_the_monotonic_one() {
        let monotonic = on_monotonic_clock(NOW.monotonic_ns - 7_000_000, NOW);
        assert_eq!(monotonic, (NOW.monotonic_ns - 7_000_000, Source::Driver));
        let system = on_monotonic_clock(NOW.system_ns - 7_000_000, NOW);
        assert_eq!(system, (NOW.monotonic_ns - 7_000_000, Source::SystemClock));
    }

    #[test]
    fn a_stamp_of_no_clock_or_of_the_future_gives_way_to_the_arrival() {
        for nonsense in [0, -5, i64::MAX, i64::MIN, NOW.monotonic_ns + 30_000_000, NOW.monotonic_ns / 2] {
            let (stamp, source) = on_monotonic_clock(nonsense, NOW);
            assert_eq!((stamp, source), (NOW.monotonic_ns, Source::Arrival), "{nonsense}");
            let middle = mid_exposure(stamp, source, 0x1_0000, EXPOSURE);
            assert_eq!(middle, NOW.monotonic_ns - 16_000_000, "an arrival is never the start of an exposure");
        }
        // A microsecond ahead is rounding.
        let (stamp, source) = on_monotonic_clock(NOW.monotonic_ns + 1000, NOW);
        assert_eq!((stamp, source), (NOW.monotonic_ns, Source::Driver));
    }
}
