//! The bridge itself: its thread, its socket and the host's clock, in a flight in real time.

use super::capture::{Captured, Tap, opened};
use mavlink::dialects::common::{MavMessage, ODOMETRY_DATA};
use mavlink::{MavlinkReader, MavlinkVersion};
use plumbline_config::Timestamp;
use plumbline_estimator::Odometry;
use plumbline_flight::autopilot::Bridge;
use plumbline_flight::flight::{Truth, fly};
use plumbline_flight::pipeline::{Control, RunOptions, Stamps};
use plumbline_flight::schedule::ticker::Monotonic;
use plumbline_simulator::Scenario;
use std::net::UdpSocket;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Flies `scenario` in real time with the bridge on a UDP socket; frames are kept in `frames`.
pub fn capture_live(scenario: &Scenario, frames: &Path) -> Captured {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    let mut flight = opened(scenario, Some(frames));
    let address = socket.local_addr().unwrap();
    let set = |c: &mut plumbline_config::Config| c.autopilot.connect = format!("udp://{address}");
    flight.config = flight.config.with("test", set).unwrap();
    let config = flight.config.clone();
    let mut tap = Tap::new(&config);
    let is_over = AtomicBool::new(false);
    let (flown, arrived) = std::thread::scope(|scope| {
        let receiver = scope.spawn(|| received(&socket, &is_over));
        let mut bridge = Bridge::start(&config.autopilot, &config.vehicle, Stamps::Replayed, false).unwrap();
        let options = RunOptions { speed: Some(1.0), threads: 4 };
        let flown = fly(flight, &options, &Control::default(), vec![&mut bridge, &mut tap]).unwrap();
        bridge.stop().unwrap();
        is_over.store(true, Ordering::Relaxed);
        (flown, receiver.join().unwrap())
    });
    let Truth::Simulated(simulator) = flown.truth else { panic!("a simulated flight") };
    let (samples, odometry, _) = tap.into_parts();
    let offset_ns = offset_ns(&arrived, &odometry);
    let messages = arrived.into_iter().map(|(at, mut message)| {
        message.time_usec = (message.time_usec as i64 + offset_ns / 1000) as u64;
        (Timestamp::from_nanos(at.0 + offset_ns), message)
    });
    let messages = messages.collect();
    Captured { config, simulator, samples, odometry, messages }
}

/// Messages, and when they arrived.
fn received(socket: &UdpSocket, is_over: &AtomicBool) -> Vec<(Monotonic, ODOMETRY_DATA)> {
    let mut all = Vec::new();
    while !is_over.load(Ordering::Relaxed) {
        let mut bytes = [0; 2048];
        let Ok(count) = socket.recv(&mut bytes) else { continue };
        let at = Monotonic::now();
        let mut reader = MavlinkReader::new(&bytes[..count]);
        if let Ok((_, MavMessage::ODOMETRY(message))) = reader.read_message::<MavMessage>(MavlinkVersion::V2)
        {
            all.push((at, message));
        }
    }
    all
}

/// From the clock of the host to the stamps of the flight: a message carries the speed of one odometry, to the last bit of it.
fn offset_ns(arrived: &[(Monotonic, ODOMETRY_DATA)], odometry: &[Odometry]) -> i64 {
    let speed = |m: &ODOMETRY_DATA| f64::from(m.vx).hypot(f64::from(m.vy)).hypot(f64::from(m.vz));
    let tracking = arrived.iter().map(|(_, message)| message).filter(|m| m.quality > 0);
    let mut offsets: Vec<i64> = tracking
        .map(|message| {
            let off = |o: &Odometry| (o.v_o_b.norm() - speed(message)).abs();
            let same = odometry.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
            same.stamp.as_nanos() - message.time_usec as i64 * 1000
        })
        .collect();
    offsets.sort_unstable();
    offsets[offsets.len() / 2]
}
