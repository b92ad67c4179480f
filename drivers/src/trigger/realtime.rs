//! A microcontroller at a real pseudo-terminal that triggers cameras, and a program that sends their frames over a real
//! socket, in real time.

use super::source::{Exposure, Triggered};
use crate::clock::monotonic_ns;
use crate::frame_socket::{FrameHeader, SocketStereo};
use crate::serial::SerialImu;
use crate::serial::realtime::{send, terminal, wait_until};
use crate::serial::simulated::{Device, imu_config};
use crate::{ImuSource as _, StereoFrame, StereoSource as _, StopFlag};
use plumbline_config::Random;
use plumbline_config::options::{ImuDriverConfig, ImuProtocol, SerialLine};
use plumbline_protocol::{MAX_FRAME, Message, Receiver, Time, Trigger, encode};
use rustix::fd::OwnedFd;
use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::thread;
use std::time::Duration;

const MS: i64 = 1_000_000;
const RATE_HZ: i64 = 200;
/// Samples from one trigger to the next.
const EVERY: i64 = 10;
const TRIGGERS: i64 = 130;
const PULSE_NS: u32 = 4_000_000;
const HALF_NS: i64 = 2 * MS;
const SIZES: [(usize, usize); 2] = [(64, 48), (0, 0)];
/// Error allowed of the stamps beyond the lateness of a bare timer, ns.
const TOLERANCE_NS: i64 = 200_000;
/// The program that sends frames is away.
const AWAY: std::ops::Range<i64> = 80..95;
/// A frame that the camera loses without counting it.
const NOT_COUNTED: i64 = 112;

/// Samples and triggers in real time; some messages of triggers are lost.
fn run_microcontroller(device: Device, master: &OwnedFd) -> Vec<i64> {
    let (mut receiver, mut late_ns) = (Receiver::new(), Vec::new());
    for k in 0..TRIGGERS * EVERY {
        late_ns.push(wait_until(device.truth_ns(k), || answer(device, master, &mut receiver)));
        let n = k / EVERY;
        if k % EVERY == 0 && n % 7 != 3 {
            let time_ns = device.device_ns(device.truth_ns(k)) as u64;
            let trigger = Trigger { counter: n as u32, time_ns, pulse_ns: PULSE_NS, cameras: 1 };
            send(master, encode(&Message::Trigger(trigger), &mut [0; MAX_FRAME]));
        }
        send(master, &device.frame(k));
    }
    late_ns.sort_unstable();
    late_ns
}

fn answer(device: Device, master: &OwnedFd, receiver: &mut Receiver) {
    let mut bytes = [0; 64];
    let Ok(count) = rustix::io::read(master, &mut bytes) else { return };
    let received_ns = device.device_ns(monotonic_ns()) as u64;
    for byte in &bytes[..count] {
        if let Some(Ok(Message::AskTime { asked_ns })) = receiver.push(*byte) {
            let sent_ns = device.device_ns(monotonic_ns()) as u64;
            send(
                master,
                encode(&Message::Time(Time { asked_ns, received_ns, sent_ns }), &mut [0; MAX_FRAME]),
            );
        }
    }
}

/// Frames that arrive 12 to 20 ms after the middle of their exposure and are stamped by that; some are lost.
fn run_camera(device: Device, path: &Path) {
    let mut draws = Random::new(3);
    let (mut sender, mut number) = (UnixStream::connect(path).ok(), 1000);
    for n in 0..TRIGGERS {
        let late_ns = 12 * MS + (draws.unit() * 8e6) as i64;
        wait_until(device.truth_ns(n * EVERY) + HALF_NS + late_ns, || {});
        number += u64::from(n != NOT_COUNTED);
        if AWAY.contains(&n) {
            (sender, number) = (None, 0);
            continue;
        }
        let sender = sender.get_or_insert_with(|| UnixStream::connect(path).unwrap());
        if n % 11 == 5 || n == NOT_COUNTED {
            continue;
        }
        let header = FrameHeader { sequence: number, stamp_ns: monotonic_ns(), sizes_px: [(64, 48), (0, 0)] };
        sender.write_all(&header.encode()).unwrap();
        sender.write_all(&[n as u8; 64 * 48]).unwrap();
    }
}

