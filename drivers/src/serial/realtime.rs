//! Devices at the other end of real pseudo-terminals, in real time.

use super::fixture::{Device, Trouble, imu_config, number_of};
use super::imu::SerialImu;
use crate::clock::monotonic_ns;
use crate::{ImuReading, ImuSource, StopFlag};
use plumbline_config::Random;
use plumbline_config::options::{ImuDriverConfig, ImuProtocol, SerialLine};
use plumbline_protocol::{MAX_FRAME, Message, Receiver, Time, encode};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::ops::Range;
use std::path::Path;
use std::thread;
use std::time::Duration;

const MS: i64 = 1_000_000;
/// Error allowed of the stamps beyond the lateness of a bare timer, ns.
const TOLERANCE_NS: i64 = 200_000;

/// The end of a pseudo-terminal that a device holds, and the name of the other.
pub(crate) fn terminal() -> (OwnedFd, String) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    rustix::io::ioctl_fionbio(&master, true).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    (master, name)
}

fn open(path: &str, protocol: ImuProtocol, rate_hz: i64, stop: &StopFlag) -> SerialImu {
    let line = SerialLine { device: path.to_owned(), baud: 921_600 };
    let driver = ImuDriverConfig { protocol, ..ImuDriverConfig::default() };
    SerialImu::at(&line, &driver, &imu_config(rate_hz as f64), 20.0, stop.clone()).unwrap()
}

/// A microcontroller is interrupted by a question; here it waits for so long at most, ns.
const NAP_NS: i64 = 100_000;

/// Sleeps up to a little before `due_ns`, and does not sleep any more then; how late it came, ns.
pub(crate) fn wait_until(due_ns: i64, mut meanwhile: impl FnMut()) -> i64 {
    loop {
        meanwhile();
        let left_ns = due_ns - monotonic_ns();
        if left_ns <= 0 {
            return -left_ns;
        }
        if left_ns > 400_000 {
            thread::sleep(Duration::from_nanos((left_ns - 300_000).min(NAP_NS) as u64));
        }
    }
}

/// Player of a device's samples at a terminal.
#[derive(Clone)]
struct Player {
    device: Device,
    trouble: Trouble,
    samples: i64,
    /// In these samples it sends every tenth of a second's worth at once.
    bursts: Range<i64>,
    /// Nothing leaves between these times, ns.
    stall: Range<i64>,
}

/// Result of the player: samples that were hit, and the lateness of a bare timer, ns, sorted.
struct Played {
    hit: Vec<i64>,
    late_ns: Vec<i64>,
}

impl Player {
    fn run(&self, master: &OwnedFd) -> Played {
        let mut played = Played { hit: Vec::new(), late_ns: Vec::new() };
        let mut draws = Random::new(self.trouble.seed);
        let (mut waiting, mut receiver) = (Vec::new(), Receiver::new());
        for k in 0..self.samples {
            let due_ns = self.device.truth_ns(k);
            played.late_ns.push(wait_until(due_ns, || self.answer(master, &mut receiver)));
            let (bytes, is_hit) = self.trouble.pass(k, self.device.frame(k));
            played.hit.extend(is_hit.then_some(k));
            waiting.extend(bytes);
            let is_held_up = self.stall.contains(&monotonic_ns());
            if is_held_up || self.bursts.contains(&k) && k % (self.device.rate_hz / 10) != 0 {
                continue;
            }
            // One frame in ten comes in two pieces.
            if draws.unit() < 0.1 {
                let rest = waiting.split_off(draws.below(waiting.len()));
                send(master, &waiting);
                waiting = rest;
                thread::sleep(Duration::from_micros(150));
            }
            send(master, &waiting);
            waiting.clear();
        }
        played.late_ns.sort_unstable();
        played
    }

    /// Answers questions for the time, as our own protocol has it.
    fn answer(&self, master: &OwnedFd, receiver: &mut Receiver) {
        let mut bytes = [0; 64];
        let Ok(count) = rustix::io::read(master, &mut bytes) else { return };
        let received_ns = self.device.device_ns(monotonic_ns()) as u64;
        for byte in &bytes[..count] {
            if let Some(Ok(Message::AskTime { asked_ns })) = receiver.push(*byte) {
                let sent_ns = self.device.device_ns(monotonic_ns()) as u64;
                let answer = Message::Time(Time { asked_ns, received_ns, sent_ns });
                send(master, encode(&answer, &mut [0; MAX_FRAME]));
            }
        }
    }
}

