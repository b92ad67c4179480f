//! System tests of the command: real processes, real files, a real Zenoh session.

mod errors;
mod network;
mod replay;

use std::process::{Command, Output};

/// The command under test.
fn plumbline(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_plumbline")).args(arguments).output().expect("the command runs")
}

/// What it said on stderr.
fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
