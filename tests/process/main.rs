//! System tests of the command: real processes, real files, a real Zenoh session.

mod bad_input;
mod bags;
mod browser;
mod c_library;
mod calibrate;
mod cgroup;
mod connections;
mod damaged_recording;
mod dataset;
mod dds;
mod digests;
mod doctor;
mod example;
mod exit_status;
mod firmware;
mod foxglove;
mod hardware;
mod host;
mod import;
mod install;
mod lab;
mod live_stamps;
mod local;
mod log;
mod maps;
mod mounted;
mod mounting;
mod network;
mod other_processor;
mod own_camera;
mod python;
mod python_package;
mod raw;
mod realtime;
mod replay;
mod reports;
mod roles;
mod ros;
#[cfg(feature = "sabotage")]
mod sabotage;
mod security;
mod setup;
mod sound;
mod supervised;
mod terminal;
mod troubleshooting;
mod usage;
mod vehicle;

use serde_json::Value;
use std::borrow::BorrowMut;
use std::path::Path;
use std::process::{Command, Output};

/// The command under test.
fn plumbline(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_plumbline")).args(arguments).output().expect("the command runs")
}

/// Output of the command, which succeeds.
fn succeeds(arguments: &[&str]) -> Output {
    done(Command::new(env!("CARGO_BIN_EXE_plumbline")).args(arguments))
}

/// Output of a process that succeeds.
fn done(mut command: impl BorrowMut<Command>) -> Output {
    let output = command.borrow_mut().output().expect("the command runs");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{:?}: {said}{}", command.borrow(), stderr(&output));
    output
}

/// Content of a file.
fn json(path: impl AsRef<Path>) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Text on stderr.
fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The command fails with `status`, and its one line on stderr names all of `parts`.
fn fails(arguments: &[&str], status: i32, parts: &[&str]) {
    let output = plumbline(arguments);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(status), "{arguments:?}: {message}");
    assert_eq!(message.trim_end().lines().count(), 1, "{arguments:?}: {message}");
    assert!(!message.contains("panicked"), "{message}");
    for part in parts {
        assert!(message.contains(part), "{arguments:?}: '{part}' is missing in: {message}");
    }
}
