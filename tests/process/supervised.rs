//! Routers and stations whose worker dies are back at once, and no message of a peer makes them deaf.

use super::local::children;
use super::raw::hostile::{hostile_link_states, link_states};
use super::raw::raw_peer::{Kind, RawPeer};
use super::roles::{attacker, make_keys, try_to_connect, with_keys};
use super::vehicle::{PLUMBLINE, Running, eventually, free_port};
use super::{raw, stderr};
use plumbline_link::net::{Endpoints, Mode};
use std::net::TcpStream;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use zenoh::Session;

/// A restart takes no longer.
pub const BACK: Duration = Duration::from_secs(2);
/// Messages that are relayed to find out that a router hears.
pub const RELAYED: u64 = 20;

pub fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap()
}

/// Options of a role's certificates.
pub fn access(folder: &Path, role: &str) -> Vec<String> {
    let file = |name: String| folder.join(name).display().to_string();
    let authority = ["--authority".into(), file("authority.pem".into())];
    let own =
        ["--certificate".into(), file(format!("{role}.pem")), "--key".into(), file(format!("{role}.key"))];
    authority.into_iter().chain(own).collect()
}

/// A command that listens at this port.
pub fn listening(arguments: &[&str], protocol: &str, port: u16, access: &[String]) -> Running {
    let mut command = Command::new(PLUMBLINE);
    command.args(arguments).args(["--listen", &format!("{protocol}/127.0.0.1:{port}")]).args(access);
    let process = Running::start(command);
    eventually("it listens", Duration::from_secs(20), || is_open(port));
    process
}

pub const STATION: [&str; 3] = ["ground", "--no-http", "--plain"];

fn is_open(port: u16) -> bool {
    TcpStream::connect(("127.0.0.1", port)).is_ok()
}

fn signal(process: u32, name: &str) {
    assert!(Command::new("kill").args([name, &process.to_string()]).status().unwrap().success());
}

#[test]
fn network_a_worker_that_dies_is_back_within_two_seconds() {
    for (arguments, deadly) in [(&["router"][..], "-KILL"), (&STATION, "-ABRT"), (&["router"], "-ILL")] {
        let port = free_port();
        let mut process = listening(arguments, "tcp", port, &[]);
        let first = children(process.child.id());
        assert_eq!(first.len(), 1, "{arguments:?}: one worker");
        let died = Instant::now();
        signal(first[0], deadly);
        eventually("another worker listens", BACK, || {
            let now = children(process.child.id());
            now.len() == 1 && now != first && is_open(port)
        });
        println!("{arguments:?} {deadly}: back after {:.2} s", died.elapsed().as_secs_f64());
        assert!(process.words().contains("starting it again"), "{}", process.words());
        let second = children(process.child.id());
        signal(process.child.id(), "-TERM");
        eventually("it ends on a signal", Duration::from_secs(5), || {
            process.child.try_wait().unwrap().is_some()
        });
        assert_eq!(process.child.wait().unwrap().code(), Some(0), "{}", process.words());
        assert!(!Path::new(&format!("/proc/{}", second[0])).exists(), "its worker ends with it");
    }
}

#[test]
fn network_a_worker_ends_with_its_supervisor() {
    let port = free_port();
    let mut router = listening(&["router"], "tcp", port, &[]);
    let worker = children(router.child.id())[0];
    router.kill();
    eventually("the worker has ended", BACK, || {
        !Path::new(&format!("/proc/{worker}")).exists() || is_zombie(worker)
    });
    // The first of its threads to end makes a process a zombie, the last one closes its port.
    eventually("its port is closed", BACK, || !is_open(port));
}

fn is_zombie(process: u32) -> bool {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    status.contains("State:\tZ")
}

