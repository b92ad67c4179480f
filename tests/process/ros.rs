//! View of a vehicle from a machine with ROS 2 and `rmw_zenoh`. `tests/python/ros_peer.py` plays that machine: router, session
//! and key expressions as `rmw_zenoh` has them, decoding by `rosbags`.

mod path;

use super::python::{FLIGHT, Program, configuration, free_endpoint, interpreter};
use super::succeeds;
use super::vehicle::{cache, render_as};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

/// Packages that `ros_peer.py` imports.
const PACKAGES: &str = "rosbags, xxhash, zenoh";

/// Time at which the machine with ROS is there.
#[derive(Clone, Copy, PartialEq)]
enum Machine {
    Before,
    Later,
}

/// Topics of every due odometry.
const TOPICS: [&str; 3] = ["/drone_1/odom", "/drone_1/pose", "/tf"];
/// Every topic, with its type and depth.
const ALL_TOPICS: [(&str, &str, u64); 4] = [
    (TOPICS[0], "nav_msgs/msg/Odometry", 10),
    (TOPICS[1], "geometry_msgs/msg/PoseStamped", 10),
    (TOPICS[2], "tf2_msgs/msg/TFMessage", 100),
    ("/drone_1/path", "nav_msgs/msg/Path", 1),
];

/// Topics that the machine saw of a flight, and the odometry that the flight wrote to its file.
struct Seen {
    told: Value,
    computed: BTreeMap<i64, Vec<f64>>,
}

/// Flies a vehicle with these options of `[ros]`; the machine is there before, or when the vehicle has said that it
/// waits for it.
fn fly(python: &Path, changes: &[(&str, &str)], when: Machine) -> Seen {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (config, odometry) = (at("vehicle.toml"), at("odometry.tum"));
    let endpoint = free_endpoint();
    let start = || {
        let mut peer = Program::start(python, "tests/python/ros_peer.py", &["--listen", &endpoint]);
        assert_eq!(peer.line(), "ready");
        peer
    };
    let before = (when == Machine::Before).then(start);
    let mut all = vec![
        ("network.vehicle", "\"drone-1\"".to_owned()),
        ("ros.enabled", "true".to_owned()),
        ("ros.router", format!("\"{endpoint}\"")),
    ];
    all.extend(changes.iter().map(|(key, value)| (*key, (*value).to_owned())));
    configuration(&config, &all);
    let files = ["--config", config.to_str().unwrap(), "--odometry", odometry.to_str().unwrap()];
    // In the configuration the simulated vehicle's own mounting would take its place.
    let mounting = ["--set", "vehicle.imu_to_vehicle_deg=[180.0, -90.0, 0.0]"];
    // The vehicle says that it waits after three seconds.
    let duration_s = match when {
        Machine::Before => 4,
        Machine::Later => 8,
    };
    // A vehicle that draws its images while it flies falls behind on a busy host.
    render_as(&FLIGHT[1..4], duration_s);
    let mut vehicle = Command::new(env!("CARGO_BIN_EXE_plumbline"));
    let mut vehicle = vehicle
        .args([&FLIGHT[..], &files, &mounting].concat())
        .args(["--duration", &duration_s.to_string(), "--cache"])
        .arg(cache())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut words = BufReader::new(vehicle.stderr.take().unwrap());
    let mut told = String::new();
    let peer = before.unwrap_or_else(|| {
        while !told.contains("retrying until it is available") {
            assert!(words.read_line(&mut told).unwrap() > 0, "{told}");
        }
        start()
    });
    words.read_to_string(&mut told).unwrap();
    assert!(vehicle.wait().unwrap().success(), "{told}");
    let told = serde_json::from_str(&peer.rest()).unwrap();
    Seen { told, computed: poses(&odometry) }
}

/// Lines of a TUM file by their stamp in nanoseconds.
fn poses(file: &Path) -> BTreeMap<i64, Vec<f64>> {
    let text = std::fs::read_to_string(file).unwrap();
    let pose = |line: &str| {
        let (stamp, numbers) = line.split_once(' ').unwrap();
        let numbers = numbers.split(' ').map(|x| x.parse().unwrap()).collect();
        (stamp.replace('.', "").parse().unwrap(), numbers)
    };
    text.lines().filter(|line| !line.starts_with('#')).map(pose).collect()
}

impl Seen {
    fn samples(&self, topic: &str) -> Vec<&Value> {
        self.told["samples"].as_array().unwrap().iter().filter(|s| s["topic"] == topic).collect()
    }

