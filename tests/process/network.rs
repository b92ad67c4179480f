//! What a vehicle publishes is what it computed: two processes and a Zenoh session between them.

use super::vehicle::{PLUMBLINE, free_port};
use plumbline::net::{Endpoints, Publisher};
use plumbline::pipeline::Sink as _;
use plumbline_config::{Config, Timestamp};
use plumbline_estimator::{NavCovariance, Odometry, TrackingState};
use std::collections::BTreeMap;
use std::net::TcpListener;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

#[test]
fn a_second_process_receives_what_was_computed() {
    let folder = tempfile::tempdir().unwrap();
    let trajectory = folder.path().join("out.tum");
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let command = env!("CARGO_BIN_EXE_plumbline");
    let ground = Command::new(command)
        .args(["ground", "--json", "--no-http", "--listen", &endpoint, "--duration", "14"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let flown = Command::new(command)
        .args(["replay", "sim:room", "--start", "2", "--duration", "4", "--scale", "0.5", "--speed", "1"])
        .args(["--publish", "--connect", &endpoint, "--trajectory", trajectory.to_str().unwrap()])
        .output()
        .unwrap();
    assert!(flown.status.success(), "{}", String::from_utf8_lossy(&flown.stderr));
    let heard = ground.wait_with_output().unwrap();
    let computed: BTreeMap<i64, String> = std::fs::read_to_string(&trajectory)
        .unwrap()
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            let (stamp, pose) = line.split_once(' ').unwrap();
            (stamp.replace('.', "").parse().unwrap(), pose.to_owned())
        })
        .collect();
    let mut same = 0;
    for line in String::from_utf8(heard.stdout).unwrap().lines() {
        let message: serde_json::Value = serde_json::from_str(line).unwrap();
        let Some(pose) = computed.get(&message["stamp_ns"].as_i64().unwrap()) else { continue };
        let numbers: Vec<f64> = pose.split(' ').map(|x| x.parse().unwrap()).collect();
        for (k, expected) in numbers.iter().enumerate() {
            let key = if k < 3 { ("position_m", k) } else { ("rotation_xyzw", k - 3) };
            let value = message[key.0][key.1].as_f64().unwrap();
            assert!((value - expected).abs() < 1e-8, "{value} against {expected}");
        }
        same += 1;
    }
    assert!(same >= computed.len() * 9 / 10, "{same} of {} poses were received", computed.len());
}

/// A vehicle that sends what a fast one sends, without the estimation behind it.
fn send_at_200_hz(publisher: &mut Publisher, seconds: u32, phase: Duration) {
    let start = Instant::now() + phase;
    for k in 0..200 * seconds {
        let due = start + Duration::from_millis(5) * k;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        publisher.odometry(&Odometry {
            sequence: u64::from(k),
            stamp: Timestamp::from_nanos(1 + i64::from(k) * 5_000_000),
            pose_o_b: nalgebra::Isometry3::translation(f64::from(k) * 0.005, 0.0, 1.0),
            v_o_b: nalgebra::Vector3::x(),
            angular_rate_b: nalgebra::Vector3::zeros(),
            covariance: NavCovariance::identity(),
            state: TrackingState::Tracking,
            quality: 90,
            reset_counter: 0,
        });
    }
}

