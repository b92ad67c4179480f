use super::*;
use plumbline_config::Random;

const US: i64 = 1_000;
const MS: i64 = 1_000_000;
const S: i64 = 1_000_000_000;
/// Error allowed of the stamps once the clock is known, ns.
const TOLERANCE_NS: i64 = 200 * US;

/// When a host that looks every so often does so, after the device's measurement, ns.
const LOOKS_NS: i64 = 60 * US;

/// A device and its line, played from a seed.
#[derive(Clone, Copy)]
struct Line {
    rate_hz: i64,
    seconds: i64,
    /// Device seconds per host second, less one.
    skew: f64,
    /// Change of the skew, per second.
    drift: f64,
    /// Resolution of the device's stamps, ns.
    tick_ns: i64,
    /// Mean of the exponential part of the delay, ns.
    jitter_ns: f64,
    /// The host takes what has come every so often only, ns.
    polls_ns: i64,
    /// Nothing comes between these times; then all at once, ns.
    stall: (i64, i64),
}

const QUIET: Line = Line {
    rate_hz: 200,
    seconds: 60,
    skew: 30e-6,
    drift: 0.0,
    tick_ns: 1000,
    jitter_ns: 30_000.0,
    polls_ns: 1,
    stall: (0, 0),
};

impl Line {
    /// Measurement times by the host and by the device, and arrivals, ns.
    fn samples(self, seed: u64) -> impl Iterator<Item = (i64, i64, i64)> {
        let mut draws = Random::new(seed);
        let mut latest = 0;
        (0..self.rate_hz * self.seconds).map(move |k| {
            let truth = 5_000 * S + k * S / self.rate_hz;
            let t = (k * S / self.rate_hz) as f64;
            let gained = self.skew * t + 0.5 * self.drift * t * t * 1e-9;
            let device = (77 * S + k * S / self.rate_hz + gained as i64) / self.tick_ns * self.tick_ns;
            let mut arrival = truth + (-(1.0 - draws.unit()).ln() * self.jitter_ns) as i64;
            // It looks a little after the device has sent.
            let waits = (arrival - LOOKS_NS).rem_euclid(self.polls_ns);
            arrival += (self.polls_ns - waits) % self.polls_ns;
            if (self.stall.0..self.stall.1).contains(&(arrival - 5_000 * S)) {
                arrival = 5_000 * S + self.stall.1;
            }
            latest = arrival.max(latest);
            (truth, device, latest)
        })
    }

    /// Largest error of the stamps from `after_s` on, ns; how many samples were stamped.
    fn worst(self, after_s: i64, seed: u64) -> (i64, usize) {
        let mut clock = DeviceClock::new(false);
        let (mut worst, mut stamped, mut latest) = (0, 0, i64::MIN);
        for (truth, device, arrival) in self.samples(seed) {
            if let Stamped::At(stamp) = clock.sample(device, arrival) {
                assert!(stamp > latest, "stamps rise");
                (latest, stamped) = (stamp, stamped + 1);
                if truth >= (5_000 + after_s) * S {
                    worst = worst.max((stamp - truth).abs());
                }
            }
        }
        assert_eq!(clock.figures().restarts, 0);
        (worst, stamped)
    }
}

#[test]
fn stamps_come_close_in_spite_of_jitter_bursts_and_a_stall() {
    let stalled = Line { stall: (20 * S, 20 * S + 200 * MS), ..QUIET };
    let lines = [
        ("quiet", QUIET),
        ("1 kHz", Line { rate_hz: 1000, ..QUIET }),
        ("stalled", stalled),
        ("stalled early", Line { stall: (1500 * MS, 1700 * MS), ..QUIET }),
        ("bursts of 10", Line { rate_hz: 1000, polls_ns: 10 * MS, ..stalled }),
        ("USB adapter", Line { polls_ns: MS, jitter_ns: 100_000.0, ..stalled }),
        ("latency timer of 16 ms", Line { polls_ns: 16 * MS, ..stalled }),
        ("busy host", Line { jitter_ns: 2e6, rate_hz: 1000, ..stalled }),
        ("slow crystal", Line { skew: -200e-6, ..stalled }),
        ("RC oscillator", Line { skew: 0.01, ..stalled }),
        ("warming up", Line { drift: 0.3e-6, ..stalled }),
        ("coarse stamps", Line { tick_ns: 100 * US, ..stalled }),
    ];
    for (name, line) in lines {
        for seed in 0..3 {
            let (worst, stamped) = line.worst(3, seed);
            assert!(worst < TOLERANCE_NS, "{name}: {} us", worst / US);
            let settling = (line.rate_hz * (line.seconds - 2)) as usize;
            assert!(stamped > settling, "{name}: {stamped} samples");
        }
    }
}

