//! Input of a session from the fuzzers: transport messages of Zenoh, as any connected peer can send them.

#[path = "../../../fuzz/hostile.rs"]
pub mod hostile;
#[path = "../../../fuzz/raw_peer.rs"]
pub mod raw_peer;

use crate::net::{Endpoints, Mode};
use raw_peer::{Kind, RawPeer};
use std::io::Read as _;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::runtime::Runtime;
use zenoh::Session;

/// Panics on any thread.
static PANICS: AtomicU64 = AtomicU64::new(0);
/// A session that has not ended a link after so long hangs.
const PATIENCE: Duration = Duration::from_secs(20);

/// Sessions that are reached over the loopback interface: of a vehicle, and of a router that exchanges routes.
struct Target {
    vehicle: SocketAddr,
    router: SocketAddr,
    _sessions: [Session; 2],
    _runtime: Runtime,
}

fn target() -> &'static Target {
    static TARGET: OnceLock<Target> = OnceLock::new();
    TARGET.get_or_init(|| {
        let say = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            PANICS.fetch_add(1, Ordering::SeqCst);
            say(info);
        }));
        let free = || TcpListener::bind("127.0.0.1:0").and_then(|socket| socket.local_addr());
        let [vehicle, router] = [(); 2].map(|()| free().expect("there is a free port"));
        let runtime = Runtime::new().expect("there is a runtime");
        let sessions = [(vehicle, Mode::Peer), (router, Mode::Router)];
        let sessions = sessions.map(|(address, mode)| runtime.block_on(listening(address, mode)));
        Target { vehicle, router, _sessions: sessions, _runtime: runtime }
    })
}

/// A session with what a vehicle declares.
async fn listening(address: SocketAddr, mode: Mode) -> Session {
    let listen = vec![format!("tcp/{address}")];
    let endpoints = Endpoints { mode, listen, routes: mode == Mode::Router, ..Endpoints::default() };
    let session = endpoints.open().await.expect("the port is free");
    let ours = "declarations of our own are sound";
    session.declare_queryable("plumbline/drone/trajectory/**").callback(drop).background().await.expect(ours);
    session.declare_subscriber("plumbline/*/odom").callback(drop).background().await.expect(ours);
    session.declare_queryable("plumbline/drone/command/*").callback(drop).background().await.expect(ours);
    session
}

/// Batches of a peer whose transport is open: for each whether it is a frame's content (odd) or a batch as it is, its length
/// as two bytes (little end first), and its bytes.
///
/// # Panics
/// When a thread of the session panics, when a link does not end, or when the session lets in nobody any more.
pub fn zenoh_transport(data: &[u8]) {
    let Target { vehicle, router, .. } = target();
    for (address, kind) in [(vehicle, Kind::Client), (router, Kind::Client), (router, Kind::Router)] {
        send_batches(*address, kind, data);
    }
}

/// Sends the batches as a peer of this kind, and waits until they are read.
fn send_batches(address: SocketAddr, kind: Kind, data: &[u8]) {
    static ZID: AtomicU64 = AtomicU64::new(1);
    let mut zid = [7; 16];
    zid[..8].copy_from_slice(&ZID.fetch_add(1, Ordering::Relaxed).to_le_bytes());
    let stream = TcpStream::connect(address).expect("somebody listens");
    stream.set_read_timeout(Some(PATIENCE)).expect("sockets have timeouts");
    let mut peer = RawPeer::open(stream, kind, zid).expect("whoever comes is let in");
    let mut rest = data;
    while let Some(([kind, low, high], after)) = rest.split_first_chunk() {
        let length = usize::from(u16::from_le_bytes([*low, *high])).min(after.len()).min(60_000);
        let (bytes, next) = after.split_at(length);
        let sent = if kind % 2 == 1 { peer.send_frame(bytes) } else { peer.send(bytes) };
        if sent.is_err() {
            break;
        }
        rest = next;
    }
    // What was sent has been read when the other side ends the link.
    let _ = peer.stream.shutdown(Shutdown::Write);
    let mut bytes = [0; 1 << 12];
    loop {
        match peer.stream.read(&mut bytes) {
            Ok(1..) => {}
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => panic!("the link does not end"),
            Ok(0) | Err(_) => break,
        }
    }
    assert_eq!(PANICS.load(Ordering::SeqCst), 0, "a thread of the session panicked");
}

#[cfg(test)]
#[path = "../../../fuzz/smoke.rs"]
mod smoke;

// Of which seeds need the way into their folder alone.
#[cfg(test)]
#[allow(dead_code)]
#[path = "../../../fuzz/fixture.rs"]
mod fixture;

