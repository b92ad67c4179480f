//! Whole lines without a device or a clock: what a device sends, what happens on the way, and what comes out.

use super::fixture::{Device, Trouble, imu_config, number_of};
use super::fuzzing::opened;
use super::stream::Stream;
use crate::ImuReading;
use crate::inertial::{ImuFigures, LinkFigures};
use plumbline_config::Random;
use plumbline_config::options::ImuProtocol;

const MS: i64 = 1_000_000;
const S: i64 = 1_000_000_000;
/// Error allowed of the stamps, ns.
const TOLERANCE_NS: i64 = 200_000;
fn stream(device: &Device) -> Stream {
    Stream::new(opened(device.protocol), &imu_config(device.rate_hz as f64), 0)
}

/// Feeds bytes that came at `arrival_ns`, at most `piece` of them at a time.
fn feed(stream: &mut Stream, bytes: &[u8], piece: usize, arrival_ns: i64, mut take: impl FnMut(ImuReading)) {
    for piece in bytes.chunks(piece) {
        stream.space()[..piece.len()].copy_from_slice(piece);
        stream.came(piece.len());
        while let Some(reading) = stream.next(arrival_ns) {
            take(reading);
        }
    }
}

/// Result of a line: readings with the number of their sample, the numbers that were hit, and the figures.
struct Brought {
    readings: Vec<(i64, ImuReading)>,
    hit: Vec<i64>,
    figures: ImuFigures,
}

/// Plays `samples` samples of a device over a line that delivers every `polls_ns`, stands still for 200 ms in the middle,
/// and cuts frames where it likes.
fn play(device: Device, trouble: Trouble, samples: i64, polls_ns: i64) -> Brought {
    let mut stream = stream(&device);
    let mut draws = Random::new(trouble.seed);
    let (mut readings, mut hit, mut waiting) = (Vec::new(), Vec::new(), Vec::new());
    let stall = device.truth_ns(samples / 2)..device.truth_ns(samples / 2) + 200 * MS;
    let mut due_ns = device.start_ns;
    for k in 0..samples {
        let (bytes, is_hit) = trouble.pass(k, device.frame(k));
        hit.extend(is_hit.then_some(k));
        waiting.extend(bytes);
        let now_ns = device.truth_ns(k) + (-(1.0 - draws.unit()).ln() * 30e3) as i64;
        if now_ns < due_ns || stall.contains(&now_ns) {
            continue;
        }
        due_ns = now_ns + polls_ns - device.rate_hz;
        // The end of what waits may be on its way still.
        let kept = if draws.unit() < 0.3 { draws.below(20).min(waiting.len()) } else { 0 };
        let rest = waiting.split_off(waiting.len() - kept);
        let piece = 1 + draws.below(200);
        feed(&mut stream, &waiting, piece, now_ns, |reading| {
            readings.push((number_of(reading.sample.gyro.x), reading));
        });
        waiting = rest;
    }
    Brought { readings, hit, figures: stream.figures(LinkFigures::default()) }
}

#[test]
fn every_sample_that_was_not_hit_comes_out_once_and_is_stamped_by_its_measurement() {
    for which in ImuProtocol::ALL {
        for (rate_hz, polls_ns) in [(200, 0), (1000, 0), (1000, 10 * MS)] {
            // Stamps of 0.1 ms come out once each at this rate: they do not rise otherwise.
            let device = Device { protocol: which, rate_hz, start_ns: 50 * S, skew: 35e-6 };
            let samples = 12 * rate_hz;
            let brought = play(device, Trouble { seed: 1, noise: 0.05, hit: 0.01 }, samples, polls_ns);
            let name = format!("{which:?} at {rate_hz} Hz");
            let first = brought.readings[0].0;
            assert!(first < 4 * rate_hz, "{name}: first {first}");
            let numbers: Vec<i64> = brought.readings.iter().map(|(k, _)| *k).collect();
            let last = *numbers.last().unwrap();
            let expected: Vec<i64> = (first..=last).filter(|k| !brought.hit.contains(k)).collect();
            assert_eq!(numbers, expected, "{name}");
            assert!(last > samples - 40, "{name}: {last}");
            for (k, reading) in &brought.readings {
                assert_eq!(reading.sequence, (k - first) as u64, "{name}");
                let error_ns = reading.sample.stamp.as_nanos() - device.truth_ns(*k);
                let is_converged = *k > 3 * rate_hz;
                assert!(!is_converged || error_ns.abs() < TOLERANCE_NS, "{name}: {k} {error_ns} ns");
            }
            let lost = brought.hit.iter().filter(|k| (first..=last).contains(*k)).count();
            assert_eq!(brought.figures.missing, lost as u64, "{name}");
            assert_eq!(brought.figures.clock.restarts, 0);
        }
    }
}

