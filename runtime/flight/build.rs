//! Compiles the format of the log, no protoc needed, and notes what was built from what.

use prost::Message;
use std::path::Path;
use std::process::Command;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed=proto");
    let files = ["plumbline/v1/log.proto", "foxglove/foxglove.proto"];
    let descriptors = protox::compile(files, ["proto"])?;
    prost_build::Config::new().compile_fds(descriptors)?;
    // Beside the log's messages, which it carries.
    let local = protox::compile(["plumbline/v1/local.proto"], ["proto"])?;
    let mut messages = prost_build::Config::new();
    messages.extern_path(".plumbline.v1.log", "crate::log::proto").compile_fds(local)?;
    let out = std::env::var("OUT_DIR")?;
    for (file, name) in [(files[0], "log"), (files[1], "foxglove")] {
        let mut compiler = protox::Compiler::new(["proto"])?;
        compiler.include_imports(true).include_source_info(false).open_file(file)?;
        let bytes = compiler.file_descriptor_set().encode_to_vec();
        std::fs::write(Path::new(&out).join(format!("{name}.descriptors")), bytes)?;
    }
    note("PLUMBLINE_COMMIT", git(&["rev-parse", "--short=16", "HEAD"]));
    note("PLUMBLINE_TARGET", std::env::var("TARGET").ok());
    note("PLUMBLINE_TARGET_FEATURES", std::env::var("CARGO_CFG_TARGET_FEATURE").ok());
    let compiler = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    note("PLUMBLINE_RUSTC", output(&compiler, &["--version"]));
    // Grows with every commit; without git there is none to follow.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]).filter(|log| Path::new(log).exists()) {
        println!("cargo:rerun-if-changed={log}");
    }
    Ok(())
}

fn note(variable: &str, value: Option<String>) {
    println!("cargo:rustc-env={variable}={}", value.unwrap_or_else(|| "unknown".into()));
}

fn git(arguments: &[&str]) -> Option<String> {
    output("git", arguments)
}

/// What a command says, if it succeeds.
fn output(command: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(command).args(arguments).output().ok().filter(|o| o.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned()).filter(|text| !text.is_empty())
}
