//! Peers that speak Zenoh without Zenoh, over TLS: they say what no session would, and hear all that comes.

#[path = "../../fuzz/hostile.rs"]
pub mod hostile;
#[path = "../../fuzz/raw_peer.rs"]
pub mod raw_peer;

use super::roles::{attacker, open_router, open_vehicle, with_keys};
use super::supervised::{BACK, client, runtime};
use super::vehicle::{Running, certify, eventually, flight, free_port, render};
use plumbline_link::net::{Endpoints, Mode};
use raw_peer::{Kind, RawPeer, declare_key};
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Length of the flights, which end with their tests, s.
const FLIGHT_S: u32 = 20;
/// Time within which everything sent has arrived.
const QUIET: Duration = Duration::from_secs(2);

/// A TLS connection with the certificate of a role, or with none.
pub fn connect(
    folder: &Path,
    role: Option<&str>,
    port: u16,
) -> std::io::Result<StreamOwned<ClientConnection, TcpStream>> {
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(folder.join("authority.pem")).unwrap()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions().unwrap();
    let config = config.with_root_certificates(roots);
    let config = match role {
        None => config.with_no_client_auth(),
        Some(role) => {
            let certificate = CertificateDer::from_pem_file(folder.join(format!("{role}.pem"))).unwrap();
            let key = PrivateKeyDer::from_pem_file(folder.join(format!("{role}.key"))).unwrap();
            config.with_client_auth_cert(vec![certificate], key).unwrap()
        }
    };
    let name = ServerName::try_from("127.0.0.1").unwrap();
    let connection = ClientConnection::new(Arc::new(config), name).unwrap();
    let stream = TcpStream::connect(("127.0.0.1", port))?;
    stream.set_read_timeout(Some(QUIET))?;
    Ok(StreamOwned::new(connection, stream))
}

/// Opens a vehicle's session in this process; its port.
async fn vehicle(folder: &Path, excluded: &[String]) -> (zenoh::Session, u16) {
    let port = free_port();
    (open_vehicle(folder, &format!("tls/127.0.0.1:{port}"), excluded).await, port)
}

#[test]
fn network_malformed_key_expressions_end_the_link_and_leave_the_session() {
    let folder = with_keys();
    let runtime = runtime();
    let (session, port) = runtime.block_on(vehicle(folder.path(), &[]));
    let stream = connect(folder.path(), Some("viewer"), port).unwrap();
    let mut peer = RawPeer::open(stream, Kind::Client, [5; 16]).unwrap();
    peer.send_frame(&declare_key(1, 0, "$*$*")).unwrap();
    let _ = peer.send_frame(&declare_key(2, 0, "a"));
    while peer.receive().is_ok() {}
    // Who comes next is let in, and the tables are not poisoned.
    let endpoint = format!("tls/127.0.0.1:{port}");
    let operator = runtime.block_on(attacker(folder.path(), "operator", &endpoint));
    let is_asked = runtime.block_on(async {
        let (sender, mut asked) = tokio::sync::mpsc::channel(8);
        let told = move |_| sender.try_send(()).unwrap_or_default();
        session.declare_queryable("plumbline/drone/config").callback(told).background().await.unwrap();
        for _ in 0..50 {
            drop(operator.get("plumbline/drone/config").await.unwrap());
            if tokio::time::timeout(QUIET / 10, asked.recv()).await.is_ok() {
                return true;
            }
        }
        false
    });
    assert!(is_asked);
}

#[test]
fn network_who_has_no_certificate_or_an_excluded_one_gets_no_transport() {
    let folder = with_keys();
    let runtime = runtime();
    let (_session, port) = runtime.block_on(vehicle(folder.path(), &["router".into()]));
    let is_let_in = |role: Option<&str>| {
        let stream = connect(folder.path(), role, port).unwrap();
        RawPeer::open(stream, Kind::Client, [6; 16]).is_ok()
    };
    assert!(is_let_in(Some("viewer")));
    assert!(!is_let_in(Some("router")) && !is_let_in(None));
}

