//! Attacks on a vehicle's network while it flies: what anybody can do who reaches its port, and what a viewer may do. The flight is
//! the one that it is alone, its log is whole, and whoever is honest goes on hearing it. Part of `make soak`.

use crate::local::{children, digests, flown_alone, was_disturbed};
use crate::raw;
use crate::raw::raw_peer::{Kind, RawPeer, declare_key};
use crate::roles::{try_to_connect, with_keys};
use crate::succeeds;
use crate::supervised::{BACK, runtime, try_client};
use crate::vehicle::{Running, certify, eventually, flight, free_port, render, resident_mb};
use plumbline_link::net::now_ns;
use plumbline_test_support::soak_minutes;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Length of a flight, s: they follow one another.
const FLIGHT_S: u32 = 60;
/// Viewers that ask for everything: with the honest one as many as their certificate may have.
const VIEWERS: usize = 7;
/// Connections that never say anything.
const IDLE: usize = 2_000;
/// Descriptors of the network process meanwhile, at most.
const MAX_DESCRIPTORS: usize = 250;
/// An honest station hears the vehicle again within this time, s.
pub const MAX_SILENCE_S: f64 = 2.0;
/// Malformed pairs of declarations, each of which once ended the session that read them.
const MALFORMED: [[&str; 2]; 5] =
    [["$*$*", "a"], ["plumbline/$*$*x", "plumbline/drone"], ["a//b", "a"], ["/a", "a"], ["#", "a"]];

/// Certificates, and where the vehicle listens: with them or without.
pub struct Stage {
    pub folder: tempfile::TempDir,
    pub endpoint: String,
    pub port: u16,
    pub is_plain: bool,
    /// Role of the honest station that listens.
    pub watcher: &'static str,
}

impl Stage {
    pub fn new() -> Self {
        render(FLIGHT_S);
        let folder = with_keys();
        let port = free_port();
        Self { folder, endpoint: format!("tls/127.0.0.1:{port}"), port, is_plain: false, watcher: "viewer" }
    }

    /// A vehicle that anybody reaches.
    pub fn plain() -> Self {
        let stage = Self::new();
        Self { endpoint: stage.endpoint.replace("tls/", "tcp/"), is_plain: true, ..stage }
    }

    /// Opens the session of the honest station.
    async fn try_watcher(&self) -> zenoh::Result<zenoh::Session> {
        match self.is_plain {
            false => try_to_connect(self.folder.path(), self.watcher, &self.endpoint).await,
            true => try_client(self.port).await,
        }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A flight that excludes the router's certificate, records and reports.
    fn vehicle(&self) -> Running {
        let mut vehicle = flight("drone", FLIGHT_S);
        if !self.is_plain {
            certify(&mut vehicle, self.folder.path());
            vehicle.args(["--set", "network.tls.excluded=[\"router\"]"]);
        }
        vehicle.args(["--listen", &self.endpoint]);
        vehicle.arg("--report").arg(self.file("report.json")).arg("--record").arg(self.file("log.mcap"));
        Running::start(vehicle)
    }
}

/// Flights that survived an attack.
#[derive(Debug, Default)]
pub struct Survived {
    pub flights: u64,
    /// Flights whose estimates were compared with those of the flight alone: on the others the host refused a frame.
    pub compared: u64,
    /// Deaths of the network process.
    pub deaths: u64,
    pub longest_silence_s: f64,
    pub most_descriptors: usize,
    pub most_link_mb: f64,
    pub worst_tick_late_ms: f64,
}

/// Flies for as many minutes while an honest station listens.
pub fn fly(stage: &Stage, minutes: u32) -> Survived {
    let alone = flown_alone(FLIGHT_S);
    let mut survived = Survived::default();
    for _ in 0..(minutes * 60).div_ceil(FLIGHT_S) {
        let _ = std::fs::remove_file(stage.file("log.mcap"));
        let vehicle = stage.vehicle();
        watch(stage, vehicle, &mut survived);
        let report = crate::json(stage.file("report.json"));
        survived.flights += 1;
        let late = report["live"]["tick_late_ms"]["max"].as_f64().unwrap_or_default();
        survived.worst_tick_late_ms = survived.worst_tick_late_ms.max(late);
        if !was_disturbed(&report) {
            assert_eq!(digests(&report), alone);
            survived.compared += 1;
        }
        assert_eq!(report["hot_path_allocations"], 0);
        assert!(report["recording"]["ended_early"].is_null(), "{}", report["recording"]);
        let log = stage.file("log.mcap").display().to_string();
        succeeds(&["verify", &log, "--json"]);
    }
    survived
}

/// Watches a flight to its end as an honest viewer.
fn watch(stage: &Stage, mut vehicle: Running, survived: &mut Survived) {
    let runtime = runtime();
    let heard_ns = Arc::new(AtomicI64::new(0));
    let theirs = Arc::clone(&heard_ns);
    let session = runtime.block_on(async {
        let session = loop {
            match stage.try_watcher().await {
                Ok(session) => break session,
                Err(_) => tokio::time::sleep(Duration::from_millis(100)).await,
            }
        };
        let note = move |_| theirs.store(now_ns(), Ordering::Relaxed);
        session.declare_subscriber("plumbline/drone/odom").callback(note).background().await.unwrap();
        session
    });
    eventually("the vehicle is heard", Duration::from_secs(20), || heard_ns.load(Ordering::Relaxed) > 0);
    let first = children(vehicle.child.id());
    let (mut link, begun) = (first[0], Instant::now());
    while vehicle.child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(20));
        let now = children(vehicle.child.id());
        if let Some(other) = now.first().filter(|id| **id != link) {
            survived.deaths += 1;
            link = *other;
        }
        survived.most_descriptors = survived.most_descriptors.max(descriptors(link));
        survived.most_link_mb = survived.most_link_mb.max(resident_mb(link));
        // The end of the flight is no silence.
        if begun.elapsed().as_secs() + 6 < u64::from(FLIGHT_S) {
            let silence_s = (now_ns() - heard_ns.load(Ordering::Relaxed)) as f64 * 1e-9;
            survived.longest_silence_s = survived.longest_silence_s.max(silence_s);
        }
    }
    let status = vehicle.child.wait().unwrap();
    assert!(status.success(), "{status}: {}", vehicle.words());
    let _ = runtime.block_on(async { session.close().await });
}

