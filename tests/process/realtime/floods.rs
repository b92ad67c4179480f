//! Messages in masses, from somebody with a viewer's certificate. Part of `make soak`.

use crate::local::children;
use crate::roles::{attacker, try_to_connect, with_keys};
use crate::supervised::runtime;
use crate::vehicle::{
    PLUMBLINE, Running, certify, eventually, flight, free_port, memory_mb, render, resident_mb,
};
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use zenoh::qos::CongestionControl;

/// Length of the flights, s.
const FLIGHT_S: u32 = 90;
/// Given to Zenoh for the vehicle, and as much for the station, bytes; and what has to go over the line to each: Zenoh drops some of
/// it by itself.
const FLOOD: usize = 5_000_000_000;
const THROWN: usize = 4_000_000_000;
/// Sizes of messages: more than anybody takes, and less.
const SIZES: [usize; 2] = [1 << 20, 50_000];
/// Memory that a process may grow by, MB.
const MAX_GROWTH_MB: f64 = 20.0;
/// Peers at a time, and the length of the keys that each declares without end, bytes.
const PEERS: usize = 8;
const KEY_BYTES: usize = 60_000;
/// Vehicles of a station, and pages that never read what it sends them.
const VEHICLES: usize = 16;
const PAGES: usize = 60;
/// Memory that a station may take for them, MB.
const MAX_STATION_MB: f64 = 100.0;
/// Data that peers may take of the network process, bytes.
const MAX_HELD_BYTES: u64 = 10_000_000;

/// Bytes that this host has sent to itself.
fn looped_bytes() -> usize {
    let devices = std::fs::read_to_string("/proc/net/dev").unwrap();
    let lo = devices.lines().find_map(|line| line.trim().strip_prefix("lo:")).unwrap();
    lo.split_whitespace().next().unwrap().parse().unwrap()
}

/// A vehicle and a station that listen, each with its certificate.
fn start(folder: &Path, report: &Path) -> ([Running; 2], [String; 2]) {
    let endpoints = [0, 1].map(|_| format!("tls/127.0.0.1:{}", free_port()));
    let file = |name: &str| folder.join(name).display().to_string();
    let mut vehicle = flight("drone", FLIGHT_S);
    certify(&mut vehicle, folder);
    vehicle.args(["--listen", &endpoints[0], "--connect", &endpoints[1], "--report"]).arg(report);
    let mut station = Command::new(PLUMBLINE);
    station.args(["ground", "--plain", "--no-http", "--listen", &endpoints[1], "--authority"]);
    station.args([
        &file("authority.pem"),
        "--certificate",
        &file("operator.pem"),
        "--key",
        &file("operator.key"),
    ]);
    let station = Running::start(station);
    ([Running::start(vehicle), station], endpoints)
}

/// p99 from sample to odometry of a flight that is over, ms.
fn p99_ms(vehicle: &mut Running, report: &Path) -> f64 {
    let _ = vehicle.child.wait();
    let report = crate::json(report);
    let latency = &report["live"]["sample_to_odometry_ms"];
    latency["p99"].as_f64().unwrap_or_else(|| panic!("{latency}"))
}

