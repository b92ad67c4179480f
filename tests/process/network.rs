//! What a vehicle publishes is what it computed: two processes and a Zenoh session between them.

use std::collections::BTreeMap;
use std::net::TcpListener;
use std::process::{Command, Stdio};

#[test]
fn a_second_process_receives_what_was_computed() {
    let folder = tempfile::tempdir().unwrap();
    let trajectory = folder.path().join("out.tum");
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let command = env!("CARGO_BIN_EXE_plumbline");
    let ground = Command::new(command)
        .args(["ground", "--json", "--listen", &endpoint, "--duration", "14"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let config = folder.path().join("vehicle.toml");
    let preset = Command::new(command).args(["config", "sim"]).output().unwrap().stdout;
    let preset = String::from_utf8(preset).unwrap();
    let connected: Vec<String> = preset
        .lines()
        .map(|line| match line.split('=').next().map(str::trim) {
            Some("connect") => format!("connect = [\"{endpoint}\"]"),
            _ => line.to_owned(),
        })
        .collect();
    std::fs::write(&config, connected.join("\n")).unwrap();
    let flown = Command::new(command)
        .args(["replay", "sim:room", "--start", "2", "--duration", "4", "--scale", "0.5", "--speed", "1"])
        .args([
            "--publish",
            "--config",
            config.to_str().unwrap(),
            "--trajectory",
            trajectory.to_str().unwrap(),
        ])
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
