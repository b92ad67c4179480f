//! Stamps of a flight on the system's clock, which ROS expects, and back.

use plumbline_config::Timestamp;
use plumbline_rings::Stamps;
use plumbline_rings::ticker::Monotonic;

/// Time of a measurement as ROS expects it; recordings keep theirs.
pub(super) fn on_system_clock(stamps: Stamps, measured: Timestamp, now_ns: i64) -> i64 {
    match stamps {
        Stamps::OfHost => now_ns.saturating_sub(Monotonic::now().0.saturating_sub(measured.as_nanos())),
        Stamps::Replayed => measured.as_nanos(),
    }
}

/// Time of a measurement whose stamp in ROS is `stamp_ns`: the inverse of [`on_system_clock`].
pub(super) fn from_system_clock(stamps: Stamps, stamp_ns: i64, now_ns: i64) -> Timestamp {
    Timestamp::from_nanos(match stamps {
        Stamps::OfHost => Monotonic::now().0.saturating_sub(now_ns.saturating_sub(stamp_ns)),
        Stamps::Replayed => stamp_ns,
    })
}
