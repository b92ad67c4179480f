//! States at instants over the local socket of a live flight: in time, and the same bits in a re-execution.

use super::live::AWAKE;
use crate::local::connected;
use crate::plumbline;
use plumbline_client::Local;
use plumbline_config::{Random, Timestamp};
use plumbline_flight::local::record::{Kind, Kinds};
use plumbline_flight::local::request::{At, Request};
use plumbline_record::local::content::LocalRecord;
use plumbline_record::{InstantAnswer, InstantOutcome};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Instants that are asked for.
const COUNT: usize = 1_000;
/// Nothing is waited for longer.
const PATIENCE: Duration = Duration::from_secs(20);
const MS: i64 = 1_000_000;

fn client_of(socket: &Path) -> Local {
    let stream = connected(socket);
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    Local::over(stream)
}

/// Asks, and waits for the answer.
fn asked(client: &mut Local, stamp: Timestamp, patience_ms: u32, is_settled: bool) -> InstantAnswer {
    let at = At { stamp, patience_ms, is_settled };
    let mut requests = client.requests().unwrap();
    requests.send(&Request::At(at)).unwrap();
    loop {
        match client.next_record().unwrap() {
            LocalRecord::Instant(answer, _) => return *answer,
            LocalRecord::Answer(answer) => panic!("{answer:?}"),
            LocalRecord::End => panic!("the flight ended"),
            _ => {}
        }
    }
}

/// Next odometry.
fn odometry(socket: &Path) -> Timestamp {
    let mut client = client_of(socket);
    loop {
        if let LocalRecord::Odometry(odometry, _) = client.next_record().unwrap() {
            return odometry.stamp;
        }
    }
}

#[test]
fn states_at_random_instants_come_within_a_millisecond_and_verify() {
    let folder = tempfile::tempdir().unwrap();
    let (socket, log) = (folder.path().join("local"), folder.path().join("flight.mcap"));
    let cache = folder.path().join("cache");
    let flown = ["replay", "sim:room?start=2&duration=14&scale=0.5", "--no-lines", "--no-loop"];
    let command = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_plumbline"));
        command.args(flown).arg("--cache").arg(&cache).stdout(Stdio::null());
        command
    };
    assert!(command().status().unwrap().success());
    let mut flying = command()
        .args(["--speed", "1", "--set", AWAKE, "--set", &format!("local.path=\"{}\"", socket.display())])
        .arg("--record")
        .arg(&log)
        .spawn()
        .unwrap();
    odometry(&socket);
    let mut client = client_of(&socket);
    client.requests().unwrap().send(&Request::Subscribe(Kinds::default())).unwrap();
    // Until there is a second to ask for.
    std::thread::sleep(Duration::from_millis(1_500));
    let (start, mut random) = (odometry(&socket), Random::new(7));
    let (begin, mut times_us) = (Instant::now(), Vec::with_capacity(COUNT));
    for _ in 0..COUNT {
        std::thread::sleep(Duration::from_micros(random.range(0.0, 12_000.0) as u64));
        // The odometry of now is that of the start and the time since; it arrives within some milliseconds.
        let now = start.plus_nanos(begin.elapsed().as_nanos() as i64);
        let stamp = now.plus_nanos(-(random.range(30.0, 1_000.0) * 1e6) as i64);
        let sent = Instant::now();
        let answer = asked(&mut client, stamp, 0, false);
        times_us.push(sent.elapsed().as_micros());
        assert_eq!((answer.outcome, answer.instant.stamp), (InstantOutcome::Answered, stamp));
    }
    times_us.sort_unstable();
    let [p50, p99, max] = [COUNT / 2, COUNT * 99 / 100, COUNT - 1].map(|k| times_us[k]);
    println!("request to answer, us: p50 {p50}, p99 {p99}, max {max}");
    assert!(p99 < 1_000, "p99 {p99} us");

    // What is still to come is waited for, and no longer than allowed.
    let now = start.plus_nanos(begin.elapsed().as_nanos() as i64);
    let answer = asked(&mut client, now.plus_nanos(40 * MS), 200, false);
    assert!(answer.outcome == InstantOutcome::Answered && !answer.instant.is_settled);
    let answer = asked(&mut client, now.plus_nanos(200 * MS), 500, true);
    assert!(answer.outcome == InstantOutcome::Answered && answer.instant.is_settled);
    let sent = Instant::now();
    assert_eq!(asked(&mut client, now.plus_nanos(60_000 * MS), 50, false).outcome, InstantOutcome::Ahead);
    assert!((50..100).contains(&sent.elapsed().as_millis()), "{:?}", sent.elapsed());
    assert_eq!(asked(&mut client, now.plus_nanos(-3_600_000 * MS), 0, false).outcome, InstantOutcome::NoPose);

    // The trail holds the newest frame and those before it, in order.
    client.requests().unwrap().send(&Request::Subscribe(Kinds::of(&[Kind::Trail]))).unwrap();
    let LocalRecord::Trail(trail) = client.next_record().unwrap() else { panic!("no trail") };
    assert!(trail.states.len() > 3 && trail.states.is_sorted_by_key(|state| state.stamp));
    assert_eq!(trail.states.last().map(|state| state.stamp), Some(trail.stamp));

    drop(client);
    assert!(flying.wait().unwrap().success());
    let output = plumbline(&["verify", log.to_str().unwrap(), "--json"]);
    let verified: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(verified["identical"], true, "{verified}");
    assert!(verified["instants_identical"].as_u64().unwrap() >= COUNT as u64 + 4, "{verified}");
}
