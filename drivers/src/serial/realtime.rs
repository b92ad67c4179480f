//! Devices at the other end of real pseudo-terminals, in real time.

use super::fixture::{Device, imu_config};
use super::imu::SerialImu;
use crate::clock::monotonic_ns;
use crate::{ImuSource, StopFlag};
use plumbline_config::options::{ImuDriverConfig, ImuProtocol, SerialLine};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::path::Path;
use std::thread;
use std::time::Duration;

const MS: i64 = 1_000_000;

/// The end of a pseudo-terminal that a device holds, and the name of the other.
fn terminal() -> (OwnedFd, String) {
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

/// Sleeps up to a little before `due_ns`, and does not sleep any more then.
fn wait_until(due_ns: i64) {
    let mut left_ns = due_ns - monotonic_ns();
    while left_ns > 0 {
        if left_ns > 400_000 {
            thread::sleep(Duration::from_nanos((left_ns - 300_000) as u64));
        }
        left_ns = due_ns - monotonic_ns();
    }
}

/// Hands all bytes to the terminal.
fn send(master: &OwnedFd, mut bytes: &[u8]) {
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

/// Samples of a device at the end of a link, for `seconds`; how many readings came in that time.
fn plays_at(link: &Path, imu: &mut SerialImu, device: Device, seconds: i64) -> usize {
    let (master, name) = terminal();
    std::os::unix::fs::symlink(&name, link).unwrap();
    let device = Device { start_ns: monotonic_ns() + 10 * MS, ..device };
    let samples = seconds * device.rate_hz;
    let end_ns = device.truth_ns(samples - 1);
    let mut count = 0;
    thread::scope(|scope| {
        scope.spawn(|| {
            for k in 0..samples {
                wait_until(device.truth_ns(k));
                send(&master, &device.frame(k));
            }
        });
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