fn descriptors(process: u32) -> usize {
    std::fs::read_dir(format!("/proc/{process}/fd")).map_or(0, Iterator::count)
}

/// A viewer that subscribes to everything and asks for everything, over and over.
async fn ask_everything(folder: PathBuf, endpoint: String, answers: Arc<AtomicU64>) {
    let viewer = loop {
        match try_to_connect(&folder, "viewer", &endpoint).await {
            Ok(viewer) => break viewer,
            Err(_) => tokio::time::sleep(Duration::from_millis(200)).await,
        }
    };
    let mut watched = Vec::new();
    for topic in ["odom", "camera", "scene", "state", "map/**"] {
        let key = format!("plumbline/drone/{topic}");
        watched.push(viewer.declare_subscriber(key).callback(drop).await.unwrap());
    }
    loop {
        for question in ["trajectory/**", "map/keyframe/**?from=0;to=64", "map/path", "config", "clock"] {
            let asked =
                viewer.get(format!("plumbline/drone/{question}")).timeout(Duration::from_secs(5)).await;
            let Ok(replies) = asked else { continue };
            while replies.recv_async().await.is_ok() {
                answers.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}

#[test]
fn the_owner_of_a_stolen_identifier_is_heard_again_within_two_seconds() {
    raw::identifiers_are_taken(BACK);
}

/// Regression: queries that a viewer may make ended the process within seconds, as one connection of rustls was used by two
/// threads.
#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_viewers_that_ask_for_everything_over_tls() {
    let stage = Stage::new();
    let answers = Arc::new(AtomicU64::new(0));
    let viewers = runtime();
    for _ in 0..VIEWERS {
        let (folder, endpoint) = (stage.folder.path().to_owned(), stage.endpoint.clone());
        viewers.spawn(ask_everything(folder, endpoint, Arc::clone(&answers)));
    }
    let survived = fly(&stage, soak_minutes());
    viewers.shutdown_background();
    let answers = answers.load(Ordering::Relaxed);
    println!("{VIEWERS} viewers, {answers} answers: {survived:?}");
    assert!(answers > 1_000, "they were let in: {answers}");
    assert!(survived.deaths == 0 && survived.longest_silence_s < MAX_SILENCE_S, "{survived:?}");
}

/// Says what is malformed until it is over, in every way in; how often each was let in.
fn say_malformed(stage: &Stage, is_over: &AtomicBool) -> [u64; 3] {
    let mut let_in = [0; 3];
    for k in 0_u64.. {
        for (who, role) in [Some("viewer"), Some("router"), None].into_iter().enumerate() {
            if is_over.load(Ordering::Relaxed) {
                return let_in;
            }
            let mut zid = [9; 16];
            zid[..8].copy_from_slice(&(3 * k + who as u64 + 1).to_le_bytes());
            let Ok(mut peer) = raw::connect(stage.folder.path(), role, stage.port)
                .and_then(|stream| RawPeer::open(stream, Kind::Client, zid))
            else {
                std::thread::sleep(Duration::from_millis(20));
                continue;
            };
            let_in[who] += 1;
            let [first, second] = MALFORMED[(k % MALFORMED.len() as u64) as usize];
            let _ = peer.send_frame(&declare_key(1, 0, first));
            let _ = peer.send_frame(&declare_key(2, 0, second));
            let _ = peer.receive();
        }
    }
    let_in
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_malformed_declarations_with_and_without_a_certificate() {
    let stage = Stage::new();
    let is_over = AtomicBool::new(false);
    let (survived, let_in) = std::thread::scope(|scope| {
        let attacks = scope.spawn(|| say_malformed(&stage, &is_over));
        let survived = fly(&stage, soak_minutes());
        is_over.store(true, Ordering::Relaxed);
        (survived, attacks.join().unwrap())
    });
    let [viewer, excluded, nobody] = let_in;
    println!("let in: viewer {viewer}, excluded {excluded}, without a certificate {nobody}; {survived:?}");
    assert!(viewer > 100 && excluded == 0 && nobody == 0, "{let_in:?}");
    assert!(survived.deaths == 0 && survived.longest_silence_s < MAX_SILENCE_S, "{survived:?}");
}

/// Holds connections that say nothing, and opens others in the place of those that are closed.
fn hold_idle(port: u16, is_over: &AtomicBool) -> u64 {
    let mut held: Vec<TcpStream> = Vec::new();
    let mut opened = 0;
    while !is_over.load(Ordering::Relaxed) {
        held.retain(|stream| {
            let _ = stream.set_nonblocking(true);
            !matches!(stream.peek(&mut [0]), Ok(0)) && stream.take_error().is_ok_and(|error| error.is_none())
        });
        while held.len() < IDLE {
            match TcpStream::connect(("127.0.0.1", port)) {
                Ok(stream) => held.push(stream),
                Err(_) => break,
            }
            opened += 1;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    opened
}

#[test]
#[ignore = "minutes: `make soak`"]
fn soak_network_two_thousand_connections_that_say_nothing() {
    let limit = getrlimit(Resource::Nofile);
    setrlimit(Resource::Nofile, Rlimit { current: limit.maximum.or(Some(65_536)), ..limit }).unwrap();
    let stage = Stage::new();
    let is_over = AtomicBool::new(false);
    let (survived, opened, operator) = std::thread::scope(|scope| {
        let idle = scope.spawn(|| hold_idle(stage.port, &is_over));
        let operator =
            scope.spawn(|| command_again_and_again(stage.folder.path(), &stage.endpoint, &is_over));
        let survived = fly(&stage, soak_minutes().div_ceil(3));
        is_over.store(true, Ordering::Relaxed);
        (survived, idle.join().unwrap(), operator.join().unwrap())
    });
    println!("{opened} idle connections, {operator:?}: {survived:?}");
    assert!(opened as usize > IDLE && operator.told > 0, "{opened} {operator:?}");
    assert!(survived.most_descriptors < MAX_DESCRIPTORS, "{survived:?}");
    assert!(survived.deaths == 0 && survived.longest_silence_s < MAX_SILENCE_S, "{survived:?}");
}

/// An operator's sessions, one after the other.
#[derive(Debug, Default)]
pub struct Operator {
    /// Sessions whose question was answered.
    pub told: u64,
    /// Sessions that were not let in while the vehicle listened.
    pub kept_out: u64,
    /// Sessions that were let in, and had no answer.
    pub unanswered: u64,
    /// Longest time until a session was let in, s.
    pub slowest_s: f64,
}

/// Sessions of an operator, one after the other, each of which asks for the configuration.
pub fn command_again_and_again(folder: &Path, endpoint: &str, is_over: &AtomicBool) -> Operator {
    let runtime = runtime();
    let mut seen = Operator::default();
    while !is_over.load(Ordering::Relaxed) {
        runtime.block_on(async {
            let begun = Instant::now();
            let Ok(operator) = try_to_connect(folder, "operator", endpoint).await else {
                // Between two flights there is nobody to reach.
                let address = endpoint.split_once('/').map_or(endpoint, |(_, address)| address);
                seen.kept_out += u64::from(TcpStream::connect(address).is_ok());
                return;
            };
            seen.slowest_s = seen.slowest_s.max(begun.elapsed().as_secs_f64());
            let asked = operator.get("plumbline/drone/config").timeout(Duration::from_secs(5)).await;
            let is_told = match asked {
                Ok(replies) => replies.recv_async().await.is_ok_and(|reply| reply.into_result().is_ok()),
                Err(_) => false,
            };
            let _ = operator.close().await;
            if is_told {
                seen.told += 1;
            } else {
                seen.unanswered += 1;
            }
        });
        std::thread::sleep(Duration::from_millis(500));
    }
    seen
}
