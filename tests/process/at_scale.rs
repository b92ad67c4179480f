//! The scripts of `docs/at-scale.md` that can run here: sweep and verification with GNU parallel on this machine.

use super::{plumbline, stderr};
use plumbline_test_support::{Need, skip};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/at-scale").join(name)
}

/// True if GNU parallel is installed; reports the skip if not.
fn has_parallel() -> bool {
    let version = Command::new("parallel").arg("--version").output();
    let found = version.is_ok_and(|v| String::from_utf8_lossy(&v.stdout).starts_with("GNU parallel"));
    if !found {
        skip(Need::Parallel, "GNU parallel is not installed (apt-get install parallel)");
    }
    found
}

fn run(name: &str, folder: &Path, arguments: &[&str]) -> Output {
    Command::new(script(name))
        .current_dir(folder)
        .env("PLUMBLINE", env!("CARGO_BIN_EXE_plumbline"))
        .args(arguments)
        .output()
        .unwrap()
}

#[test]
fn a_sweep_with_gnu_parallel_is_the_sweep_of_one_process() {
    if !has_parallel() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let arguments =
        ["--set", "estimator.lines.enabled=true,false", "sim:room?duration=1.5&scale=0.4", "--seeds", "1,2"];
    let spread = run("sweep-parallel.sh", folder.path(), &[&[":", "cells"], &arguments[..]].concat());
    assert!(spread.status.success(), "{}", stderr(&spread));
    let out = folder.path().join("own.csv").to_str().unwrap().to_owned();
    let own = plumbline(&[&["sweep"], &arguments[..], &["--out", &out]].concat());
    assert!(own.status.success(), "{}", stderr(&own));
    // Times differ; everything that depends on the data is the same.
    let without_times = |path: &Path| {
        let text = std::fs::read_to_string(path).unwrap();
        let head: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let row = |line: &str| {
            let cells = line.split(',').zip(&head).filter(|(_, name)| !name.starts_with("frame_cpu_ms"));
            cells.map(|(cell, _)| cell).collect::<Vec<_>>().join(",")
        };
        text.lines().map(row).collect::<Vec<_>>()
    };
    let spread = without_times(&folder.path().join("cells/results.csv"));
    assert_eq!(spread.len(), 5);
    assert_eq!(spread, without_times(Path::new(&out)));
}

#[test]
fn many_logs_are_verified_with_gnu_parallel_and_in_one_process() {
    if !has_parallel() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let logs = ["a.mcap", "b.mcap", "c.mcap"].map(at);
    for (seed, log) in ["1", "2", "3"].iter().zip(&logs) {
        let flown = plumbline(&[
            "replay",
            "sim:room",
            "--duration",
            "1.5",
            "--scale",
            "0.4",
            "--seed",
            seed,
            "--record",
            log,
        ]);
        assert!(flown.status.success(), "{}", stderr(&flown));
    }
    let logs = logs.each_ref().map(String::as_str);
    let spread = run("verify-parallel.sh", folder.path(), &[&[":", "verified"], &logs[..]].concat());
    assert!(spread.status.success(), "{}{}", String::from_utf8_lossy(&spread.stdout), stderr(&spread));
    assert!(String::from_utf8_lossy(&spread.stdout).contains("3 of 3 logs are bit-identical"));
    let own = plumbline(&[&["verify", "--jobs", "2"], &logs[..]].concat());
    assert!(own.status.success(), "{}", stderr(&own));
    assert!(String::from_utf8_lossy(&own.stdout).contains("3 of 3 logs are bit-identical"));

    // One that lost its end: both say so, and fail.
    let bytes = std::fs::read(logs[1]).unwrap();
    std::fs::write(logs[1], &bytes[..bytes.len() / 2]).unwrap();
    let spread = run("verify-parallel.sh", folder.path(), &[&[":", "again"], &logs[..]].concat());
    let said = String::from_utf8_lossy(&spread.stdout).into_owned();
    assert!(!spread.status.success() && said.contains("2 of 3 logs") && said.contains("b.mcap"), "{said}");
    let own = plumbline(&[&["verify"], &logs[..]].concat());
    let said = String::from_utf8_lossy(&own.stdout).into_owned();
    assert_eq!(own.status.code(), Some(1));
    assert!(said.contains("2 of 3 logs are bit-identical") && said.contains("FAILED"), "{said}");
    assert!(stderr(&own).contains("b.mcap"), "{}", stderr(&own));
}