/// Hands all bytes to the terminal.
pub(crate) fn send(master: &OwnedFd, mut bytes: &[u8]) {
    while !bytes.is_empty() {
        match rustix::io::write(master, bytes) {
            Ok(count) => bytes = &bytes[count..],
            Err(rustix::io::Errno::AGAIN) => {
                let soon = Timespec { tv_sec: 0, tv_nsec: 1_000_000 };
                poll(&mut [PollFd::new(master, PollFlags::OUT)], Some(&soon)).unwrap();
            }
            Err(error) => panic!("{error}"),
        }
    }
}

/// A device plays for seven seconds, with noise, changed and broken frames, frames in pieces, bursts and a stall; none of
/// its samples is lost but those that were hit, and the stamps are right.
fn flies(protocol: ImuProtocol, rate_hz: i64) {
    let (master, name) = terminal();
    let stop = StopFlag::new();
    let mut imu = open(&name, protocol, rate_hz, &stop);
    let device = Device { protocol, rate_hz, start_ns: monotonic_ns() + 50 * MS, skew: 45e-6 };
    let player = Player {
        device,
        trouble: Trouble { seed: 5, noise: 0.02, hit: 0.005 },
        samples: 7 * rate_hz,
        bursts: 5 * rate_hz..6 * rate_hz,
        stall: device.truth_ns(4 * rate_hz)..device.truth_ns(4 * rate_hz) + 200 * MS,
    };
    let (readings, played, allocated) = thread::scope(|scope| {
        let played = scope.spawn(|| {
            let played = player.run(&master);
            // What is on its way still arrives.
            thread::sleep(Duration::from_millis(100));
            stop.stop();
            played
        });
        let mut readings: Vec<(i64, ImuReading)> = Vec::with_capacity(player.samples as usize);
        let mut read = |imu: &mut SerialImu| {
            let reading = imu.next_reading().unwrap();
            readings.extend(reading.map(|reading| (number_of(reading.sample.gyro.x), reading)));
            reading.is_some()
        };
        read(&mut imu);
        let allocated = allocation_counter::measure(|| while read(&mut imu) {});
        (readings, played.join().unwrap(), allocated)
    });
    let numbers: Vec<i64> = readings.iter().map(|(k, _)| *k).collect();
    let (first, last) = (numbers[0], *numbers.last().unwrap());
    let expected: Vec<i64> = (first..=last).filter(|k| !played.hit.contains(k)).collect();
    assert_eq!(numbers, expected, "samples were lost that were not hit");
    assert!(first < 3 * rate_hz / 2 && last >= player.samples - 3, "{first} to {last}");
    assert!(readings.windows(2).all(|w| w[0].1.sample.stamp < w[1].1.sample.stamp));
    assert_eq!(allocated.count_total, 0, "the hot path allocates");
    let mut errors_ns: Vec<i64> = readings
        .iter()
        .filter(|(k, _)| *k >= 3 * rate_hz)
        .map(|(k, reading)| (reading.sample.stamp.as_nanos() - device.truth_ns(*k)).abs())
        .collect();
    errors_ns.sort_unstable();
    let median = |sorted: &[i64]| sorted[sorted.len() / 2];
    let limit_ns = TOLERANCE_NS + median(&played.late_ns);
    let beyond = errors_ns.iter().filter(|error| **error > limit_ns).count();
    println!(
        "{protocol:?} at {rate_hz} Hz: error of stamps {} us in the median, {} at most, {beyond} of {} beyond; a bare timer \
         is {} us late in the median, {} at most; {:?}",
        median(&errors_ns) / 1000,
        errors_ns.last().unwrap() / 1000,
        errors_ns.len(),
        median(&played.late_ns) / 1000,
        played.late_ns.last().unwrap() / 1000,
        imu.figures(),
    );
    assert!(median(&errors_ns) <= limit_ns, "the stamps are wrong by {} us", median(&errors_ns) / 1000);
    assert!(beyond * 50 <= errors_ns.len(), "{beyond} of {} stamps are wrong", errors_ns.len());
}

