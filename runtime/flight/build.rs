//! Compiles the messages of Foxglove and of the local socket, no protoc needed, and notes what was built from what.

use prost::Message;
use std::path::Path;
use std::process::Command;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed=proto");
    println!("cargo:rerun-if-changed=../record/proto");
    let file = "foxglove/foxglove.proto";
    prost_build::Config::new().compile_fds(protox::compile([file], ["proto"])?)?;
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).include_source_info(false).open_file(file)?;
    let bytes = compiler.file_descriptor_set().encode_to_vec();
    std::fs::write(Path::new(&std::env::var("OUT_DIR")?).join("foxglove.descriptors"), bytes)?;
    // Estimates are written by the tables of plumbline-record, as the log's messages are.
    let mut local = protox::compile(["plumbline/v1/local.proto"], ["proto", "../record/proto"])?;
    local.file.retain(|file| file.package() == "plumbline.v1.local");
    for file in &mut local.file {
        file.message_type.retain(|message| message.name() != "FullEstimate");
        // Comments, which are found by the places of the messages.
        file.source_code_info = None;
    }
    prost_build::Config::new().compile_fds(local)?;
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