#[test]
fn a_clean_line_has_no_faults() {
    for which in ImuProtocol::ALL {
        let device = Device { protocol: which, rate_hz: 200, start_ns: 0, skew: -80e-6 };
        let brought = play(device, Trouble { seed: 2, noise: 0.0, hit: 0.0 }, 2400, 0);
        assert_eq!(brought.figures.faults(), crate::Faults::default(), "{which:?}");
        assert_eq!(brought.figures.framing.passed_over, 0, "{which:?}");
        assert_eq!(brought.figures.watch, crate::inertial::WatchFigures::default());
        assert!((brought.figures.clock.skew_ppm - 80.0).abs() < 3.0, "{:?}", brought.figures.clock);
    }
}

#[test]
fn the_delay_of_the_configuration_is_taken_off() {
    let device = Device { protocol: ImuProtocol::VectorNav, rate_hz: 200, start_ns: 0, skew: 0.0 };
    let stamps = |delay_ns: i64| {
        let mut stream = Stream::new(opened(device.protocol), &imu_config(200.0), delay_ns);
        let mut stamps = Vec::new();
        for k in 0..600 {
            feed(&mut stream, &device.frame(k), 99, device.truth_ns(k), |r| {
                stamps.push(r.sample.stamp.as_nanos())
            });
        }
        stamps
    };
    let (as_they_are, delayed) = (stamps(0), stamps(2_500_000));
    assert!(!delayed.is_empty());
    assert!(as_they_are.iter().zip(&delayed).all(|(a, b)| a - b == 2_500_000));
}

#[test]
fn a_device_that_was_started_anew_goes_on_after_a_second_and_its_numbers_rise() {
    let first = Device { protocol: ImuProtocol::Plumbline, rate_hz: 200, start_ns: 100 * S, skew: 20e-6 };
    let second = Device { start_ns: 110 * S, ..first };
    let mut stream = stream(&first);
    let mut readings = Vec::new();
    for device in [first, second] {
        for k in 0..1000 {
            let arrival_ns = device.truth_ns(k) + 50_000;
            feed(&mut stream, &device.frame(k), 99, arrival_ns, |reading| {
                readings.push((arrival_ns, reading))
            });
        }
    }
    assert!(readings.windows(2).all(|w| w[0].1.sequence < w[1].1.sequence));
    assert!(readings.iter().all(|(at, r)| (at - 50_000 - r.sample.stamp.as_nanos()).abs() < TOLERANCE_NS));
    let missing = stream.figures(LinkFigures::default()).missing;
    // Five seconds without a device, one of settling.
    assert!((1195..1215).contains(&missing), "{missing}");
    assert!((1180..1210).contains(&readings.len()), "{}", readings.len());
}

#[test]
fn what_an_output_lacks_is_told_until_it_is_there() {
    use super::fuzzing::vectornav_frame as frame;
    let device = Device { protocol: ImuProtocol::VectorNav, rate_hz: 200, start_ns: 0, skew: 0.0 };
    let mut stream = stream(&device);
    feed(&mut stream, &frame(&[(0, 1 << 3)], &[0; 12]), 99, 0, |_| {});
    assert!(stream.figures(LinkFigures::default()).lacking.unwrap().contains("TimeStartup"));
    feed(&mut stream, &device.frame(0), 99, 0, |_| {});
    assert_eq!(stream.figures(LinkFigures::default()).lacking, None);
}

#[test]
fn nothing_is_allocated_once_a_line_stands() {
    for which in ImuProtocol::ALL {
        let device = Device { protocol: which, rate_hz: 1000, start_ns: 0, skew: 1e-5 };
        let trouble = Trouble { seed: 3, noise: 0.1, hit: 0.05 };
        let sent: Vec<Vec<u8>> = (0..5000).map(|k| trouble.pass(k, device.frame(k)).0).collect();
        let mut stream = stream(&device);
        let mut outgoing = super::protocol::Outgoing::default();
        let mut readings = 0;
        let allocated = allocation_counter::measure(|| {
            for (k, bytes) in sent.iter().enumerate() {
                let now_ns = device.truth_ns(k as i64);
                stream.request(now_ns, &mut outgoing);
                outgoing.clear();
                feed(&mut stream, bytes, 70, now_ns, |_| readings += 1);
            }
        });
        assert!(readings > 3000 || which != ImuProtocol::VectorNav, "{which:?} {readings}");
        assert_eq!(allocated.count_total, 0, "{which:?}");
    }
}