#[test]
fn network_identifiers_of_others_are_not_told() {
    let folder = with_keys();
    let runtime = runtime();
    let (session, port) = runtime.block_on(vehicle(folder.path(), &[]));
    let endpoint = format!("tls/127.0.0.1:{port}");
    let operator = runtime.block_on(attacker(folder.path(), "operator", &endpoint));
    let stream = connect(folder.path(), Some("viewer"), port).unwrap();
    let mut viewer = RawPeer::open(stream, Kind::Peer, [7; 16]).unwrap();
    let mut heard = Vec::new();
    let end = Instant::now() + QUIET;
    while let Ok(batch) = viewer.receive()
        && Instant::now() < end
    {
        heard.extend(batch);
    }
    let tells = |zid: zenoh::config::ZenohId| {
        let bytes = zid.to_le_bytes();
        heard.windows(bytes.len()).any(|part| part == bytes)
    };
    assert!(!tells(operator.zid()), "a viewer that listens is told who the operator is");
    drop(session);
}

/// Questions that want answers which wait for space (`CongestionControl::Block`), in one frame.
fn blocking_questions(first: u64) -> Vec<u8> {
    let ask = |(id, topic): (u64, &str)| {
        let key = format!("plumbline/drone/{topic}");
        let mut message = vec![0xfc];
        message.extend(hostile::number(id));
        message.extend([0, key.len() as u8]);
        message.extend(key.as_bytes());
        message.extend([0x21, 5 | 8, 0x03]);
        message
    };
    let topics = ["config", "clock", "trajectory/**", "config"];
    (first..).zip(topics.iter().cycle().take(40)).flat_map(|(id, topic)| ask((id, topic))).collect()
}

/// Asks without reading, again and again; how often it was let in.
fn ask_and_never_read(port: u16, is_over: &AtomicBool) -> u64 {
    let mut let_in = 0;
    while !is_over.load(Ordering::Relaxed) {
        let Ok(stream) = TcpStream::connect(("127.0.0.1", port)) else { continue };
        stream.set_read_timeout(Some(QUIET)).unwrap();
        stream.set_write_timeout(Some(QUIET)).unwrap();
        let mut zid = [8; 16];
        zid[..8].copy_from_slice(&(let_in + 1_u64).to_le_bytes());
        let Ok(mut peer) = RawPeer::open(stream, Kind::Client, zid) else { continue };
        let_in += 1;
        let mut id = 1;
        while !is_over.load(Ordering::Relaxed) && peer.send_frame(&blocking_questions(id)).is_ok() {
            id += 40;
        }
    }
    let_in
}

