//! Capture of live sensors: sources that are watched while they are read, and their figures after the flight.
//!
//! A watched source counts and times what it hands out on the thread that reads it, in memory that stands since before the
//! flight, and counts what that thread allocates.

use crate::alloc;
use crate::schedule::ticker::Monotonic;
use crate::schedule::times::{Percentiles, Times};
use parking_lot::Mutex;
use plumbline_config::Timestamp;
use plumbline_drivers::{DriverError, Faults, ImuReading, ImuSource, StereoFrame, StereoSource};
use serde::Serialize;
use std::sync::Arc;

/// Without a sample for so many periods there is a gap.
const GAP_PERIODS: f64 = 1.5;
/// Allocations count from this much data time on, as those of the estimator do, ns.
const WARM_UP_NS: i64 = 2_000_000_000;

/// Figures of a source.
#[derive(Clone, Debug, Serialize)]
pub struct StreamFigures {
    /// Samples, or frames.
    pub count: u64,
    /// Missing by their numbers.
    pub missing: u64,
    /// Number of gaps longer than one and a half periods.
    pub gaps: u64,
    /// The longest of these times, ms.
    pub longest_gap_ms: f64,
    /// Rate from the first to the last, Hz.
    pub rate_hz: f64,
    /// From the time of measurement to when it was handed out, ms.
    pub age_ms: Percentiles,
    /// Allocations and frees on the thread that read it, after two seconds of data.
    pub allocations: u64,
}

/// Counts and times a stream.
#[derive(Debug, Default)]
struct Meter {
    period_ns: f64,
    first: Option<Timestamp>,
    last: Option<(u64, Timestamp)>,
    count: u64,
    missing: u64,
    gaps: u64,
    longest_gap_ns: i64,
    age_ms: Times,
    allocations: u64,
}

impl Meter {
    fn take(&mut self, sequence: u64, stamp: Timestamp, allocations: u64) {
        let first = *self.first.get_or_insert(stamp);
        if let Some((last_sequence, last_stamp)) = self.last {
            self.missing += sequence.saturating_sub(last_sequence).saturating_sub(1);
            let interval_ns = stamp.nanos_since(last_stamp);
            if interval_ns as f64 > GAP_PERIODS * self.period_ns {
                self.gaps += 1;
                self.longest_gap_ns = self.longest_gap_ns.max(interval_ns);
            }
        }
        self.last = Some((sequence, stamp));
        self.count += 1;
        self.age_ms.record(Monotonic::now().ms_since(Monotonic(stamp.as_nanos())).max(0.0));
        if stamp.nanos_since(first) > WARM_UP_NS {
            self.allocations += allocations;
        }
    }

    fn figures(&self) -> StreamFigures {
        let span_s = match (self.first, self.last) {
            (Some(first), Some((_, last))) => last.seconds_since(first),
            _ => 0.0,
        };
        StreamFigures {
            count: self.count,
            missing: self.missing,
            gaps: self.gaps,
            longest_gap_ms: self.longest_gap_ns as f64 * 1e-6,
            rate_hz: if span_s > 0.0 { (self.count - 1) as f64 / span_s } else { 0.0 },
            age_ms: self.age_ms.percentiles(),
            allocations: self.allocations,
        }
    }
}

/// Meter shared with the report; uncontended while the source runs.
#[derive(Clone, Debug)]
pub struct SharedMeter(Arc<Mutex<(Meter, PairCounts)>>);

/// Counts of frames by the images they had.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct PairCounts {
    /// Both.
    pub pairs: u64,
    /// The left one alone.
    pub left_alone: u64,
    /// The right one alone.
    pub right_alone: u64,
}

impl SharedMeter {
    fn new(rate_hz: f64) -> Self {
        Self(Arc::new(Mutex::new((
            Meter { period_ns: 1e9 / rate_hz, ..Meter::default() },
            PairCounts::default(),
        ))))
    }

    /// After the flight: what was brought.
    pub fn figures(&self) -> (StreamFigures, PairCounts) {
        let held = self.0.lock();
        (held.0.figures(), held.1)
    }
}

/// A source that is watched.
pub struct Watched<S: ?Sized> {
    meter: SharedMeter,
    source: Box<S>,
}

impl<S: ?Sized> Watched<S> {
    /// Wraps a source of this rate, and returns the meter of what it delivers.
    pub fn new(source: Box<S>, rate_hz: f64) -> (Self, SharedMeter) {
        let meter = SharedMeter::new(rate_hz);
        (Self { meter: meter.clone(), source }, meter)
    }
}

impl ImuSource for Watched<dyn ImuSource> {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        let counting = alloc::Count::begin();
        let reading = self.source.next_reading()?;
        if let Some(reading) = &reading {
            self.meter.0.lock().0.take(reading.sequence, reading.sample.stamp, counting.end());
        }
        Ok(reading)
    }

    fn faults(&self) -> Faults {
        self.source.faults()
    }
}

impl StereoSource for Watched<dyn StereoSource> {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        let counting = alloc::Count::begin();
        if !self.source.next_frame(frame)? {
            return Ok(false);
        }
        let mut held = self.meter.0.lock();
        held.0.take(frame.sequence, frame.stamp, counting.end());
        let which = match frame.valid {
            [true, true] => &mut held.1.pairs,
            [true, false] => &mut held.1.left_alone,
            _ => &mut held.1.right_alone,
        };
        *which += 1;
        Ok(true)
    }

    fn skip_to(&mut self, stamp: Timestamp) -> u64 {
        self.source.skip_to(stamp)
    }

    fn expected_frames(&self) -> Option<u64> {
        self.source.expected_frames()
    }

    fn faults(&self) -> Faults {
        self.source.faults()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use plumbline_config::ImuSample;

    /// Samples of these numbers and times, ms.
    struct Listed(Vec<(u64, i64)>);

    impl ImuSource for Listed {
        fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
            let Some((sequence, ms)) = self.0.pop() else { return Ok(None) };
            let stamp = Timestamp::from_nanos(ms * 1_000_000);
            let sample = ImuSample { stamp, gyro: Vector3::zeros(), accel: Vector3::zeros() };
            Ok(Some(ImuReading { sequence, sample }))
        }

        fn faults(&self) -> Faults {
            Faults::default()
        }
    }

    #[test]
    fn what_is_missing_and_how_long_nothing_came_is_counted() {
        let listed = Listed(vec![(9, 60), (5, 25), (2, 10), (1, 5), (0, 0)]);
        let (mut watched, meter) = Watched::<dyn ImuSource>::new(Box::new(listed), 200.0);
        while watched.next_reading().unwrap().is_some() {}
        let (figures, _) = meter.figures();
        assert_eq!((figures.count, figures.missing, figures.gaps), (5, 5, 2));
        assert!((figures.longest_gap_ms - 35.0).abs() < 1e-9 && (figures.rate_hz - 4.0 / 0.06).abs() < 1e-9);
    }
}