/// A session that relays through the router: what it sends to itself and hears of that.
pub async fn relayed(sender: &Session, receiver: &Session) -> u64 {
    let heard = Arc::new(AtomicU64::new(0));
    let theirs = Arc::clone(&heard);
    let note = move |_| {
        theirs.fetch_add(1, Ordering::Relaxed);
    };
    let subscriber = receiver.declare_subscriber("plumbline/drone/odom").callback(note).await.unwrap();
    tokio::time::sleep(Duration::from_millis(500)).await;
    for _ in 0..RELAYED {
        sender.put("plumbline/drone/odom", "here").await.unwrap();
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    let end = Instant::now() + BACK;
    while heard.load(Ordering::Relaxed) < RELAYED && Instant::now() < end {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    drop(subscriber.undeclare().await);
    heard.load(Ordering::Relaxed)
}

/// A client without certificates.
pub async fn client(port: u16) -> Session {
    try_client(port).await.unwrap()
}

/// Tries to open the session of a client without certificates.
pub async fn try_client(port: u16) -> zenoh::Result<Session> {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"client\"".to_owned()),
        ("connect/endpoints", format!("[\"tcp/127.0.0.1:{port}\"]")),
        ("scouting/multicast/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    zenoh::open(config).await
}

/// Sends each hostile list of link states from a peer of each kind, over plain TCP or as a viewer.
fn send_link_states(port: u16, folder: Option<&Path>) {
    for (k, body) in hostile_link_states().into_iter().enumerate() {
        for kind in [Kind::Client, Kind::Peer, Kind::Router] {
            let zid = [k as u8 + 1, kind as u8 + 1, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9];
            let message = link_states(&body);
            match folder {
                Some(folder) => {
                    let stream = raw::connect(folder, Some("viewer"), port).unwrap();
                    let mut peer = RawPeer::open(stream, kind, zid).unwrap();
                    let _ = peer.send_frame(&message);
                }
                None => {
                    let stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
                    let mut peer = RawPeer::open(stream, kind, zid).unwrap();
                    let _ = peer.send_frame(&message);
                }
            }
        }
    }
    std::thread::sleep(Duration::from_millis(300));
}

#[test]
fn network_link_states_make_no_router_and_no_station_deaf() {
    for is_router in [true, false] {
        for routes in if is_router { &[false, true][..] } else { &[false] } {
            let port = free_port();
            let arguments: &[&str] = match (is_router, routes) {
                (true, false) => &["router"],
                (true, true) => &["router", "--routes"],
                (false, _) => &STATION,
            };
            let process = listening(arguments, "tcp", port, &[]);
            let worker = children(process.child.id());
            send_link_states(port, None);
            let heard = runtime().block_on(async {
                let (sender, receiver) = (client(port).await, client(port).await);
                if is_router { relayed(&sender, &receiver).await } else { RELAYED }
            });
            assert_eq!(heard, RELAYED, "{arguments:?}: {}", process.words());
            assert_eq!(children(process.child.id()), worker, "{arguments:?}: {}", process.words());
            assert!(!process.words().contains("panicked"), "{}", process.words());
        }
    }
}

#[test]
fn network_link_states_of_a_viewer_make_no_router_deaf() {
    let folder = with_keys();
    let port = free_port();
    let router = listening(&["router"], "tls", port, &access(folder.path(), "router"));
    let worker = children(router.child.id());
    send_link_states(port, Some(folder.path()));
    let endpoint = format!("tls/127.0.0.1:{port}");
    let heard = runtime().block_on(async {
        let vehicle = attacker(folder.path(), "vehicle", &endpoint).await;
        let viewer = attacker(folder.path(), "viewer", &endpoint).await;
        relayed(&vehicle, &viewer).await
    });
    assert_eq!(heard, RELAYED, "{}", router.words());
    assert_eq!(children(router.child.id()), worker, "{}", router.words());
}

#[test]
fn network_two_routers_exchange_routes_when_told_to() {
    let [near, far] = [free_port(), free_port()];
    let _near = listening(&["router", "--routes"], "tcp", near, &[]);
    let connect = format!("tcp/127.0.0.1:{near}");
    let _far = listening(&["router", "--connect", &connect], "tcp", far, &[]);
    let heard = runtime().block_on(async {
        let (sender, receiver) = (client(near).await, client(far).await);
        relayed(&sender, &receiver).await
    });
    assert_eq!(heard, RELAYED);
}

/// Holds transports of this certificate until one more is refused; at most 40.
fn take_places(folder: &Path, role: &str, port: u16, mark: u8) -> Vec<impl Sized + use<>> {
    let mut held = Vec::new();
    for k in 0..40 {
        let zid = [mark, k + 1, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5];
        let opened = raw::connect(folder, Some(role), port)
            .and_then(|stream| RawPeer::open(stream, Kind::Client, zid));
        match opened {
            Ok(peer) => held.push(peer),
            Err(_) => break,
        }
    }
    held
}

#[test]
fn network_one_certificate_takes_eight_places_and_leaves_operators_theirs() {
    let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    make_keys(first.path(), false);
    for file in std::fs::read_dir(first.path()).unwrap().flatten() {
        std::fs::copy(file.path(), second.path().join(file.file_name())).unwrap();
    }
    make_keys(second.path(), true);
    let runtime = runtime();
    let port = free_port();
    let endpoint = format!("tls/127.0.0.1:{port}");
    let _vehicle = runtime.block_on(super::roles::open_vehicle(first.path(), &endpoint, &[]));
    let certificates = [
        (&first, "viewer"),
        (&first, "router"),
        (&first, "vehicle"),
        (&second, "viewer"),
        (&second, "router"),
    ];
    let held: Vec<_> = certificates
        .iter()
        .zip(1..)
        .map(|((folder, role), mark)| take_places(folder.path(), role, port, mark))
        .collect();
    // 32 places, 4 of them for operators.
    assert_eq!(held.iter().map(Vec::len).collect::<Vec<_>>(), [8, 8, 8, 4, 0]);
    let operators = take_places(first.path(), "operator", port, 9);
    assert_eq!(operators.len(), 4);
    drop((held, operators));
    eventually("places are free again", Duration::from_secs(10), || {
        runtime.block_on(try_to_connect(first.path(), "viewer", &endpoint)).is_ok()
    });
}

#[test]
fn network_who_finds_no_place_is_told_on_both_sides() {
    let folder = with_keys();
    let port = free_port();
    let router = listening(&["router"], "tls", port, &access(folder.path(), "router"));
    let held = take_places(folder.path(), "viewer", port, 1);
    assert_eq!(held.len(), 8);
    let output = Command::new(PLUMBLINE)
        .args(["ground", "--no-http", "--json", "--duration=3"])
        .arg(format!("--connect=tls/127.0.0.1:{port}"))
        .args(access(folder.path(), "viewer"))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("no place left for our certificate"), "{}", stderr(&output));
    assert!(router.words().contains("no place for another session of viewer.1"), "{}", router.words());
}

/// A vehicle's session in this process that anybody reaches at this endpoint.
fn plain_vehicle(runtime: &tokio::runtime::Runtime, endpoint: &str) -> Session {
    let vehicle = Endpoints { listen: vec![endpoint.to_owned()], ..Endpoints::default() };
    runtime.block_on(vehicle.open()).unwrap()
}

/// Opens and closes a session at this endpoint within [`BACK`].
fn try_session(runtime: &tokio::runtime::Runtime, endpoint: &str) -> Option<Duration> {
    try_session_within(runtime, endpoint, BACK)
}

/// Opens and closes a session at this endpoint, in attempts as a vehicle makes them; the time it took, or
/// `None` where all are refused within `patience`.
pub fn try_session_within(
    runtime: &tokio::runtime::Runtime,
    endpoint: &str,
    patience: Duration,
) -> Option<Duration> {
    let connect = vec![endpoint.to_owned()];
    let client =
        Endpoints { mode: Mode::Client, connect, hears: vec!["drone".into()], ..Endpoints::default() };
    let begun = Instant::now();
    while begun.elapsed() < patience {
        if let Ok(session) = runtime.block_on(client.open()) {
            let took = begun.elapsed();
            let _ = runtime.block_on(async { session.close().await });
            println!("{endpoint}: let in after {:.2} s", took.as_secs_f64());
            return Some(took);
        }
    }
    None
}

#[test]
fn network_plain_connections_that_say_nothing_keep_nobody_out() {
    let port = free_port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let runtime = runtime();
    let _vehicle = plain_vehicle(&runtime, &endpoint);
    let silent: Vec<_> = (0..150).map(|_| TcpStream::connect(("127.0.0.1", port)).unwrap()).collect();
    assert!(try_session(&runtime, &endpoint).is_some(), "a hundred and fifty that say nothing");
    let begun: Vec<_> = (0..150)
        .map(|_| {
            use std::io::Write as _;
            let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
            stream
                .write_all(&[[19, 0, 0x01, 9, 0xf0 | Kind::Client as u8].as_slice(), &[8; 16]].concat())
                .unwrap();
            stream
        })
        .collect();
    assert!(try_session(&runtime, &endpoint).is_some(), "a hundred and fifty that say half of it");
    drop((silent, begun));
}

#[test]
fn network_places_that_run_out_without_certificates_are_told() {
    let port = free_port();
    let router = listening(&["router"], "tcp", port, &[]);
    let held: Vec<_> = (0..160_u8)
        .map(|k| {
            let zid = [k, 1, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4];
            RawPeer::open(TcpStream::connect(("127.0.0.1", port)).unwrap(), Kind::Client, zid).unwrap()
        })
        .collect();
    let nobody = ["ground", "--no-http", "--json", "--duration", "3", "--connect"];
    let output = Command::new(PLUMBLINE).args(nobody).arg(format!("tcp/127.0.0.1:{port}")).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("places for sessions taken"), "{}", stderr(&output));
    eventually("the router says so", BACK, || router.words().contains("no place for another session"));
    drop(held);
}
