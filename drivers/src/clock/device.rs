//! The clock of one device, learnt while its samples come.

use super::envelope::LowerEnvelope;
use super::round_trip::{RoundTrip, RoundTrips};
use plumbline_config::Portable;
use serde::Serialize;

/// Samples are handed out once the arrivals span this, ns; by then the line is good to a few microseconds where the
/// transport is, and to its own jitter where it is not.
const SETTLING_NS: i64 = 1_000_000_000;
/// Samples that are needed for it.
const SETTLING_POINTS: u64 = 20;
/// A device that should answer questions and does not is believed by its arrivals after this, ns.
const UNANSWERED_NS: i64 = 3_000_000_000;

/// An arrival this much before it was possible says that the device's clock was set forward, ns.
const EARLY_NS: i64 = 20_000_000;
/// Limit of [`EARLY_NS`] while the clock is being learnt, ns.
const EARLY_SETTLING_NS: i64 = 500_000_000;
/// Samples of another time that are believed when they agree among themselves.
const BELIEVED: u32 = 4;
/// Spread of the offsets of samples that agree, ns, at most: samples may arrive in a burst.
const AGREEING_NS: i64 = 500_000_000;
/// Lateness limit, ns: when nothing arrives sooner than this after its time for [`PATIENCE_NS`], the device's clock was set
/// back.
const LATE_NS: i64 = 50_000_000;
/// See [`LATE_NS`]; no stall of a host that still runs is as long.
const PATIENCE_NS: i64 = 5_000_000_000;

/// Plausible delay of the promptest samples by round trips, ns: slightly negative where both ways differ.
const ONE_WAY_NS: std::ops::RangeInclusive<i64> = -20_000_000..=500_000_000;

/// Slew limit: a correction moves the stamps by at most one part in this, so that they keep their order and
/// nearly their distance.
const SLEW: i64 = 100;
/// An arrival this much after the promptest is counted as late, ns.
const COUNTED_LATE_NS: i64 = 1_000_000;

/// Outcome of stamping a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stamped {
    /// It was measured at this time of the host's clock, ns.
    At(i64),
    /// The clock is not known well enough yet.
    Settling,
    /// The device's time contradicts those before.
    Refused,
}

/// Estimate of a device's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ClockFigures {
    /// True while samples are handed out.
    #[serde(skip)]
    pub is_settled: bool,
    /// The host's clock less the device's, ns.
    pub offset_ns: i64,
    /// By how much the host's clock runs faster, millionths.
    pub skew_ppm: f64,
    /// Number of times the clock was estimated afresh because the device was restarted or its clock set.
    pub restarts: u64,
    /// Samples whose time made no sense.
    pub refused: u64,
    /// Samples that were there a millisecond or more after the promptest would have been.
    pub late: u64,
    /// The latest of them, ms.
    pub latest_ms: f64,
    /// Questions that were answered.
    pub round_trips: u64,
    /// The quickest answer, ms.
    pub quickest_round_trip_ms: Option<f64>,
}

/// The clock of a device.
#[derive(Clone, Debug, Default)]
pub struct DeviceClock {
    /// True if the device is expected to answer time requests.
    asks: bool,
    /// It did not: once it is started anew it is not waited for again.
    never_answers: bool,
    /// The first sample: its time by the device, and when it was there, ns.
    origin: Option<(i64, i64)>,
    /// Host less device at the arrivals, relative to the origin.
    arrivals: LowerEnvelope,
    trips: RoundTrips,
    /// Delay of the promptest sample beyond its round trips, ns.
    one_way_ns: i64,
    last: (i64, i64),
    handed: Option<Handed>,
    suspects: Suspects,
    patience: Patience,
    figures: ClockFigures,
}

/// Host less device as it was handed out last, at device time `x`, ns.
#[derive(Clone, Copy, Debug)]
struct Handed {
    x: i64,
    y: i64,
    slope: f64,
}

impl Handed {
    fn at(&self, x: i64) -> i64 {
        self.y.saturating_add((self.slope * x.saturating_sub(self.x) as f64).round() as i64)
    }
}

/// Samples of another time.
#[derive(Clone, Copy, Debug, Default)]
struct Suspects {
    count: u32,
    last: Option<(i64, i64)>,
}

/// The least lateness since a time of the host.
#[derive(Clone, Copy, Debug, Default)]
struct Patience {
    since_ns: Option<i64>,
    least_ns: i64,
}

impl DeviceClock {
    /// A clock nothing is known of. With `asks` the device is expected to answer questions for its time, and its
    /// arrivals alone are believed only after a while without.
    pub fn new(asks: bool) -> Self {
        Self { asks, ..Self::default() }
    }

    /// Learns from a sample measured at `device_ns` by its device, which was here at `arrival_ns` by the host.
    pub fn sample(&mut self, device_ns: i64, arrival_ns: i64) -> Stamped {
        let Some(origin) = self.origin else {
            self.begin(device_ns, arrival_ns);
            return Stamped::Settling;
        };
        let x = device_ns.saturating_sub(origin.0);
        let y = arrival_ns.saturating_sub(origin.1).saturating_sub(x);
        let earliest = self.arrivals.line().map_or(self.last.1, |line| line.at(x));
        let early_ns = earliest.saturating_sub(y);
        let limit_ns = if self.figures.is_settled { EARLY_NS } else { EARLY_SETTLING_NS };
        if x <= self.last.0 || early_ns > limit_ns {
            return self.suspect(device_ns, arrival_ns);
        }
        self.suspects = Suspects::default();
        if self.is_set_back(early_ns.saturating_neg(), arrival_ns) {
            self.restart(device_ns, arrival_ns);
            return Stamped::Settling;
        }
        self.arrivals.push(x, y);
        self.last = (x, y);
        self.hand_out(x, origin.1)
    }

