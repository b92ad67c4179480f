//! Notes what was built from what.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    note("PLUMBLINE_COMMIT", git(&["rev-parse", "--short=16", "HEAD"]));
    note("PLUMBLINE_TARGET", std::env::var("TARGET").ok());
    note("PLUMBLINE_TARGET_FEATURES", std::env::var("CARGO_CFG_TARGET_FEATURE").ok());
    let compiler = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    note("PLUMBLINE_RUSTC", output(&compiler, &["--version"]));
    // Grows with every commit; without git there is none to follow.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]).filter(|log| Path::new(log).exists()) {
        println!("cargo:rerun-if-changed={log}");
    }
}

fn note(variable: &str, value: Option<String>) {
    println!("cargo:rustc-env={variable}={}", value.unwrap_or_else(|| "unknown".into()));
}

fn git(arguments: &[&str]) -> Option<String> {
    output("git", arguments)
}

/// Output of a command, if it succeeds.
fn output(command: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(command).args(arguments).output().ok().filter(|o| o.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned()).filter(|text| !text.is_empty())
}