#[cfg(test)]
mod tests {
    use super::fixture::put;
    use super::hostile::{self, Hostile, hostile_link_states, link_states};
    use super::raw_peer::declare_key;
    use super::{smoke, zenoh_transport};

    /// Seeds: batches with their kinds and lengths.
    fn input(batches: &[(u8, Vec<u8>)]) -> Vec<u8> {
        let batch = |(kind, bytes): &(u8, Vec<u8>)| {
            [&[*kind][..], &(bytes.len() as u16).to_le_bytes(), bytes].concat()
        };
        batches.iter().flat_map(batch).collect()
    }

    #[test]
    fn malformed_key_expressions_end_the_link_and_nothing_else() {
        for (first, second) in
            [("$*$*", "a"), ("a/$*$*b", "a/b"), ("a//b", "a"), ("/a", "a"), ("a/", "a/b"), ("#", "a")]
        {
            let frames = [(1, declare_key(1, 0, first)), (1, declare_key(2, 0, second))];
            zenoh_transport(&input(&frames));
        }
        // Behind one that is sound.
        for suffix in ["$*", "/$*$*", "b", "//", "/"] {
            let frames =
                [(1, declare_key(1, 0, "a")), (1, declare_key(2, 1, suffix)), (1, declare_key(3, 0, "a/b"))];
            zenoh_transport(&input(&frames));
        }
        zenoh_transport(&input(&[(1, declare_key(1, 0, "plumbline/**")), (1, declare_key(2, 1, "/**"))]));
    }

    #[test]
    fn link_states_that_claim_too_much_end_the_link_and_nothing_else() {
        for body in hostile_link_states() {
            zenoh_transport(&input(&[(1, link_states(&body))]));
        }
    }

    #[test]
    fn lengths_beyond_a_message_end_the_link_and_nothing_else() {
        let mut hostile = Hostile::new(7);
        for _ in 0..300 {
            let frames: Vec<_> = (0..8).map(|_| (1, hostile.message())).collect();
            zenoh_transport(&input(&frames));
        }
    }

    #[test]
    fn fuzz_zenoh_transport() {
        smoke::over_seeds_and_mutations("zenoh_transport", 1_000, zenoh_transport);
    }

    #[test]
    #[ignore = "writes the seeds of the fuzzers"]
    fn fuzz_seeds() {
        let declare = |id, scope, suffix| (1, declare_key(id, scope, suffix));
        put("zenoh_transport", "keys", &input(&[declare(1, 0, "plumbline/drone"), declare(2, 1, "/odom")]));
        put(
            "zenoh_transport",
            "wild",
            &input(&[declare(1, 0, "plumbline/**"), declare(2, 0, "plumbline/$*a/b")]),
        );
        put("zenoh_transport", "malformed", &input(&[declare(1, 0, "$*$*"), declare(2, 0, "a")]));
        // Declarations of a subscriber, a queryable and a token behind a number, a query, an interest, a sign of life, an end.
        let messages: [&[u8]; 7] = [
            &[0x1e, 0x62, 5, 1, 5, b'/', b'o', b'd', b'o', b'm'],
            &[0x1e, 0x64, 6, 1, 4, b'/', b'*', b'/', b'a'],
            &[0x1e, 0x66, 7, 1, 6, b'/', b'a', b'l', b'i', b'v', b'e'],
            &[0x7c, 9, 1, 5, b'/', b'o', b'd', b'o', b'm', 0x03],
            &[0x79, 3, 0x1f, 0, 12, b'p', b'l', b'u', b'm', b'b', b'l', b'i', b'n', b'e', b'/', b'*', b'*'],
            &[0x7d, 1, 5, b'/', b'o', b'd', b'o', b'm', 0x01, 3, 1, 2, 3],
            &[0x1a, 9],
        ];
        let said = messages.map(|message| (1, message.to_vec()));
        let first = declare(1, 0, "plumbline/drone");
        put("zenoh_transport", "all", &input(&[&[first.clone()][..], &said].concat()));
        for (k, message) in said.into_iter().enumerate() {
            put("zenoh_transport", &format!("{k:02}"), &input(&[first.clone(), message]));
        }
        for (k, body) in hostile_link_states().iter().enumerate() {
            put("zenoh_transport", &format!("link_states_{k}"), &input(&[(1, link_states(body))]));
        }
        for (k, message) in hostile::messages().into_iter().enumerate() {
            put("zenoh_transport", &format!("message_{k:02}"), &input(&[(1, message)]));
        }
        put("zenoh_transport", "alive", &input(&[(0, vec![0x04]), (0, vec![0x03, 0])]));
        put(
            "zenoh_transport",
            "fragments",
            &input(&[(0, vec![0x66, 0, 0x1e]), (0, vec![0x26, 1, 0x20, 1, 0, 1, b'a'])]),
        );
    }
}