    fn entities(&self, kind: &str) -> Vec<&Value> {
        self.told["entities"].as_array().unwrap().iter().filter(|e| e["kind"] == kind).collect()
    }
}

fn stamp_ns(header: &Value) -> i64 {
    let part = |name: &str| header["stamp"][name].as_i64().unwrap();
    part("sec") * 1_000_000_000 + part("nanosec")
}

fn numbers(value: &Value, names: &str) -> Vec<f64> {
    names.split(' ').map(|name| value[name].as_f64().unwrap()).collect()
}

/// The rotation x, y, z, w of a vehicle whose IMU has x up, y right and z forward: its x, y, z are forward, left, up.
fn vehicle_rotation(q_o_b: &[f64]) -> nalgebra::UnitQuaternion<f64> {
    use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion};
    let of_imu = UnitQuaternion::from_quaternion(Quaternion::new(q_o_b[3], q_o_b[0], q_o_b[1], q_o_b[2]));
    let [x, y, z] = [0, 1, 2].map(|k| of_imu.to_rotation_matrix().matrix().column(k).into_owned());
    let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[z, -y, x]));
    UnitQuaternion::from_rotation_matrix(&axes)
}

/// The pose of the vehicle is that of the IMU in the file at `stamp_ns`, to the digits of the file.
fn is_computed(computed: &BTreeMap<i64, Vec<f64>>, stamp_ns: i64, position: &Value, rotation: &Value) {
    let expected = computed.get(&stamp_ns).unwrap_or_else(|| panic!("nothing was computed for {stamp_ns}"));
    for (told, expected) in numbers(position, "x y z").iter().zip(expected) {
        assert!((told - expected).abs() < 1e-8, "{told} against {expected} at {stamp_ns}");
    }
    let q = numbers(rotation, "x y z w");
    let told = nalgebra::Quaternion::new(q[3], q[0], q[1], q[2]);
    let angle = nalgebra::UnitQuaternion::from_quaternion(told).angle_to(&vehicle_rotation(&expected[3..]));
    assert!((told.norm() - 1.0).abs() < 1e-12 && angle < 1e-7, "{angle} rad off at {stamp_ns}");
}

#[test]
fn a_machine_with_ros_sees_topics_and_reads_what_was_computed() {
    let Some(python) = interpreter(PACKAGES) else { return };
    let seen = fly(&python, &[], Machine::Before);
    check_graph(&seen);
    path::check_paths(&seen);
    for topic in TOPICS {
        check_samples(&seen, topic);
    }
    for sample in seen.samples(TOPICS[0]) {
        let message = &sample["message"];
        let pose = &message["pose"]["pose"];
        assert_eq!(
            (&message["header"]["frame_id"], &message["child_frame_id"]),
            (&"odom".into(), &"base_link".into())
        );
        is_computed(&seen.computed, stamp_ns(&message["header"]), &pose["position"], &pose["orientation"]);
        for part in ["pose", "twist"] {
            check_covariance(&message[part]["covariance"]);
        }
    }
    for sample in seen.samples(TOPICS[1]) {
        let (header, pose) = (&sample["message"]["header"], &sample["message"]["pose"]);
        assert_eq!(header["frame_id"], "odom");
        is_computed(&seen.computed, stamp_ns(header), &pose["position"], &pose["orientation"]);
    }
    let mut in_map = 0;
    for sample in seen.samples(TOPICS[2]) {
        let transforms = sample["message"]["transforms"].as_array().unwrap();
        let names: Vec<_> =
            transforms.iter().map(|t| [&t["header"]["frame_id"], &t["child_frame_id"]]).collect();
        let vehicle = names.len() - 2;
        assert_eq!(names[vehicle..], [["odom", "base_link"], ["base_link", "body"]]);
        // The first keyframe is the map; from then on it is known where the odometry lies in it.
        in_map += vehicle;
        assert!(vehicle == usize::from(in_map > 0), "{names:?} after {in_map} in the map");
        if vehicle == 1 {
            assert_eq!(names[0], ["map", "odom"]);
            check_map(&transforms[0]);
        }
        let transforms = &transforms[vehicle..];
        let imu = numbers(&transforms[1]["transform"]["rotation"], "x y z w");
        let half = std::f64::consts::FRAC_1_SQRT_2;
        // x of the IMU is up, z forward: a half turn about the axis between the two.
        assert!(imu.iter().zip([half, 0.0, half, 0.0]).all(|(a, b)| (a.abs() - b).abs() < 1e-12), "{imu:?}");
        let transform = &transforms[0]["transform"];
        let stamp = stamp_ns(&transforms[0]["header"]);
        is_computed(&seen.computed, stamp, &transform["translation"], &transform["rotation"]);
    }
    assert!(in_map > 50, "{in_map} transforms from the map");
    check_twist(&seen);
}

