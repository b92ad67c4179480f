//! Files and live server for Foxglove, read by other implementations than ours and compared with Foxglove's own definitions.

use super::dataset::Folder;
use super::python::interpreter;
use super::vehicle::{PLUMBLINE, Running, flight, free_port, render};
use super::{fails, plumbline, succeeds};
use plumbline_test_support::shared;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

const PACKAGES: &str = "foxglove_schemas_protobuf, mcap, websockets";

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

fn peer(python: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(python);
    command.arg(repository("tests/python/foxglove_peer.py")).args(arguments);
    command
}

/// Output of the peer after a successful run.
fn told(python: &Path, arguments: &[&str]) -> Value {
    let output = crate::done(peer(python, arguments));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn keyframes(scene: &Value) -> usize {
    let ids = scene["ids"].as_array().unwrap();
    ids.iter().filter(|id| id.as_str().unwrap().starts_with("keyframe ")).count()
}

#[test]
fn an_export_of_a_log_holds_scene_path_and_images_in_foxgloves_schemas() {
    let Some(python) = interpreter(PACKAGES) else { return };
    let folder = Folder::new();
    let (log, out) = (folder.at("log.mcap"), folder.at("scene.mcap"));
    let flown = ["replay", "sim:room", "--start", "2", "--duration", "5", "--scale", "0.5", "--record", &log];
    assert!(plumbline(&flown).status.success());
    succeeds(&["log", &log, "--foxglove", &out]);
    let seen = told(&python, &["file", &out]);
    let scene = &seen["/scene"];
    assert_eq!((&scene["schema"], &scene["frame"]), (&"foxglove.SceneUpdate".into(), &"odom".into()));
    // Every half second the window, and what left it.
    assert!(scene["messages"].as_u64().unwrap() > 8 && keyframes(scene) >= 2, "{scene}");
    assert!(scene["spheres"].as_u64().unwrap() > 100 && scene["lines"].as_u64().unwrap() > 20, "{scene}");
    assert!(seen["/path"]["poses"].as_u64().unwrap() >= 20, "{}", seen["/path"]);
    assert_eq!((&seen["/tf"]["frame"], &seen["/tf"]["child"]), (&"odom".into(), &"body".into()));
    for topic in ["/pose", "/tf_static", "/input/left", "/input/right", "/calibration/left", "/event"] {
        assert!(seen[topic]["messages"].as_u64().unwrap() > 0, "{topic}: {seen}");
    }
    // The log itself has the schemas too, and stays as it was.
    let of_log = told(&python, &["file", &log]);
    assert!(
        of_log["/scene"].is_null() && of_log["/pose"]["messages"] == seen["/pose"]["messages"],
        "{of_log}"
    );
    assert!(plumbline(&["verify", &log]).status.success());
    fails(&["log", &log, "--foxglove", &out], 2, &["scene.mcap", "exists"]);
    fails(&["log", &log, "--foxglove", &folder.at("scene.txt")], 2, &["ending .mcap"]);
    let layout = std::fs::read_to_string(repository("packaging/foxglove/plumbline.json")).unwrap();
    check_layout(&layout, &seen);
}

/// Every topic of the layout is one of an export, or one of the live server.
fn check_layout(layout: &str, exported: &Value) {
    let layout: Value = serde_json::from_str(layout).unwrap();
    let panels = layout["configById"].as_object().unwrap();
    let scene = panels.iter().find(|(id, _)| id.starts_with("3D!")).unwrap().1;
    let (mut of_log, mut live) = (0, 0);
    for topic in scene["topics"].as_object().unwrap().keys() {
        match topic.strip_prefix("/drone/") {
            Some(name) => {
                assert!(["pose", "tf", "path", "scene", "image"].contains(&name), "{topic}");
                live += 1;
            }
            None => {
                assert!(exported[topic].is_object(), "{topic}");
                of_log += 1;
            }
        }
    }
    assert!(of_log >= 3 && live >= 3);
}

#[test]
fn a_log_without_images_is_exported_with_those_of_its_data_set() {
    let Some(python) = interpreter(PACKAGES) else { return };
    let Some(clip) = shared("euroc/V1_01_easy_clip") else { return };
    let folder = Folder::new();
    let (log, out, clip) =
        (folder.at("log.mcap"), folder.at("scene.mcap"), clip.to_str().unwrap().to_owned());
    let lean = ["--frames", "0..40", "--record", &log, "--set", "recorder.images=none"];
    assert!(plumbline(&[&["replay", &clip][..], &lean].concat()).status.success());
    fails(&["log", &log, "--foxglove", &out], 1, &["log.mcap", "--images"]);
    assert!(!Path::new(&out).exists(), "no half file is left");
    succeeds(&["log", &log, "--foxglove", &out, "--images", &clip]);
    let seen = told(&python, &["file", &out]);
    assert!(seen["/scene"]["spheres"].as_u64().unwrap() > 100, "{}", seen["/scene"]);
}

/// A station that serves Foxglove, and where.
struct Station {
    child: Child,
    stdout: BufReader<ChildStdout>,
    foxglove: String,
}

impl Station {
    fn start(connect: &str) -> Self {
        let mut child = Command::new(PLUMBLINE)
            .args(["ground", "--plain", "--http=127.0.0.1:0", "--foxglove=127.0.0.1:0", "--listen", connect])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let mut find = |begins: &str| {
            let mut line = String::new();
            while !line.contains(begins) {
                line.clear();
                assert!(stdout.read_line(&mut line).unwrap() > 0, "no {begins}");
            }
            line[line.find(begins).unwrap()..].trim().to_owned()
        };
        let foxglove = find("ws://");
        Self { child, stdout, foxglove }
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = self.stdout.read_to_end(&mut Vec::new());
    }
}

#[test]
fn a_flight_is_seen_live_by_several_clients_and_a_slow_one_is_told_what_it_missed() {
    let Some(python) = interpreter(PACKAGES) else { return };
    render(20);
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let station = Station::start(&endpoint);
    let mut vehicle = flight("drone", 20);
    vehicle.args(["--connect", &endpoint]);
    let _vehicle = Running::start(vehicle);
    // One that subscribes two hundred times and reads nothing.
    let mut slow = peer(&python, &["slow", &station.foxglove, "--topic", "/drone/scene"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(slow.stdout.take().unwrap());
    let mut line = String::new();
    lines.read_line(&mut line).unwrap();
    assert_eq!(line, "subscribed\n");
    // The others see the flight meanwhile.
    let others: Vec<Child> = (0..2)
        .map(|_| {
            let arguments = ["live", &station.foxglove, "--poses", "60", "--scenes", "4"];
            peer(&python, &arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
        })
        .collect();
    for other in others {
        let output = other.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        check_live(&serde_json::from_slice(&output.stdout).unwrap());
    }
    slow.stdin.take().unwrap().write_all(b"read\n").unwrap();
    line.clear();
    lines.read_line(&mut line).unwrap();
    let statuses: Value = serde_json::from_str(&line).unwrap();
    assert_eq!(statuses[0]["level"], 1);
    assert!(statuses[0]["message"].as_str().unwrap().contains("too slow"), "{statuses}");
    assert!(slow.wait().unwrap().success());
    let refused = told(&python, &["wrong", &station.foxglove]);
    assert_eq!((&refused["no protocol"], &refused["another protocol"]), (&400.into(), &400.into()));
    assert_eq!((&refused["another origin"], &refused["Foxglove's page"]), (&403.into(), &Value::Null));
    assert!(refused["statuses"][2].as_str().unwrap().contains("no channel 999"), "{refused}");
}

fn check_live(told: &Value) {
    let topics = &told["topics"];
    let pose = &topics["/drone/pose"];
    assert_eq!((&pose["schema"], &pose["frame"]), (&"foxglove.PoseInFrame".into(), &"drone/odom".into()));
    assert!(pose["last_ns"].as_u64() > pose["first_ns"].as_u64() && told["time_ns"].as_u64() > Some(0));
    assert_eq!(topics["/drone/tf"]["child"], "drone/body");
    assert!(topics["/drone/scene"]["spheres"].as_u64().unwrap() > 50, "{topics}");
    assert!(topics["/drone/path"]["poses"].as_u64().unwrap() > 0, "{topics}");
    assert_eq!(topics["/events"]["schema"], "foxglove.Log");
}