    /// Learns from a question and its answer. Whether it was sensible.
    pub fn round_trip(&mut self, trip: &RoundTrip) -> bool {
        // Until there are samples nobody asks for the time.
        let Some(origin) = self.origin else { return true };
        let is_good = self.trips.push(trip, origin);
        self.figures.round_trips += u64::from(is_good);
        self.never_answers &= !is_good;
        self.figures.quickest_round_trip_ms = self.trips.quickest_ns().map(|ns| ns as f64 * 1e-6);
        is_good
    }

    /// Forgets the device: another may be there.
    pub fn forget(&mut self) {
        self.origin = None;
        self.clear();
    }

    /// Present estimate of the device's clock.
    pub fn figures(&self) -> ClockFigures {
        self.figures
    }

    fn begin(&mut self, device_ns: i64, arrival_ns: i64) {
        self.origin = Some((device_ns, arrival_ns));
        self.arrivals.push(0, 0);
        self.last = (0, 0);
    }

    fn clear(&mut self) {
        self.arrivals.clear();
        self.trips.clear();
        self.one_way_ns = 0;
        self.handed = None;
        self.suspects = Suspects::default();
        self.patience = Patience::default();
        self.figures.is_settled = false;
    }

    fn restart(&mut self, device_ns: i64, arrival_ns: i64) {
        self.clear();
        self.begin(device_ns, arrival_ns);
        self.figures.restarts += 1;
    }

    /// A sample of another time: noise that passed its checksum, or the first of a device that was started anew.
    fn suspect(&mut self, device_ns: i64, arrival_ns: i64) -> Stamped {
        self.figures.refused += 1;
        let goes_on = self.suspects.last.is_some_and(|(device, arrival)| {
            let (device_ns, host_ns) = (device_ns.saturating_sub(device), arrival_ns.saturating_sub(arrival));
            device_ns > 0 && device_ns.saturating_sub(host_ns).saturating_abs() < AGREEING_NS
        });
        self.suspects.count = if goes_on { self.suspects.count + 1 } else { 1 };
        self.suspects.last = Some((device_ns, arrival_ns));
        if self.suspects.count >= BELIEVED {
            self.restart(device_ns, arrival_ns);
        }
        Stamped::Refused
    }

    /// True if every sample has been late for so long that the device's clock must have been set back.
    fn is_set_back(&mut self, late_ns: i64, arrival_ns: i64) -> bool {
        if !self.figures.is_settled {
            return false;
        }
        self.figures.late += u64::from(late_ns >= COUNTED_LATE_NS);
        self.figures.latest_ms = self.figures.latest_ms.at_least(late_ns as f64 * 1e-6);
        let since_ns = *self.patience.since_ns.get_or_insert_with(|| {
            self.patience.least_ns = i64::MAX;
            arrival_ns
        });
        self.patience.least_ns = self.patience.least_ns.min(late_ns);
        if arrival_ns.saturating_sub(since_ns) < PATIENCE_NS {
            return false;
        }
        self.patience.since_ns = None;
        self.patience.least_ns > LATE_NS
    }

    fn hand_out(&mut self, x: i64, origin_host_ns: i64) -> Stamped {
        let Some((target, slope)) = self.offset(x) else {
            self.figures.is_settled = false;
            self.handed = None;
            return Stamped::Settling;
        };
        let y = self.handed.map_or(target, |handed| {
            let expected = Handed { slope, ..handed }.at(x);
            let most = x.saturating_sub(handed.x) / SLEW;
            expected.saturating_add(target.saturating_sub(expected).clamp(-most, most))
        });
        self.handed = Some(Handed { x, y, slope });
        let stamp_ns = origin_host_ns.saturating_add(x).saturating_add(y);
        self.figures.is_settled = true;
        self.figures.skew_ppm = slope * 1e6;
        self.figures.offset_ns =
            self.origin.map_or(0, |origin| origin_host_ns.saturating_sub(origin.0).saturating_add(y));
        Stamped::At(stamp_ns)
    }

    /// Host less device at `x`, relative to the origin, and its slope, when it is known.
    fn offset(&mut self, x: i64) -> Option<(i64, f64)> {
        let line = self.arrivals.line()?;
        if self.arrivals.age_ns() < SETTLING_NS || self.arrivals.points() < SETTLING_POINTS {
            return None;
        }
        let promptest = line.at(x);
        if let Some((y, slope)) = self.trips.offset(x) {
            let one_way_ns = promptest.saturating_sub(y);
            // Else the answers are of another clock than the samples.
            if ONE_WAY_NS.contains(&one_way_ns) {
                self.one_way_ns = one_way_ns;
                return Some((y, slope));
            }
        }
        self.never_answers |= x >= UNANSWERED_NS && self.trips.quickest_ns().is_none();
        let waits = self.asks && !self.never_answers && x < UNANSWERED_NS;
        (!waits).then(|| (promptest.saturating_sub(self.one_way_ns), line.slope))
    }
}
