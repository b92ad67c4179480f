//! Maps of flights on disk: kept on command while the vehicle flies, and never half written.

use crate::vehicle::{PLUMBLINE, Running, eventually, flight, free_port, render};
use crate::{plumbline, stderr};
use nalgebra::{Isometry3, Vector2};
use plumbline_config::Timestamp;
use plumbline_estimator::places::{Descriptor, Feature};
use plumbline_flight::places::codec::encode;
use plumbline_flight::places::{MapContents, StoredKeyframe, read_map};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Length of the flights in real time, s.
const FLIGHT_S: u32 = 20;
/// Patience with vehicles that start.
const PATIENCE: Duration = Duration::from_secs(15);

#[test]
fn network_a_map_is_saved_on_command_while_the_flight_goes_on() {
    render(FLIGHT_S);
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("room.map");
    let fly = |name: &str, more: &[&str]| {
        let endpoint = format!("tcp/127.0.0.1:{}", free_port());
        let mut command = flight(name, FLIGHT_S);
        command.args(["--listen", &endpoint]).args(more);
        (Running::start(command), endpoint)
    };
    let (mut keeper, endpoint) = fly("keeper", &["--save-map", map.to_str().unwrap()]);
    let mut saved = None;
    eventually("the map is saved", PATIENCE, || {
        let output = plumbline(&["map", "save", "keeper", "--connect", &endpoint]);
        saved = output.status.success().then_some(output.stdout);
        saved.is_some()
    });
    let words = String::from_utf8(saved.unwrap()).unwrap();
    assert!(words.starts_with("keeper: ") && words.contains("keyframes saved"), "{words}");
    assert!(keeper.child.try_wait().unwrap().is_none(), "the flight has ended: {}", keeper.words());
    let at_command = read_map(&map).unwrap().keyframes.len();
    assert!(at_command > 0 && words.contains(&at_command.to_string()), "{at_command} in the file: {words}");
    keeper.interrupt();
    assert!(read_map(&map).unwrap().keyframes.len() >= at_command, "the end of the flight keeps the map too");

    let (_other, endpoint) = fly("other", &[]);
    eventually("a flight that keeps no map says so", PATIENCE, || {
        let refused = plumbline(&["map", "save", "other", "--connect", &endpoint]);
        assert_eq!(refused.status.code(), Some(1));
        stderr(&refused).contains("--save-map FILE")
    });
}

#[test]
fn a_save_that_is_killed_leaves_the_old_map() {
    let folder = tempfile::tempdir().unwrap();
    let (known, kept) = (folder.path().join("known.map"), folder.path().join("kept.map"));
    let partial = folder.path().join("kept.map.partial");
    // Large, so that writing takes long enough to be hit.
    let large = encode(&made_up(800, 400));
    fs::write(&known, &large).unwrap();
    let old = encode(&made_up(3, 50));
    let mut hits = 0;
    for delay_ms in [0, 2, 5, 10] {
        fs::write(&kept, &old).unwrap();
        let _ = fs::remove_file(&partial);
        let mut flight = Command::new(PLUMBLINE)
            .args(["replay", "sim:room", "--scale", "0.3", "--duration", "0.5", "--no-lines", "--map"])
            .arg(&known)
            .arg("--save-map")
            .arg(&kept)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let end = Instant::now() + Duration::from_secs(60);
        while !partial.exists() && flight.try_wait().unwrap().is_none() {
            assert!(Instant::now() < end, "the flight does not end");
        }
        std::thread::sleep(Duration::from_millis(delay_ms));
        flight.kill().unwrap();
        flight.wait().unwrap();
        let is_old = fs::read(&kept).unwrap() == old;
        assert!(is_old || is_whole_and_large(&kept, large.len()), "half a map after {delay_ms} ms");
        hits += u32::from(is_old && partial.exists());
    }
    assert!(hits > 0, "no save was hit: the map must be larger");
}

fn is_whole_and_large(map: &Path, bytes: usize) -> bool {
    read_map(map).is_ok() && fs::metadata(map).unwrap().len() as usize >= bytes / 2
}

/// A map of nowhere.
fn made_up(keyframes: u64, features: u64) -> MapContents {
    let feature = |k: u64, f: u64| {
        let word = |n: u64| (k * 4096 + f * 4 + n).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        Feature {
            descriptor: Descriptor([word(0), word(1), word(2), word(3)]),
            xy: Vector2::new((f % 20) as f32 / 20.0 - 0.5, (f / 20) as f32 / 40.0 - 0.25),
            sigma_xy: 0.002,
            inverse_depth: 0.3,
            sigma_inverse_depth: 0.01,
        }
    };
    let keyframe = |k: u64| StoredKeyframe {
        session: 0,
        stamp: Timestamp::from_nanos(k as i64 * 500_000_000),
        pose_m_b: Isometry3::translation(k as f64, 0.0, 1.0),
        pose_b_c: Isometry3::identity(),
        features: (0..features).map(|f| feature(k, f)).collect(),
        lines: vec![],
    };
    MapContents { keyframes: (0..keyframes).map(keyframe).collect() }
}
