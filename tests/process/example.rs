//! The example in Python reads a vehicle as its first lines say.

use super::python::{FLIGHT, Program, free_endpoint, interpreter};
use super::stderr;
use std::process::{Command, Stdio};

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
        let arguments = ["--connect", &endpoint, "--seconds", "10"];
        let example = Program::start(&python, "examples/read_pose.py", &arguments);
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
