//! Figures of a sensor's samples, to be read while it runs.

use super::WatchFigures;
use crate::Faults;
use crate::board::Board;
use crate::clock::{ClockFigures, StampFigures, StampProblem};
use serde::Serialize;

/// Connections of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LinkFigures {
    /// True while the device is open.
    #[serde(skip)]
    pub is_open: bool,
    /// Number of times it was opened.
    pub opened: u64,
    /// Number of times it was lost.
    pub lost: u64,
    /// Error with which it was lost, as the system's number.
    #[serde(skip)]
    pub last_error: Option<i32>,
}

/// Counts of received bytes and frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FramingFigures {
    /// Bytes.
    pub bytes: u64,
    /// Frames with the right checksum.
    pub frames: u64,
    /// Bytes that were part of none: noise, and frames of kinds that do not concern us.
    pub passed_over: u64,
    /// Frames with a wrong checksum.
    pub bad_checksums: u64,
    /// Announced lengths that were absurd.
    pub bad_lengths: u64,
}

/// Figures of the samples of a live sensor, serialized for the report of a flight. The report itself counts
/// the samples that were handed out and lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ImuFigures {
    /// Samples that were handed out.
    #[serde(skip)]
    pub samples: u64,
    /// Samples that came while the clock of the device was being learnt: not handed out.
    pub settling: u64,
    /// Samples out of order of time: not handed out.
    pub disordered: u64,
    /// Samples of a gyroscope without those of its accelerometer around them: not handed out.
    pub unpaired: u64,
    /// Frames with the right checksum whose fields make no sense.
    pub malformed: u64,
    /// Quantity that the device's output lacks, in words.
    #[serde(skip)]
    pub lacking: Option<&'static str>,
    /// Samples that were lost on the way.
    #[serde(skip)]
    pub missing: u64,
    /// Faults of samples.
    #[serde(flatten)]
    pub watch: WatchFigures,
    /// Defect of the device's stamps, if any.
    #[serde(skip)]
    pub stamp_problem: Option<StampProblem>,
    /// Connections of the device.
    #[serde(flatten)]
    pub link: LinkFigures,
    /// The device's clock; at its default where the kernel stamps by the host's.
    pub clock: ClockFigures,
    /// Received bytes and frames of a serial line.
    #[serde(rename = "line")]
    pub framing: FramingFigures,
}

impl ImuFigures {
    /// Stamps of the samples.
    pub fn stamps(&self) -> StampFigures {
        StampFigures { used: self.samples, restamped: 0, refused: self.disordered + self.clock.refused }
    }

    /// Returns the figures as the fault counters that all sources share.
    pub fn faults(&self) -> Faults {
        Faults {
            missing: self.missing,
            corrupt: self.framing.bad_checksums + self.malformed + self.watch.impossible,
            disordered: self.disordered + self.clock.refused,
            unpaired: self.unpaired,
            ..Faults::default()
        }
    }
}

/// The figures of a sensor that runs on another thread, as they were a moment ago.
#[derive(Clone, Debug, Default)]
pub struct ImuMonitor(Board<ImuFigures>);

impl ImuMonitor {
    /// The figures.
    pub fn read(&self) -> ImuFigures {
        self.0.read()
    }
}

/// From one posting to the next, ns.
const PERIOD_NS: i64 = 100_000_000;

/// Puts figures where the monitor finds them, without ever waiting for a reader.
#[derive(Debug, Default)]
pub(crate) struct Post {
    monitor: ImuMonitor,
    due_ns: i64,
}

impl Post {
    pub(crate) fn monitor(&self) -> ImuMonitor {
        self.monitor.clone()
    }

    /// True if figures are due to be posted.
    pub(crate) fn is_due(&self, now_ns: i64) -> bool {
        now_ns >= self.due_ns
    }

    /// Posts the last figures: whoever reads them after the end finds all.
    pub(crate) fn last(&mut self, figures: ImuFigures) {
        self.monitor.0.change(|shown| *shown = figures);
    }

    /// Posts what `figures` gives, some times a second.
    pub(crate) fn put(&mut self, now_ns: i64, figures: impl FnOnce() -> ImuFigures) {
        if !self.is_due(now_ns) {
            return;
        }
        if self.monitor.0.show(figures) {
            self.due_ns = now_ns.saturating_add(PERIOD_NS);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_posted_some_times_a_second_and_never_waited_for() {
        let mut post = Post::default();
        let monitor = post.monitor();
        let of = |samples| move || ImuFigures { samples, ..ImuFigures::default() };
        post.put(0, of(1));
        post.put(PERIOD_NS - 1, of(2));
        assert_eq!(monitor.read().samples, 1);
        // While somebody reads.
        monitor.0.change(|_| post.put(PERIOD_NS, of(3)));
        assert_eq!(monitor.read().samples, 1);
        post.put(PERIOD_NS + 1, of(4));
        assert_eq!(monitor.read().samples, 4);
        post.last(of(5)());
        assert_eq!(monitor.read().samples, 5);
    }
}