/// Within seconds nothing has drifted, and the map is level as the odometry is.
fn check_map(transform: &Value) {
    let shift = numbers(&transform["transform"]["translation"], "x y z");
    assert!(shift.iter().all(|x| x.abs() < 0.1), "{shift:?}");
    let turn = numbers(&transform["transform"]["rotation"], "x y z w");
    assert!(turn[0].abs() < 1e-12 && turn[1].abs() < 1e-12 && turn[2].abs() < 0.02, "{turn:?}");
}

/// A node and its publishers are listed, with types that every release from Iron on hashes alike.
fn check_graph(seen: &Seen) {
    let nodes = seen.entities("NN");
    assert_eq!(nodes.len(), 1, "{nodes:?}");
    assert_eq!((&nodes[0]["namespace"], &nodes[0]["node"]), (&"/drone_1".into(), &"plumbline".into()));
    let publishers = seen.entities("MP");
    assert_eq!(publishers.len(), ALL_TOPICS.len(), "{publishers:?}");
    for (topic, name, depth) in ALL_TOPICS {
        let publisher = publishers.iter().find(|p| p["topic"] == topic).unwrap();
        check_endpoint(seen, publisher, name, depth);
    }
    assert!(seen.entities("SS").is_empty());
}

fn check_endpoint(seen: &Seen, endpoint: &Value, name: &str, depth: u64) {
    assert_eq!((&endpoint["domain"], &endpoint["node"]), (&0.into(), &"plumbline".into()));
    assert_eq!(endpoint["session"], seen.entities("NN")[0]["session"]);
    for (release, hashes) in seen.told["hashes"].as_object().unwrap() {
        assert_eq!(endpoint["hash"], hashes[name], "{name} in {release}");
    }
    let qos = &endpoint["qos"];
    assert_eq!((&qos["reliability"], &qos["durability"], &qos["history"]), (&1.into(), &2.into(), &1.into()));
    assert_eq!(qos["depth"], depth);
}

/// 50 samples a second with all that belongs to them, none lost on the loopback.
fn check_samples(seen: &Seen, topic: &str) {
    let samples = seen.samples(topic);
    let stamp = |sample: &Value| {
        let message = &sample["message"];
        stamp_ns(if topic == "/tf" { &message["transforms"][0]["header"] } else { &message["header"] })
    };
    // From the moment the machine had subscribed to the end of the flight.
    let (begun, ended) = (stamp(samples[0]), stamp(samples[samples.len() - 1]));
    assert!(
        (ended - begun) / 20_000_000 - (samples.len() as i64) < 1,
        "{} samples of {topic}",
        samples.len()
    );
    assert!(samples.len() > 100 && seen.computed.last_key_value().unwrap().0 - ended < 20_000_000);
    let publishers = seen.entities("MP");
    let publisher = publishers.iter().find(|p| p["topic"] == topic).unwrap();
    let first = samples[0]["sequence"].as_i64().unwrap();
    assert!(first <= 50, "the first {first} were not received");
    for (k, sample) in samples.iter().enumerate() {
        assert_eq!(sample["sequence"].as_i64().unwrap(), first + k as i64);
        assert_eq!(sample["gid"], publisher["gid"]);
        assert_eq!(sample["same_bytes"], true, "{topic}");
        let on_the_way_ms =
            (sample["received_ns"].as_i64().unwrap() - sample["source_ns"].as_i64().unwrap()) as f64 * 1e-6;
        // The same clock in the same unit. A busy machine may take seconds.
        assert!((0.0..10_000.0).contains(&on_the_way_ms), "{on_the_way_ms} ms");
    }
}

/// Symmetric, and positive on the diagonal.
fn check_covariance(covariance: &Value) {
    let at = |i: usize, j: usize| covariance[6 * i + j].as_f64().unwrap();
    for i in 0..6 {
        assert!(at(i, i) > 0.0, "{covariance}");
        for j in 0..i {
            assert!((at(i, j) - at(j, i)).abs() <= 1e-9 * (at(i, i) * at(j, j)).sqrt(), "{covariance}");
        }
    }
}