/// Throws messages at an endpoint, with keys that the role may not use.
async fn flood(folder: &Path, endpoint: &str) {
    let viewer = attacker(folder, "viewer", endpoint).await;
    let keys = ["plumbline/drone/odom", "plumbline/drone/command/reset", "plumbline/**", "elsewhere"];
    let mut sent = 0;
    for k in 0.. {
        let size = SIZES[k % 2];
        let put = viewer.put(keys[k % keys.len()], vec![7u8; size]);
        put.congestion_control(CongestionControl::Block).await.unwrap();
        sent += size;
        if sent >= FLOOD {
            break;
        }
    }
    let _ = viewer.close().await;
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_messages_in_masses_grow_nobodys_memory_and_delay_no_odometry() {
    render(FLIGHT_S);
    let folder = with_keys();
    let report = folder.path().join("report.json");
    let ([mut vehicle, station], _) = start(folder.path(), &report);
    let quiet_ms = p99_ms(&mut vehicle, &report);
    drop(station);
    let ([mut vehicle, station], endpoints) = start(folder.path(), &report);
    std::thread::sleep(Duration::from_secs(8));
    let ids = [vehicle.child.id(), station.worker()];
    let before = ids.map(resident_mb);
    let (theirs, looped) = (folder.path().to_owned(), looped_bytes());
    let floods = std::thread::spawn(move || {
        runtime().block_on(async {
            tokio::join!(flood(&theirs, &endpoints[0]), flood(&theirs, &endpoints[1]));
        });
    });
    let mut largest = before;
    eventually("the flood is over", Duration::from_secs(u64::from(FLIGHT_S)), || {
        let now = ids.map(resident_mb);
        largest = [0, 1].map(|k| largest[k].max(now[k]));
        floods.is_finished()
    });
    floods.join().unwrap();
    let thrown = looped_bytes() - looped;
    assert!(thrown >= 2 * THROWN, "{thrown} bytes went over the line");
    assert!(vehicle.child.try_wait().unwrap().is_none(), "the flight was over before: {}", vehicle.words());
    let flooded_ms = p99_ms(&mut vehicle, &report);
    println!(
        "vehicle and station: {before:.1?} MB before, at most {largest:.1?} MB; p99 of odometry {quiet_ms:.2} ms, \
         {flooded_ms:.2} ms while flooded"
    );
    for k in 0..2 {
        assert!(largest[k] - before[k] <= MAX_GROWTH_MB, "{before:?} {largest:?}");
    }
    assert!(flooded_ms <= 1.2 * quiet_ms + 0.1, "{quiet_ms} {flooded_ms}");
}

/// Watches keys without end, until it is over; Zenoh declares them all again whenever it is let in again.
async fn watch_without_end(folder: PathBuf, endpoint: String, is_over: Arc<AtomicBool>) {
    let viewer = attacker(&folder, "viewer", &endpoint).await;
    let mut watched = Vec::new();
    while !is_over.load(Ordering::Relaxed) {
        let key = format!("plumbline/drone/{}/{}", "x".repeat(KEY_BYTES), watched.len());
        watched.push(viewer.declare_subscriber(key).callback(|_| ()).await.unwrap());
    }
}

#[test]
#[ignore = "half a minute: `make soak`"]
fn soak_network_keys_without_end_cost_the_network_process_and_not_the_flight() {
    render(30);
    let folder = with_keys();
    let endpoint = format!("tls/127.0.0.1:{}", free_port());
    let mut vehicle = flight("drone", 30);
    certify(&mut vehicle, folder.path());
    vehicle.args(["--listen", &endpoint]);
    let mut vehicle = Running::start(vehicle);
    std::thread::sleep(Duration::from_secs(6));
    let before = resident_mb(vehicle.child.id());
    // A bound that is reached soon: Zenoh declares the slower the more there is already.
    let link = children(vehicle.child.id())[0];
    let bytes = Some((memory_mb(link, "VmData") * 1024.0 * 1024.0) as u64 + MAX_HELD_BYTES);
    let limit = Rlimit { current: bytes, maximum: bytes };
    prlimit(Pid::from_raw(i32::try_from(link).unwrap()), Resource::Data, limit).unwrap();
    let is_over = Arc::new(AtomicBool::new(false));
    let mut largest = before;
    let runtime = runtime();
    let attack = || watch_without_end(folder.path().to_owned(), endpoint.clone(), Arc::clone(&is_over));
    // Their own, since they may wait for ever for links that are gone.
    let peers =
        tokio::runtime::Builder::new_multi_thread().worker_threads(PEERS).enable_all().build().unwrap();
    (0..PEERS).for_each(|_| drop(peers.spawn(attack())));
    for _ in 0..150 {
        largest = largest.max(resident_mb(vehicle.child.id()));
        std::thread::sleep(Duration::from_millis(100));
    }
    is_over.store(true, Ordering::Relaxed);
    peers.shutdown_background();
    let words = vehicle.words();
    println!("{before:.1} MB before, at most {largest:.1} MB; {words}");
    assert!(words.contains("the network process ended (signal: 6 (SIGABRT)"), "{words}");
    assert!(largest - before < MAX_GROWTH_MB, "{before} {largest}");
    assert!(vehicle.child.try_wait().unwrap().is_none(), "it flies: {words}");
    // Who is honest is let in again, as soon as the links are open.
    let asked = runtime.block_on(async {
        let mut operator = None;
        for _ in 0..50 {
            operator = try_to_connect(folder.path(), "operator", &endpoint).await.ok();
            if operator.is_some() {
                break;
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        let operator = operator.expect("the vehicle listens again within five seconds");
        let reply = operator.get("plumbline/drone/config").await.unwrap().recv_async().await;
        reply.is_ok_and(|reply| reply.into_result().is_ok())
    });
    assert!(asked, "{}", vehicle.words());
}

/// A page that opens its socket and never reads; the station's answer to the opening is all it takes.
fn page_that_never_reads(port: u16) -> TcpStream {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let request = format!(
        "GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    );
    stream.write_all(request.as_bytes()).unwrap();
    let mut status = [0; 12];
    stream.read_exact(&mut status).unwrap();
    assert_eq!(&status, b"HTTP/1.1 101");
    stream
}

#[test]
#[ignore = "a minute with sixteen vehicles: make soak"]
fn soak_sixty_pages_that_never_read_take_little_of_the_station() {
    const SECONDS: u32 = 60;
    render(SECONDS);
    let [station_port, page_port] = [free_port(), free_port()];
    let endpoint = format!("tcp/127.0.0.1:{station_port}");
    let mut command = Command::new(PLUMBLINE);
    command.args(["ground", "--plain", "--listen", &endpoint, "--http", &format!("127.0.0.1:{page_port}")]);
    let station = Running::start(command);
    let vehicles: Vec<Running> = (0..VEHICLES)
        .map(|k| {
            let mut command = flight(&format!("drone-{k}"), SECONDS);
            command.args(["--connect", &endpoint]);
            Running::start(command)
        })
        .collect();
    std::thread::sleep(Duration::from_secs(12));
    let before_mb = resident_mb(station.worker());
    let pages: Vec<TcpStream> = (0..PAGES).map(|_| page_that_never_reads(page_port)).collect();
    let most_mb = (0..45).fold(before_mb, |most, _| {
        std::thread::sleep(Duration::from_secs(1));
        resident_mb(station.worker()).max(most)
    });
    println!(
        "{VEHICLES} vehicles: {before_mb:.1} MB; with {PAGES} pages that never read at most {most_mb:.1} MB"
    );
    assert!(most_mb < MAX_STATION_MB, "{most_mb} MB");
    drop((pages, vehicles));
}