/// Reads frames; which trigger each was of by its pixels, and its stamp, ns.
fn read(source: &mut Triggered<SocketStereo>, frame: &mut StereoFrame) -> Option<(i64, i64)> {
    source
        .next_frame(frame)
        .unwrap()
        .then(|| (i64::from(frame.images[0].pixels()[0]), frame.stamp.as_nanos()))
}

#[test]
fn frames_of_triggered_cameras_are_stamped_by_the_edge_whatever_becomes_of_them_on_the_way() {
    let folder = tempfile::tempdir().unwrap();
    let (path, (master, name), stop) = (folder.path().join("frames"), terminal(), StopFlag::new());
    let line = SerialLine { device: name, baud: 921_600 };
    let driver = ImuDriverConfig { trigger_cameras: true, ..ImuDriverConfig::default() };
    let mut imu = SerialImu::at(&line, &driver, &imu_config(RATE_HZ as f64), 20.0, stop.clone()).unwrap();
    let socket = SocketStereo::open(&path, SIZES, 20.0, stop.clone()).unwrap();
    let mut source = Triggered::new(socket, imu.take_triggers().unwrap(), Exposure::Pulse(None), 20.0);
    let (monitor, mut frame) = (source.monitor(), StereoFrame::new(SIZES));
    let device = Device {
        protocol: ImuProtocol::Plumbline,
        rate_hz: RATE_HZ,
        start_ns: monotonic_ns() + 50 * MS,
        skew: 45e-6,
    };
    let (stamps, allocated, late_ns) = thread::scope(|scope| {
        let microcontroller = scope.spawn(|| run_microcontroller(device, &master));
        scope.spawn(|| {
            run_camera(device, &path);
            thread::sleep(Duration::from_millis(100));
            stop.stop();
        });
        scope.spawn(|| while imu.next_reading().unwrap().is_some() {});
        let mut stamps = Vec::with_capacity(TRIGGERS as usize);
        stamps.extend(read(&mut source, &mut frame));
        let allocated = allocation_counter::measure(|| {
            while let Some(stamp) = read(&mut source, &mut frame) {
                stamps.push(stamp);
            }
        });
        (stamps, allocated.count_total, microcontroller.join().unwrap())
    });
    let figures = monitor.figures();
    let errors_ns: Vec<(i64, i64)> =
        stamps.iter().map(|(n, stamp_ns)| (*n, stamp_ns - device.truth_ns(n * EVERY) - HALF_NS)).collect();
    let median_late_ns = late_ns[late_ns.len() / 2];
    let limit_ns = TOLERANCE_NS + median_late_ns;
    let mut of_triggers: Vec<i64> =
        errors_ns.iter().filter(|(n, _)| *n >= 60).map(|(_, error)| error.abs()).collect();
    of_triggers.sort_unstable();
    println!(
        "{figures:?}; errors {} us in the median, {} at most, a bare timer {} us late; {:?}",
        of_triggers[of_triggers.len() / 2] / 1000,
        of_triggers[of_triggers.len() - 1] / 1000,
        median_late_ns / 1000,
        imu.figures().clock
    );
    assert_eq!(allocated, 0, "the hot path allocates");
    // At the start, after the camera was away, and after the frame that was not counted.
    assert_eq!((figures.found, figures.by_driver), (3, 0), "{figures:?}");
    assert!(figures.predicted >= 8 && figures.by_delay <= 14 && figures.doubtful <= 3, "{figures:?}");
    let wrong = of_triggers.iter().filter(|error| **error > limit_ns).count() as u64;
    assert!(wrong <= figures.by_delay + 2, "{errors_ns:?}");
    assert!(
        of_triggers.iter().all(|error| *error < 12 * MS),
        "a frame has the stamp of another: {errors_ns:?}"
    );
}