/// The twist is what moves the poses, told in the frame of the vehicle: one sample to the next.
fn check_twist(seen: &Seen) {
    use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
    let samples = seen.samples(TOPICS[0]);
    let pose = |sample: &Value| {
        let told = &sample["message"]["pose"]["pose"];
        let (p, q) = (numbers(&told["position"], "x y z"), numbers(&told["orientation"], "x y z w"));
        let q = UnitQuaternion::from_quaternion(Quaternion::new(q[3], q[0], q[1], q[2]));
        Isometry3::from_parts(Translation3::new(p[0], p[1], p[2]), q)
    };
    let twist = |sample: &Value, part: &str| {
        Vector3::from_vec(numbers(&sample["message"]["twist"]["twist"][part], "x y z"))
    };
    let (mut worst_m_s, mut worst_rad_s, mut compared) = (Vec::new(), Vec::new(), 0);
    for pair in samples.windows(3) {
        let stamp = |k: usize| stamp_ns(&pair[k]["message"]["header"]);
        let seconds = (stamp(2) - stamp(0)) as f64 * 1e-9;
        let (before, now, after) = (pose(pair[0]), pose(pair[1]), pose(pair[2]));
        let linear =
            now.rotation.inverse() * ((after.translation.vector - before.translation.vector) / seconds);
        let angular = (before.rotation.inverse() * after.rotation).scaled_axis() / seconds;
        worst_m_s.push((linear - twist(pair[1], "linear")).norm());
        worst_rad_s.push((angular - twist(pair[1], "angular")).norm());
        compared += 1;
    }
    // Poses are corrected in steps at every estimate: the median is what motion alone says.
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    assert!(compared > 100);
    let (linear, angular) = (median(worst_m_s), median(worst_rad_s));
    assert!(linear < 0.05, "{linear} m/s");
    assert!(angular < 0.05, "{angular} rad/s");
}

#[test]
fn a_vehicle_without_a_router_flies_and_ends_as_always() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("vehicle.toml");
    let router = format!("\"{}\"", free_endpoint());
    configuration(&config, &[("ros.enabled", "true".to_owned()), ("ros.router", router)]);
    let begun = Instant::now();
    let files = ["--duration=4", "--config", config.to_str().unwrap()];
    succeeds(&[&FLIGHT[..], &files].concat());
    assert!(begun.elapsed().as_secs() < 60, "took {:?}", begun.elapsed());
}

#[test]
fn a_router_that_comes_later_is_found() {
    let Some(python) = interpreter(PACKAGES) else { return };
    let seen = fly(&python, &[], Machine::Later);
    check_graph(&seen);
    let samples = seen.samples(TOPICS[0]);
    assert!(samples.len() > 10, "{} samples", samples.len());
    // The node begins when the router is there, not with the flight, which would be at 200 by then; a subscriber on a busy machine is
    // found some tens of samples later.
    let first = &samples[0];
    assert!(first["sequence"].as_i64().unwrap() <= 150, "{first}");
    let begun = seen.computed.first_key_value().unwrap().0;
    assert!(stamp_ns(&first["message"]["header"]) - begun > 1_000_000_000);
}

/// Measures a rate: see `.config/nextest.toml`.
mod realtime {
    use super::*;

    #[test]
    fn names_and_stamps_are_as_configured() {
        let Some(python) = interpreter(PACKAGES) else { return };
        let changes = [
            ("ros.distribution", "\"humble\""),
            ("ros.namespace", "\"/robots/one\""),
            ("ros.odom_frame", "\"world\""),
            ("ros.base_frame", "\"one/base\""),
            ("ros.body_frame", "\"one/imu\""),
            ("ros.stamp", "\"publication\""),
            ("ros.rate_hz", "10.0"),
            ("ros.tf", "false"),
            ("ros.path", "false"),
        ];
        let seen = fly(&python, &changes, Machine::Before);
        let publishers = seen.entities("MP");
        let topics: Vec<&str> = publishers.iter().map(|p| p["topic"].as_str().unwrap()).collect();
        assert_eq!(publishers.len(), 2, "{topics:?}");
        assert!(publishers.iter().all(|p| p["hash"] == "TypeHashNotSupported"));
        let samples = seen.samples("/robots/one/odom");
        let source_ns = |k: usize| samples[k]["source_ns"].as_i64().unwrap();
        let rate_hz = (samples.len() - 1) as f64 * 1e9 / (source_ns(samples.len() - 1) - source_ns(0)) as f64;
        assert!(samples.len() > 10 && (rate_hz - 10.0).abs() < 1.0, "{} at {rate_hz} Hz", samples.len());
        for sample in &samples {
            let message = &sample["message"];
            assert_eq!(
                (&message["header"]["frame_id"], &message["child_frame_id"]),
                (&"world".into(), &"one/base".into())
            );
            assert_eq!(stamp_ns(&message["header"]), sample["source_ns"].as_i64().unwrap());
        }
    }
}