#[test]
fn a_microcontroller_at_1_khz_loses_nothing_but_what_is_hit_and_is_stamped_by_round_trips() {
    flies(ImuProtocol::Plumbline, 1000);
}

#[test]
fn a_sensor_at_1_khz_loses_nothing_but_what_is_hit_and_is_stamped_by_its_arrivals() {
    flies(ImuProtocol::VectorNav, 1000);
}

#[test]
fn a_sensor_at_200_hz_loses_nothing_but_what_is_hit_and_is_stamped_by_its_arrivals() {
    flies(ImuProtocol::Xsens, 200);
}

/// Samples of a device at the end of a link, for `seconds`; how many readings came in that time.
fn plays_at(link: &Path, imu: &mut SerialImu, device: Device, seconds: i64) -> usize {
    let (master, name) = terminal();
    std::os::unix::fs::symlink(&name, link).unwrap();
    let player = Player {
        device: Device { start_ns: monotonic_ns() + 10 * MS, ..device },
        trouble: Trouble { seed: 5, noise: 0.0, hit: 0.0 },
        samples: seconds * device.rate_hz,
        bursts: 0..0,
        stall: 0..0,
    };
    let end_ns = player.device.truth_ns(player.samples - 1);
    let mut count = 0;
    thread::scope(|scope| {
        scope.spawn(|| player.run(&master));
        while monotonic_ns() < end_ns {
            let reading = imu.next_reading().unwrap().expect("nobody said stop");
            count += 1;
            if reading.sample.stamp.as_nanos() > end_ns - 50 * MS {
                break;
            }
        }
    });
    std::fs::remove_file(link).unwrap();
    count
}

#[test]
fn a_sensor_may_be_missing_at_the_start_and_may_go_away_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("usb-ACME_IMU_0001-if00");
    let stop = StopFlag::new();
    let mut imu = open(link.to_str().unwrap(), ImuProtocol::VectorNav, 200, &stop);
    assert!(!imu.figures().link.is_open);
    let device = Device { protocol: ImuProtocol::VectorNav, rate_hz: 200, start_ns: 0, skew: 1e-5 };
    let first = plays_at(&link, &mut imu, device, 3);
    let second = plays_at(&link, &mut imu, device, 3);
    let figures = imu.figures();
    // A second of settling, a quarter to find it.
    assert!(first > 280 && second > 280, "{first} {second} {figures:?}");
    assert_eq!((figures.link.opened, figures.link.lost), (2, 1));
    assert!(figures.missing > 200, "{figures:?}");
}

#[test]
fn a_sensor_that_is_silent_or_missing_ends_soon_after_it_is_told_to() {
    let (_master, silent) = terminal();
    for path in [silent.as_str(), "/dev/serial/by-id/usb-nobody_has_this"] {
        let stop = StopFlag::new();
        let mut imu = open(path, ImuProtocol::VectorNav, 200, &stop);
        let (ended, told_ns) = thread::scope(|scope| {
            let told = scope.spawn(|| {
                thread::sleep(Duration::from_millis(200));
                stop.stop();
                monotonic_ns()
            });
            (imu.next_reading().unwrap(), told.join().unwrap())
        });
        let took_ms = (monotonic_ns() - told_ns) / MS;
        assert!(ended.is_none() && took_ms < 2 * i64::from(StopFlag::PATIENCE_MS), "{path}: {took_ms} ms");
        assert_eq!(imu.next_reading().unwrap(), None);
    }
}

#[test]
fn what_can_never_be_the_sensor_is_refused_with_the_cure() {
    let refused = |device: &str| {
        let line = SerialLine { device: device.to_owned(), baud: 921_600 };
        let driver = ImuDriverConfig::default();
        SerialImu::at(&line, &driver, &imu_config(200.0), 20.0, StopFlag::new()).err().unwrap().to_string()
    };
    assert!(refused("/dev/null").contains("plumbline devices"), "{}", refused("/dev/null"));
    let (_master, name) = terminal();
    let _first = open(&name, ImuProtocol::Xsens, 200, &StopFlag::new());
    // Root may open what others have for themselves.
    if !rustix::process::geteuid().is_root() {
        assert!(refused(&name).contains("another program has it"));
    }
}
