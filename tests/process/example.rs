//! The example in Python reads a vehicle as its first lines say.

use super::python::{FLIGHT, Program, free_endpoint, interpreter};
use super::stderr;
use std::path::Path;
use std::process::{Command, Stdio};

/// Two programs that play the same inertial sensor, of which the older one ends.
const RESTARTED: &str = r#"
import importlib.util, os, sys
spec = importlib.util.spec_from_file_location("send_imu", sys.argv[1])
send_imu = importlib.util.module_from_spec(spec)
spec.loader.exec_module(send_imu)
old, new = (send_imu.Device(sys.argv[2], 200) for _ in range(2))
terminal = os.readlink(sys.argv[2])
old.unplug()
assert os.readlink(sys.argv[2]) == terminal, "the new program's device is gone"
new.unplug()
assert not os.listdir(os.path.dirname(sys.argv[2]))
"#;

#[test]
fn the_end_of_an_older_inertial_example_leaves_the_link_of_the_newer_one() {
    let folder = tempfile::tempdir().unwrap();
    let example = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/send_imu.py");
    let arguments = ["-c", RESTARTED, example];
    crate::done(Command::new("python3").args(arguments).arg(folder.path().join("imu")));
}

/// The example in a folder of its own, with the Python of the schemas as its first lines have it made.
fn with_schemas(python: &Path) -> tempfile::TempDir {
    let (root, folder) =
        (Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")), tempfile::tempdir().unwrap());
    std::fs::copy(root.join("examples/read_pose.py"), folder.path().join("read_pose.py")).unwrap();
    let mut compiler = Command::new(python);
    compiler
        .args(["-m", "grpc_tools.protoc", "-I", "runtime/record/proto", "--python_out"])
        .arg(folder.path());
    compiler.args(["plumbline/v1/log.proto", "plumbline/v1/plumbline.proto"]).current_dir(root);
    assert!(compiler.status().unwrap().success());
    folder
}

/// The vehicle is rendered as it flies, and loses its way on a host that is busy: see `.config/nextest.toml`.
mod realtime {
    use super::*;

    #[test]
    fn the_example_prints_pose_quality_latency_and_the_configuration() {
        let Some(python) = interpreter("grpc_tools, zenoh") else { return };
        let endpoint = free_endpoint();
        let mut vehicle = Command::new(env!("CARGO_BIN_EXE_plumbline"));
        vehicle.args(FLIGHT).args(["--duration=12", "--listen", &endpoint, "--json"]);
        let vehicle = vehicle.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let folder = with_schemas(&python);
        let example = folder.path().join("read_pose.py");
        let example = Program::start(&python, example.to_str().unwrap(), &[endpoint.as_str(), "10"]);
        let text = example.rest();
        let flown = vehicle.wait_with_output().unwrap();
        assert!(flown.status.success(), "{}", stderr(&flown));
        let report: serde_json::Value = serde_json::from_slice(&flown.stdout).unwrap();
        let configuration = text.lines().find_map(|line| line.strip_prefix("configuration ")).unwrap();
        assert_eq!(configuration, report["config_hash"]);
        let lines: Vec<&str> = text.lines().filter(|line| line.contains(" tracking ")).collect();
        assert!(lines.len() >= 3, "{text}");
        for line in lines {
            let words: Vec<&str> = line.split_whitespace().collect();
            let after = |word: &str| words.iter().position(|w| *w == word).map(|k| words[k + 1]).unwrap();
            assert!((1..=100).contains(&after("quality").parse::<i32>().unwrap()), "{line}");
            assert!((0.0..1000.0).contains(&after("latency").parse::<f64>().unwrap()), "{line}");
            assert!(after("position").parse::<f64>().unwrap().is_finite(), "{line}");
        }
    }
}
