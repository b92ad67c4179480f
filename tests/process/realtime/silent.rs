//! Clients that take places and say nothing, at a station's server for Foxglove and at a flight's local socket: they make room for new
//! ones, and those that answer stay. Part of `make soak`.

use crate::local::{FLIGHT_S, Flight, connected, costs_the_flight_nothing};
use crate::vehicle::{PLUMBLINE, Running, eventually, free_port};
use plumbline_client::Local;
use plumbline_flight::local::record::Kinds;
use plumbline_flight::local::request::Request;
use plumbline_record::local::content::LocalRecord;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A client that has been silent for five seconds is disconnected.
const MAKES_WAY: Duration = Duration::from_secs(6);
/// Silent ones that knock when the places become free take them all for another five seconds.
const TWO_ROUNDS: Duration = Duration::from_secs(11);
/// Silent clients at a time, of which sixteen find a place.
const SILENT: usize = 40;
/// Length of the siege of a station.
const SIEGE: Duration = Duration::from_secs(60);

/// Opens the web socket of Foxglove; `None` where there is no place.
fn foxglove(address: &str) -> Option<TcpStream> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
    write!(
        stream,
        "GET / HTTP/1.1\r\nHost: {address}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\
         Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
    )
    .ok()?;
    let mut status = [0; 12];
    stream.read_exact(&mut status).ok()?;
    (&status == b"HTTP/1.1 101").then_some(stream)
}

/// Stays and answers as often as it is asked; whether it was there to the end.
fn answers(mut stream: TcpStream, is_over: &AtomicBool) -> bool {
    stream.set_read_timeout(Some(Duration::from_millis(200))).unwrap();
    let mut bytes = [0; 4_096];
    while !is_over.load(Ordering::Relaxed) {
        // A pong of no content, masked.
        if stream.write_all(&[0x8a, 0x80, 0, 0, 0, 0]).is_err() || matches!(stream.read(&mut bytes), Ok(0)) {
            return false;
        }
        std::thread::sleep(Duration::from_millis(500));
    }
    true
}

#[test]
#[ignore = "a minute: `make soak`"]
fn soak_silent_clients_of_foxglove_keep_nobody_out() {
    let (address, listen) = (format!("127.0.0.1:{}", free_port()), format!("tcp/127.0.0.1:{}", free_port()));
    let mut command = Command::new(PLUMBLINE);
    command.args(["ground", "--plain", "--no-http", "--foxglove", &address, "--listen", &listen]);
    let station = Running::start(command);
    let mut first = None;
    eventually("Foxglove is served", Duration::from_secs(20), || {
        first = foxglove(&address);
        first.is_some()
    });
    let (is_over, end) = (AtomicBool::new(false), Instant::now() + SIEGE);
    let (stayed, waits) = std::thread::scope(|scope| {
        let stays = scope.spawn(|| answers(first.unwrap(), &is_over));
        for _ in 0..SILENT {
            // Each comes again some time after it was disconnected, or found no place.
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    let held = foxglove(&address);
                    let begun = Instant::now();
                    while held.is_some()
                        && begun.elapsed() < Duration::from_secs(10)
                        && !is_over.load(Ordering::Relaxed)
                    {
                        std::thread::sleep(Duration::from_millis(100));
                    }
                    std::thread::sleep(Duration::from_secs(5));
                }
            });
        }
        std::thread::sleep(Duration::from_secs(1));
        let mut waits = Vec::new();
        while Instant::now() < end {
            let begun = Instant::now();
            while foxglove(&address).is_none() && begun.elapsed() < 2 * TWO_ROUNDS {
                std::thread::sleep(Duration::from_millis(50));
            }
            waits.push(begun.elapsed());
            std::thread::sleep(Duration::from_millis(200));
        }
        is_over.store(true, Ordering::Relaxed);
        (stays.join().unwrap(), waits)
    });
    let mut waits = waits;
    waits.sort();
    let [longest, usual] = [waits[waits.len() - 1], waits[9 * waits.len() / 10]];
    println!(
        "{} let in, nine in ten within {usual:?}, all within {longest:?}; the one that answers stayed: {stayed}",
        waits.len()
    );
    assert!(stayed && usual < MAKES_WAY && longest < TWO_ROUNDS && waits.len() > 8, "{waits:?}");
    assert!(
        station.words().contains("a client that does not answer was disconnected"),
        "{}",
        station.words()
    );
}

/// Odometry that a new reader receives within so long.
fn reads(socket: &std::path::Path, patience: Duration) -> Option<Duration> {
    let begun = Instant::now();
    while begun.elapsed() < patience {
        let Ok(stream) = UnixStream::connect(socket) else { continue };
        stream.set_read_timeout(Some(Duration::from_secs(1))).unwrap();
        let mut client = Local::over(stream);
        while let Ok(record) = client.next_record() {
            if matches!(record, LocalRecord::Odometry(..)) {
                return Some(begun.elapsed());
            }
        }
    }
    None
}

#[test]
#[ignore = "half a minute: `make soak`"]
fn soak_silent_readers_of_the_local_socket_keep_nobody_out() {
    costs_the_flight_nothing(|| {
        let flight = Flight::new(FLIGHT_S);
        let vehicle = Running::start(flight.command());
        let mut stays = Local::over(connected(&flight.socket()));
        // Who has asked for something gives way after all who have not.
        stays.requests().unwrap().send(&Request::Subscribe(Kinds::SUBSCRIBABLE)).unwrap();
        // It stays if it has had odometry in the flight's last second too.
        let stays = std::thread::spawn(move || {
            let (mut received, mut last) = (0_u64, Instant::now());
            while let Ok(record) = stays.next_record() {
                if matches!(record, LocalRecord::Odometry(..)) {
                    (received, last) = (received + 1, Instant::now());
                }
            }
            (received, last)
        });
        let (is_over, socket) = (AtomicBool::new(false), flight.socket());
        let waits = std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| {
                    let mut silent = std::collections::VecDeque::new();
                    while !is_over.load(Ordering::Relaxed) {
                        silent.extend(UnixStream::connect(&socket));
                        // More than there are places, whichever the server has closed.
                        if silent.len() > 150 {
                            silent.pop_front();
                        }
                        std::thread::sleep(Duration::from_millis(10));
                    }
                });
            }
            let (mut waits, end) = (Vec::new(), Instant::now() + Duration::from_secs(FLIGHT_S.into()) / 2);
            std::thread::sleep(Duration::from_secs(2));
            while Instant::now() < end {
                waits.push(reads(&socket, Duration::from_secs(3)));
                std::thread::sleep(Duration::from_millis(100));
            }
            is_over.store(true, Ordering::Relaxed);
            waits
        });
        let ended = Instant::now();
        let report = flight.finish(vehicle);
        let (received, last) = stays.join().unwrap();
        println!("{waits:?}; the one that reads received {received}");
        assert!(waits.len() > 5 && waits.iter().all(Option::is_some), "{waits:?}");
        assert!(received > 100 * u64::from(FLIGHT_S) && last > ended, "{received}");
        report
    });
}