#[test]
fn a_late_arrival_alone_changes_no_stamp() {
    let stamps = |late_ns: i64| {
        let mut clock = DeviceClock::new(false);
        let samples = QUIET.samples(1).enumerate();
        samples
            .map(|(k, (_, device, arrival))| {
                clock.sample(device, arrival + if k == 5000 { late_ns } else { 0 })
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(stamps(0), stamps(3 * MS));
}

/// Feeds a quiet line whose device's clock is changed by `change` from 30 s on; what was stamped after `after_s` and the
/// largest error of it, ns; the figures.
fn set(change: impl Fn(i64) -> i64, after_s: i64) -> (usize, i64, ClockFigures) {
    let mut clock = DeviceClock::new(false);
    let (mut stamped, mut worst) = (0, 0);
    for (truth, device, arrival) in QUIET.samples(3) {
        let device = if truth >= 5_030 * S { change(device) } else { device };
        if let Stamped::At(stamp) = clock.sample(device, arrival)
            && truth >= (5_030 + after_s) * S
        {
            stamped += 1;
            worst = worst.max((stamp - truth).abs());
        }
    }
    (stamped, worst, clock.figures())
}

#[test]
fn a_device_that_was_started_anew_is_learnt_afresh_and_stamps_nothing_wrong() {
    let (stamped, worst, figures) = set(|device| device - 107 * S, 0);
    assert!(worst < TOLERANCE_NS, "{worst}");
    assert!((28 * 200..29 * 200).contains(&stamped), "{stamped}");
    assert_eq!((figures.restarts, figures.refused), (1, 4));
}

#[test]
fn a_clock_that_was_set_forward_is_noticed() {
    let (_, worst, figures) = set(|device| device + 25 * MS, 0);
    assert!(worst < TOLERANCE_NS && figures.restarts == 1, "{worst} {figures:?}");
}

#[test]
fn a_clock_that_was_set_back_a_little_is_noticed_after_a_while() {
    // The first samples go back, those after are only late.
    let (stamped, worst, figures) = set(|device| device - 60 * MS, 12);
    assert!(stamped > 3000 && worst < TOLERANCE_NS && figures.restarts == 1, "{worst} {figures:?}");
}

#[test]
fn single_times_that_make_no_sense_are_refused_and_change_nothing() {
    let mut clock = DeviceClock::new(false);
    let mut refused = 0;
    for (k, (truth, device, arrival)) in QUIET.samples(4).enumerate() {
        let is_wrong = k % 100 == 77;
        let wrong = [device - 9 * S, device + 40 * S, i64::MIN, i64::MAX][k / 100 % 4];
        match clock.sample(if is_wrong { wrong } else { device }, arrival) {
            Stamped::At(stamp) => assert!(!is_wrong && (stamp - truth).abs() < TOLERANCE_NS),
            Stamped::Refused => refused += u64::from(is_wrong),
            Stamped::Settling => assert!(k < 1000),
        }
    }
    assert_eq!((refused, clock.figures().refused, clock.figures().restarts), (120, 120, 0));
}

#[test]
fn after_a_long_silence_the_clock_is_learnt_again_before_anything_is_stamped() {
    let mut clock = DeviceClock::new(false);
    let mut first = None;
    for (truth, device, arrival) in QUIET.samples(5).filter(|s| !(5_020 * S..5_055 * S).contains(&s.0)) {
        if let Stamped::At(stamp) = clock.sample(device, arrival) {
            if truth >= 5_055 * S {
                first.get_or_insert(truth);
            }
            assert!((stamp - truth).abs() < TOLERANCE_NS);
        }
    }
    assert!((5_056 * S..5_057 * S).contains(&first.unwrap()), "{first:?}");
}

/// Ten questions a second, whose ways take at least `ways` and are held up at random.
fn ask(
    clock: &mut DeviceClock,
    truth: i64,
    to_device: impl Fn(i64) -> i64,
    ways: (i64, i64),
    draws: &mut Random,
) -> bool {
    let mut held_up = |least: i64| least + (-(1.0 - draws.unit()).ln() * 300e3) as i64;
    let (there, back) = (held_up(ways.0), held_up(ways.1));
    let device = to_device(truth + there);
    let trip = RoundTrip {
        sent_ns: truth,
        device_received_ns: device,
        device_sent_ns: device,
        received_ns: truth + there + back,
    };
    clock.round_trip(&trip)
}

#[test]
fn round_trips_find_what_arrivals_cannot_know() {
    let mut clock = DeviceClock::new(true);
    let mut draws = Random::new(9);
    // The sensor's filter and the line hold every sample up by 4 ms at least.
    let line = Line { skew: 40e-6, ..QUIET };
    let to_device = |host: i64| 77 * S + (host - 5_000 * S) + (40e-6 * (host - 5_000 * S) as f64) as i64;
    let mut worst = 0;
    for (k, (truth, device, arrival)) in line.samples(6).enumerate() {
        if k % 20 == 3 {
            assert!(ask(&mut clock, truth, to_device, (400 * US, 400 * US), &mut draws));
        }
        if let Stamped::At(stamp) = clock.sample(device, arrival + 4 * MS) {
            // A second of questions is not many: the tolerance is asked for after three.
            let error = (stamp - truth).abs();
            assert!(error < if k < 600 { 2 * MS } else { TOLERANCE_NS }, "{k} {error}");
            worst = worst.max(error);
        }
    }
    assert!(worst > 0 && clock.figures().round_trips == 600);
    assert!((0.8..1.0).contains(&clock.figures().quickest_round_trip_ms.unwrap()));
}

#[test]
fn a_device_that_stops_answering_keeps_the_delay_that_was_learnt() {
    let mut clock = DeviceClock::new(true);
    let mut draws = Random::new(9);
    let to_device = |host: i64| 77 * S + (host - 5_000 * S) + (30e-6 * (host - 5_000 * S) as f64) as i64;
    for (k, (truth, device, arrival)) in QUIET.samples(7).enumerate() {
        if k % 20 == 3 && k < 4000 {
            ask(&mut clock, truth, to_device, (400 * US, 400 * US), &mut draws);
        }
        if let (Stamped::At(stamp), true) = (clock.sample(device, arrival + 4 * MS), k > 600) {
            assert!((stamp - truth).abs() < TOLERANCE_NS, "{k}");
        }
    }
}

#[test]
fn a_device_that_never_answers_is_believed_by_its_arrivals_after_three_seconds() {
    let mut clock = DeviceClock::new(true);
    let first = QUIET
        .samples(8)
        .find(|(_, device, arrival)| matches!(clock.sample(*device, *arrival), Stamped::At(_)));
    assert_eq!(first.unwrap().0, 5_003 * S);
}

#[test]
fn answers_by_another_clock_than_the_samples_are_left_alone() {
    let mut clock = DeviceClock::new(true);
    let mut draws = Random::new(9);
    let to_device = |host: i64| 4 * S + (host - 5_000 * S);
    let mut stamped = 0;
    for (k, (truth, device, arrival)) in QUIET.samples(8).enumerate() {
        if k % 20 == 3 {
            ask(&mut clock, truth, to_device, (400 * US, 400 * US), &mut draws);
        }
        if let Stamped::At(stamp) = clock.sample(device, arrival) {
            assert!((stamp - truth).abs() < TOLERANCE_NS, "{k}");
            stamped += 1;
        }
    }
    assert!(stamped > 11_000, "{stamped}");
}

#[test]
fn answers_that_make_no_sense_are_refused() {
    let mut clock = DeviceClock::new(true);
    clock.sample(0, 0);
    let good = RoundTrip { sent_ns: 0, device_received_ns: 10, device_sent_ns: 10, received_ns: MS };
    assert!(clock.round_trip(&good));
    for bad in [
        RoundTrip { received_ns: -1, ..good },
        RoundTrip { received_ns: S, ..good },
        RoundTrip { device_sent_ns: 9, ..good },
        RoundTrip { device_sent_ns: i64::MAX, ..good },
        good,
    ] {
        assert!(!clock.round_trip(&bad), "{bad:?}");
    }
}

#[test]
fn times_at_the_ends_of_time_do_no_harm() {
    for device in [i64::MIN, -1, 0, i64::MAX] {
        for arrival in [i64::MIN, 0, i64::MAX] {
            let mut clock = DeviceClock::new(false);
            for k in 0..40_i64 {
                clock.sample(device.saturating_add(k * S), arrival.saturating_add(k * S));
                clock.sample(device.saturating_sub(k), arrival);
                clock.round_trip(&RoundTrip {
                    sent_ns: arrival,
                    device_received_ns: device,
                    device_sent_ns: device,
                    received_ns: arrival,
                });
            }
        }
    }
}