#[test]
fn network_a_peer_that_asks_and_does_not_read_delays_no_answer_for_long() {
    render(FLIGHT_S);
    let port = free_port();
    let mut command = flight("drone", FLIGHT_S);
    command.args(["--listen", &format!("tcp/127.0.0.1:{port}")]);
    let vehicle = Running::start(command);
    eventually("it listens", Duration::from_secs(20), || TcpStream::connect(("127.0.0.1", port)).is_ok());
    let is_over = AtomicBool::new(false);
    let runtime = runtime();
    let (let_in, told, longest_s) = std::thread::scope(|scope| {
        let honest = runtime.block_on(client(port));
        let attack = scope.spawn(|| ask_and_never_read(port, &is_over));
        let (begun, mut longest_s, mut told) = (Instant::now(), 0.0_f64, 0);
        let mut last = begun;
        while begun.elapsed() < Duration::from_secs(5) {
            let is_told = runtime.block_on(async {
                let asked = honest.get("plumbline/drone/clock").timeout(QUIET).await;
                let Ok(replies) = asked else { return false };
                replies.recv_async().await.is_ok_and(|reply| reply.into_result().is_ok())
            });
            longest_s = longest_s.max(last.elapsed().as_secs_f64());
            if is_told {
                (told, last) = (told + 1, Instant::now());
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        is_over.store(true, Ordering::Relaxed);
        (attack.join().unwrap(), told, longest_s)
    });
    println!("let in {let_in} times; {told} answers, {longest_s:.2} s between two at most");
    assert!(told > 20 && longest_s < QUIET.as_secs_f64(), "{told} {longest_s}: {}", vehicle.words());
}

/// Opens a router's session in this process; with certificates over TLS.
async fn router(port: u16, keys: Option<&Path>) -> zenoh::Session {
    match keys {
        Some(folder) => open_router(folder, &format!("tls/127.0.0.1:{port}")).await,
        None => {
            let listen = vec![format!("tcp/127.0.0.1:{port}")];
            Endpoints { mode: Mode::Router, listen, ..Endpoints::default() }.open().await.unwrap()
        }
    }
}

/// Opens a transport under somebody else's identifier as soon as a router listens, by `connect`; `None` where its owner was faster.
fn steal<S: Read + Write>(connect: impl Fn() -> std::io::Result<S>, zid: [u8; 16]) -> Option<RawPeer<S>> {
    loop {
        let Ok(stream) = connect() else { continue };
        return RawPeer::open(stream, Kind::Client, zid).ok();
    }
}

/// A thief takes the identifier of a vehicle while its router starts anew; the vehicle is heard again.
fn theft<S: Read + Write + Send + 'static>(
    keys: Option<&Path>,
    connect: fn(u16, Option<&Path>) -> std::io::Result<S>,
    within: Duration,
) {
    render(FLIGHT_S);
    let port = free_port();
    let runtime = runtime();
    let mut router_session = runtime.block_on(router(port, keys));
    let mut command = flight("drone", FLIGHT_S);
    command.args(["--connect", &format!("{}/127.0.0.1:{port}", if keys.is_some() { "tls" } else { "tcp" })]);
    keys.into_iter().for_each(|folder| certify(&mut command, folder));
    let vehicle = Running::start(command);
    let known =
        |session: &zenoh::Session| runtime.block_on(async { session.info().peers_zid().await.next() });
    // It declares its keys once it knows of the link itself.
    let is_alive = |session: &zenoh::Session| {
        let alive = session.liveliness().get("plumbline/drone/alive");
        runtime.block_on(async { alive.await.unwrap().recv_async().await.is_ok() })
    };
    eventually("the vehicle is linked", Duration::from_secs(20), || is_alive(&router_session));
    let thief = (0..5).find_map(|_| {
        let owner = known(&router_session)?.to_le_bytes();
        runtime.block_on(async { router_session.close().await }).unwrap();
        let thief = std::thread::scope(|scope| {
            let thief = scope.spawn(|| steal(|| connect(port, keys), owner));
            router_session = runtime.block_on(router(port, keys));
            thief.join().unwrap()
        });
        if thief.is_none() {
            eventually("the vehicle is linked again", BACK, || is_alive(&router_session));
        }
        thief
    });
    let thief = thief.expect("the vehicle was faster five times");
    let heard =
        runtime.block_on(async { router_session.declare_subscriber("plumbline/drone/odom").await }).unwrap();
    let begun = Instant::now();
    let is_heard = heard.recv_timeout(within).is_ok_and(|sample| sample.is_some());
    println!("odometry {:.2} s after the theft", begun.elapsed().as_secs_f64());
    assert!(is_heard, "{}", vehicle.words());
    drop(thief);
}

/// A thief takes the identifier of a vehicle, by TCP and by TLS; its owner is heard again `within` this time.
pub fn identifiers_are_taken(within: Duration) {
    let by_tcp = |port, _: Option<&Path>| {
        let stream = TcpStream::connect(("127.0.0.1", port))?;
        stream.set_read_timeout(Some(QUIET))?;
        Ok(stream)
    };
    theft(None, by_tcp, within);
    let folder = with_keys();
    theft(Some(folder.path()), |port, keys| connect(keys.unwrap(), Some("viewer"), port), within);
}

#[test]
fn network_a_vehicle_whose_identifier_is_taken_comes_back_under_another() {
    identifiers_are_taken(Duration::from_secs(20));
}