/// `vehicles` at 200 Hz into one station for so many seconds; what the station reports.
fn watched(vehicles: u32, seconds: u32) -> serde_json::Value {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.json");
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let mut ground = Command::new(PLUMBLINE)
        .args(["ground", "--no-http", "--plain", "--listen", &endpoint, "--report"])
        .arg(&report)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let config = Config::preset("sim").unwrap();
    let mut publishers: Vec<Publisher> = (0..vehicles)
        .map(|k| {
            let endpoints = Endpoints {
                vehicle: format!("v{k}"),
                connect: vec![endpoint.clone()],
                ..Endpoints::default()
            };
            Publisher::start(&config, &endpoints, Arc::default()).unwrap()
        })
        .collect();
    // Until the subscriptions have gone round.
    std::thread::sleep(Duration::from_secs(2));
    std::thread::scope(|scope| {
        for (k, publisher) in (0u32..).zip(&mut publishers) {
            let phase = Duration::from_micros(u64::from(k) * 5_000 / u64::from(vehicles));
            scope.spawn(move || send_at_200_hz(publisher, seconds, phase));
        }
    });
    std::thread::sleep(Duration::from_millis(500));
    let _ = Command::new("kill").args(["-INT", &ground.id().to_string()]).status();
    assert!(ground.wait().unwrap().success());
    publishers.into_iter().for_each(Publisher::stop);
    serde_json::from_str(&std::fs::read_to_string(report).unwrap()).unwrap()
}

#[test]
fn ten_vehicles_at_200_hz_reach_a_station_without_loss() {
    let report = watched(10, 5);
    println!("{report:#}");
    for (name, vehicle) in report["vehicles"].as_object().unwrap() {
        assert_eq!(vehicle["odom"]["received"], 1_000, "{name}");
        assert_eq!(vehicle["odom"]["lost"], 0, "{name}");
    }
    assert_eq!(report["vehicles"].as_object().unwrap().len(), 10);
    assert_eq!(report["malformed"], 0);
}

#[test]
fn odometry_reaches_a_subscriber_on_this_host_within_a_millisecond() {
    // A host that is busy with other things delays everybody: the best of three counts.
    let mut seen = Vec::new();
    for _ in 0..3 {
        let report = watched(1, 8);
        let latency = report["vehicles"]["v0"]["latency_ms"].clone();
        println!("from hand-over to the callback: {latency}");
        assert_eq!(report["vehicles"]["v0"]["odom"]["lost"], 0);
        if latency["p50"].as_f64().unwrap() <= 0.3 && latency["p99"].as_f64().unwrap() <= 1.0 {
            return;
        }
        seen.push(latency.to_string());
    }
    panic!("three times slower than asked: {seen:?}");
}

/// Puts bytes on every key of a vehicle, as somebody with bad intentions or a broken radio would.
#[test]
fn malformed_messages_on_every_key_are_counted_and_harm_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.json");
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let mut ground = Command::new(PLUMBLINE)
        .args(["ground", "--no-http", "--plain", "--listen", &endpoint, "--report"])
        .arg(&report)
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let keys = ["odom", "state", "health", "map/keyframe", "map/correction", "scene"];
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let mut sent = 0u64;
    runtime.block_on(async {
        let endpoints = Endpoints { connect: vec![endpoint], ..Endpoints::default() };
        let session = endpoints.open().await.unwrap();
        tokio::time::sleep(Duration::from_secs(1)).await;
        let mut noise = 1u64;
        for round in 0..40usize {
            for key in keys {
                let length = [0, 1, 7, 60, 300, 4_000, 300_000][round % 7];
                let payload: Vec<u8> = (0..length)
                    .map(|_| {
                        noise = noise
                            .wrapping_mul(6_364_136_223_846_793_005)
                            .wrapping_add(1_442_695_040_888_963_407);
                        (noise >> 56) as u8
                    })
                    .collect();
                let _ = session
                    .put(format!("plumbline/drone/{key}"), payload)
                    .congestion_control(zenoh::qos::CongestionControl::Block)
                    .await;
                sent += 1;
            }
        }
        tokio::time::sleep(Duration::from_secs(1)).await;
        let _ = session.close().await;
    });
    assert!(ground.try_wait().unwrap().is_none(), "the station ended");
    let _ = Command::new("kill").args(["-INT", &ground.id().to_string()]).status();
    assert!(ground.wait().unwrap().success());
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(report).unwrap()).unwrap();
    assert_eq!(report["malformed"].as_u64().unwrap(), sent, "{report}");
}
