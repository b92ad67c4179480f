//! Attacks of the third round, played without end: messages whose lengths and numbers claim more than there is, sessions that take
//! every place, and handshakes that nobody completes. No router, station or vehicle is deaf for two seconds, and no flight changes.
//! Part of `make soak`.

use super::attacks::{MAX_SILENCE_S, Stage, Survived, command_again_and_again, fly};
use crate::raw;
use crate::raw::hostile::Hostile;
use crate::raw::raw_peer::{Kind, RawPeer};
use crate::roles::with_keys;
use crate::supervised::{
    BACK, RELAYED, STATION, access, client, listening, relayed, runtime, try_session_within,
};
use crate::vehicle::free_port;
use plumbline_test_support::soak_minutes;
use std::io::{Read, Result, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Messages at each target for each minute of the soak: a million in ten minutes.
const MESSAGES_A_MINUTE: u64 = 100_000;
/// Messages of one connection: the first that is malformed ends it, and those behind that one are not read.
const MESSAGES_A_LINK: usize = 8;

/// A connection, with certificates or without.
trait Stream: Read + Write {}
impl<T: Read + Write> Stream for T {}

/// A peer whose transport is open: with a viewer's certificate where there is a folder of them.
fn open(folder: Option<&Path>, port: u16, number: u64) -> Result<RawPeer<Box<dyn Stream>>> {
    let stream: Box<dyn Stream> = match folder {
        Some(folder) => Box::new(raw::connect(folder, Some("viewer"), port)?),
        None => {
            let stream = TcpStream::connect(("127.0.0.1", port))?;
            stream.set_read_timeout(Some(BACK))?;
            Box::new(stream)
        }
    };
    let kind = [Kind::Client, Kind::Peer, Kind::Router][(number % 3) as usize];
    let mut id = [3; 16];
    id[..8].copy_from_slice(&number.to_le_bytes());
    RawPeer::open(stream, kind, id)
}

/// Sends messages of the dictionary until there are so many, or until it is over; the longest time in which nobody was let in, s.
fn send_hostile(
    (folder, port): (Option<&Path>, u16),
    seed: u64,
    sent: &AtomicU64,
    goes_on: impl Fn(u64) -> bool,
) -> f64 {
    let (mut hostile, mut number, mut longest_s, mut let_in) =
        (Hostile::new(seed), 1_u64, 0.0_f64, Instant::now());
    while goes_on(sent.load(Ordering::Relaxed)) {
        number += 1;
        let Ok(mut peer) = open(folder, port, number) else {
            longest_s = longest_s.max(let_in.elapsed().as_secs_f64());
            std::thread::sleep(Duration::from_millis(5));
            continue;
        };
        longest_s = longest_s.max(let_in.elapsed().as_secs_f64());
        for _ in 0..MESSAGES_A_LINK {
            if peer.send_frame(&hostile.message()).is_err() {
                break;
            }
            sent.fetch_add(1, Ordering::Relaxed);
        }
        let_in = Instant::now();
    }
    longest_s
}

fn messages() -> u64 {
    MESSAGES_A_MINUTE * u64::from(soak_minutes())
}

/// Sends all messages at a router or a station, with the certificate of this role or without any.
fn against(arguments: &[&str], role: Option<&str>) {
    let folder = with_keys();
    let (port, who) = (free_port(), role.map(|_| folder.path()));
    let protocol = if role.is_some() { "tls" } else { "tcp" };
    let process = listening(
        arguments,
        protocol,
        port,
        &role.map(|role| access(folder.path(), role)).unwrap_or_default(),
    );
    let (sent, begun) = (AtomicU64::new(0), Instant::now());
    let longest_s = send_hostile((who, port), 1, &sent, |sent| sent < messages());
    let restarts = process.words().matches("starting it again").count();
    println!(
        "{arguments:?} {protocol}: {} messages in {:.0} s, {restarts} restarts, nobody let in for {longest_s:.2} s at most",
        sent.into_inner(),
        begun.elapsed().as_secs_f64()
    );
    assert!(longest_s < BACK.as_secs_f64(), "{arguments:?} {protocol}: {longest_s} s: {}", process.words());
    if arguments[0] == "router" && role.is_none() {
        let heard = runtime().block_on(async {
            let (sender, receiver) = (client(port).await, client(port).await);
            relayed(&sender, &receiver).await
        });
        assert_eq!(heard, RELAYED, "{arguments:?}: {}", process.words());
    }
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_hostile_lengths_make_no_router_deaf() {
    against(&["router"], None);
    against(&["router", "--routes"], None);
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_hostile_lengths_make_no_station_deaf() {
    against(&STATION, None);
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_hostile_lengths_of_a_viewer_make_no_router_deaf() {
    against(&["router"], Some("router"));
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_hostile_lengths_of_a_viewer_make_no_station_deaf() {
    against(&STATION, Some("operator"));
}

/// Flies until the attack has sent all that it has to.
fn against_a_vehicle(stage: &Stage, folder: Option<&Path>) {
    let (sent, is_over) = (AtomicU64::new(0), AtomicBool::new(false));
    let flights: Vec<Survived> = std::thread::scope(|scope| {
        scope.spawn(|| {
            send_hostile((folder, stage.port), 11, &sent, |_| !is_over.load(Ordering::Relaxed));
        });
        let mut flights = Vec::new();
        while flights.is_empty() || sent.load(Ordering::Relaxed) < messages() {
            flights.push(fly(stage, 1));
        }
        is_over.store(true, Ordering::Relaxed);
        flights
    });
    let count = |of: fn(&Survived) -> u64| flights.iter().map(of).sum::<u64>();
    let silence_s = flights.iter().map(|flight| flight.longest_silence_s).fold(0.0, f64::max);
    println!(
        "{}: {} messages, {} flights, {} of them undisturbed and with the same digest, {} deaths of the network process, silent for \
         {silence_s:.2} s at most",
        stage.endpoint,
        sent.load(Ordering::Relaxed),
        count(|flight| flight.flights),
        count(|flight| flight.compared),
        count(|flight| flight.deaths)
    );
    assert!(silence_s < MAX_SILENCE_S, "{flights:?}");
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_hostile_lengths_change_no_flight() {
    against_a_vehicle(&Stage::plain(), None);
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_hostile_lengths_of_a_viewer_change_no_flight() {
    // The attack takes the places of the viewer's certificate.
    let stage = Stage { watcher: "operator", ..Stage::new() };
    against_a_vehicle(&stage, Some(stage.folder.path()));
}

/// Sessions of a viewer that are held for as long as they last, from as many threads as there are places twice over.
fn hold_sessions(folder: &Path, port: u16, thread: u64, is_over: &AtomicBool) -> u64 {
    let mut held = 0;
    for k in 0_u64.. {
        if is_over.load(Ordering::Relaxed) {
            break;
        }
        match open(Some(folder), port, thread << 32 | k << 2) {
            Ok(mut peer) => {
                held += 1;
                // Silent until it is ended for that.
                while !is_over.load(Ordering::Relaxed) && peer.receive().is_ok() {}
            }
            Err(_) => std::thread::sleep(Duration::from_millis(20)),
        }
    }
    held
}

/// Threads that take places.
const THREADS: u64 = 64;

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_sessions_of_a_viewer_keep_no_operator_out() {
    let stage = Stage { watcher: "operator", ..Stage::new() };
    let is_over = AtomicBool::new(false);
    let (survived, held, operator) = std::thread::scope(|scope| {
        let threads: Vec<_> = (1..=THREADS)
            .map(|thread| {
                scope.spawn({
                    let (stage, is_over) = (&stage, &is_over);
                    move || hold_sessions(stage.folder.path(), stage.port, thread, is_over)
                })
            })
            .collect();
        let operator =
            scope.spawn(|| command_again_and_again(stage.folder.path(), &stage.endpoint, &is_over));
        let survived = fly(&stage, soak_minutes().div_ceil(3));
        is_over.store(true, Ordering::Relaxed);
        let held: u64 = threads.into_iter().map(|thread| thread.join().unwrap()).sum();
        (survived, held, operator.join().unwrap())
    });
    println!("{held} sessions held, {operator:?}: {survived:?}");
    // One question in two seconds at least: half a second of pause, and the handshake on a busy host.
    assert!(held > 8 && operator.told * 2 >= survived.flights * 40, "{held} {operator:?} {survived:?}");
    assert!(operator.kept_out * 4 <= operator.told, "{held} {operator:?} {survived:?}");
    assert!(survived.deaths == 0, "{survived:?}");
}

/// An honest peer is let in within this time whatever the flood.
const FLOODED: Duration = Duration::from_secs(10);

/// Holds connections that begin a handshake and say no more, more than there are places for.
fn hold_begun(port: u16, is_over: &AtomicBool) {
    while !is_over.load(Ordering::Relaxed) {
        let begun = |k: u16| {
            let mut stream = TcpStream::connect(("127.0.0.1", port)).ok()?;
            if k.is_multiple_of(2) {
                let init = [&[19, 0, 0x01, 9, 0xf0 | Kind::Client as u8][..], &[9; 16]].concat();
                stream.write_all(&init).ok()?;
            }
            Some(stream)
        };
        let held: Vec<_> = (0..200).filter_map(begun).collect();
        std::thread::sleep(Duration::from_millis(200));
        drop(held);
    }
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_handshakes_without_end_keep_nobody_out() {
    let stage = Stage::plain();
    let (is_over, slowest) = (AtomicBool::new(false), AtomicU64::new(0));
    let (survived, tried, refused) = std::thread::scope(|scope| {
        scope.spawn(|| hold_begun(stage.port, &is_over));
        let honest = scope.spawn(|| {
            let (runtime, mut tried, mut refused) = (runtime(), 0_u64, 0_u64);
            std::thread::sleep(Duration::from_secs(5));
            while !is_over.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(300));
                // Between two flights there is nobody to reach.
                if TcpStream::connect(("127.0.0.1", stage.port)).is_err() {
                    continue;
                }
                tried += 1;
                match try_session_within(&runtime, &stage.endpoint, FLOODED) {
                    Some(took) => drop(slowest.fetch_max(took.as_millis() as u64, Ordering::Relaxed)),
                    None if TcpStream::connect(("127.0.0.1", stage.port)).is_ok() => refused += 1,
                    None => {}
                }
            }
            (tried, refused)
        });
        let survived = fly(&stage, soak_minutes().div_ceil(3));
        is_over.store(true, Ordering::Relaxed);
        let (tried, refused) = honest.join().unwrap();
        (survived, tried, refused)
    });
    let slowest_s = slowest.into_inner() as f64 * 1e-3;
    println!("{tried} honest sessions, {refused} refused, the slowest after {slowest_s:.2} s: {survived:?}");
    assert!(tried > 20 && refused == 0 && survived.deaths == 0, "{survived:?}");
    assert!(survived.longest_silence_s < MAX_SILENCE_S, "{survived:?}");
}
