//! Nodes on DDS: another process receives what examples/send_dds.py reads from the local socket.

use crate::local::{Flight, READ_S, connected};
use crate::vehicle::Running;
use plumbline_test_support::{Need, skip};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Settings of Cyclone DDS: loopback alone.
const CYCLONE: &str = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\"/></Interfaces>\
    <AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>\
    <Peers><Peer address=\"localhost\"/></Peers></Discovery></Domain></CycloneDDS>";
/// Settings of Fast DDS: loopback alone.
const FAST: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <transport_descriptors><transport_descriptor><transport_id>lo</transport_id><type>UDPv4</type>
    <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList></transport_descriptor></transport_descriptors>
  <participant profile_name="lo" is_default_profile="true"><rtps>
    <userTransports><transport_id>lo</transport_id></userTransports><useBuiltinTransports>false</useBuiltinTransports>
    <builtin><initialPeersList><locator><udpv4><address>127.0.0.1</address></udpv4></locator></initialPeersList></builtin>
  </rtps></participant>
</profiles>"#;
/// Messages that a node waits for.
const COUNT: &str = "1000";

fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

#[test]
fn a_node_on_cyclone_dds_receives_the_odometry_of_the_socket() {
    let Some(python) = crate::python::interpreter("cyclonedds") else { return };
    let mut peer = Command::new(&python);
    receives(&python, peer.arg(project("tests/python/dds_peer.py")).env("CYCLONEDDS_URI", CYCLONE));
}

#[test]
fn a_node_on_fast_dds_receives_the_odometry_of_the_socket() {
    let Some(python) = crate::python::interpreter("cyclonedds") else { return };
    let folder = tempfile::tempdir().unwrap();
    let [program, profiles] = ["peer", "lo.xml"].map(|name| folder.path().join(name));
    std::fs::write(&profiles, FAST).unwrap();
    let mut compiler = Command::new("c++");
    compiler
        .args(["-std=c++14", "-O1", "-Wall", "-o"])
        .arg(&program)
        .arg(project("tests/c/fastdds_peer.cpp"));
    let compiled = compiler.args(["-lfastrtps", "-lfastcdr", "-Wl,--allow-shlib-undefined"]).output();
    if !compiled.as_ref().is_ok_and(|output| output.status.success()) {
        let words = compiled.map(|output| String::from_utf8_lossy(&output.stderr).into_owned());
        let is_here = words.as_ref().is_ok_and(|words| !words.contains("No such file"));
        assert!(!is_here, "{words:?}");
        return skip(Need::FastDds, "its headers are not there (libfastrtps-dev)");
    }
    receives(&python, Command::new(program).env("FASTRTPS_DEFAULT_PROFILES_FILE", profiles));
}

/// Sends the odometry of a flight to a node: `peer TOPIC COUNT` prints a line, then the messages.
fn receives(python: &Path, peer: &mut Command) {
    let name = Path::new(peer.get_program()).file_stem().unwrap().to_string_lossy().into_owned();
    let topic = format!("/{name}_{}/odom", std::process::id());
    let peer = peer.args([&topic, COUNT]).stderr(Stdio::inherit()).stdout(Stdio::piped()).spawn().unwrap();
    let flight = Flight::new(READ_S);
    let vehicle = Running::start(flight.command());
    drop(connected(&flight.socket()));
    let mut sender = Command::new(python);
    sender
        .arg(project("examples/send_dds.py"))
        .arg(flight.socket())
        .arg(&topic)
        .env("CYCLONEDDS_URI", CYCLONE);
    let sent = sender.status().unwrap();
    assert!(sent.success());
    flight.finish(vehicle);
    let output = peer.wait_with_output().unwrap();
    let said = String::from_utf8(output.stdout).unwrap();
    let seen: Vec<Value> = serde_json::from_str(said.lines().nth(1).unwrap()).unwrap();
    println!("{} messages; {}", seen.len(), seen.last().unwrap());
    assert!(seen.len() >= 1000, "{}", seen.len());
    let number = |m: &Value, pointer: &str| m.pointer(pointer).and_then(Value::as_f64).unwrap();
    assert!(seen.is_sorted_by(|a, b| number(a, "/stamp_ns") < number(b, "/stamp_ns")));
    for message in &seen {
        assert_eq!(message["frames"], serde_json::json!(["odom", "body"]));
        let square: f64 = (0..4).map(|k| number(message, &format!("/orientation/{k}")).powi(2)).sum();
        assert!((square - 1.0).abs() < 1e-9, "{message}");
        let variances = (0..6)
            .map(|k| 7 * k)
            .flat_map(|k| [format!("/covariance/{k}"), format!("/twist_covariance/{k}")]);
        assert!(variances.into_iter().all(|pointer| number(message, &pointer) >= 0.0), "{message}");
    }
    // The velocity in the body is that of the positions: means over half a second.
    let way: f64 = (0..3)
        .map(|k| {
            let at = |m: &Value| number(m, &format!("/position/{k}"));
            (at(&seen[900]) - at(&seen[800])).powi(2)
        })
        .sum::<f64>()
        .sqrt();
    let speed = |m: &Value| (0..3).map(|k| number(m, &format!("/linear/{k}")).powi(2)).sum::<f64>().sqrt();
    let mean = seen[800..900].iter().map(speed).sum::<f64>() / 100.0;
    let span_s = (number(&seen[900], "/stamp_ns") - number(&seen[800], "/stamp_ns")) * 1e-9;
    assert!(
        way / span_s <= mean * 1.1 + 0.02 && way / span_s >= mean * 0.5 - 0.02,
        "{way} m in {span_s} s, {mean} m/s"
    );
}
