//! Compiles the wire format and the log's, no protoc needed; notes what was built from what; and compiles what looks at the
//! processor before anything else runs.

use prost::Message;
use std::path::Path;
use std::process::Command;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed=proto");
    let files = ["plumbline/v1/plumbline.proto", "plumbline/v1/log.proto", "foxglove/foxglove.proto"];
    let descriptors = protox::compile(files, ["proto"])?;
    prost_build::Config::new().compile_fds(descriptors)?;
    let out = std::env::var("OUT_DIR")?;
    for (file, name) in [(files[0], "plumbline"), (files[1], "log"), (files[2], "foxglove")] {
        let mut compiler = protox::Compiler::new(["proto"])?;
        compiler.include_imports(true).include_source_info(false).open_file(file)?;
        let bytes = compiler.file_descriptor_set().encode_to_vec();
        std::fs::write(Path::new(&out).join(format!("{name}.descriptors")), bytes)?;
    }
    note("PLUMBLINE_COMMIT", git(&["rev-parse", "--short=16", "HEAD"]));
    note("PLUMBLINE_TARGET", std::env::var("TARGET").ok());
    note("PLUMBLINE_TARGET_FEATURES", std::env::var("CARGO_CFG_TARGET_FEATURE").ok());
    let compiler = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    look_at_processor(&compiler, Path::new(&out))?;
    note("PLUMBLINE_RUSTC", output(&compiler, &["--version"]));
    // Grows with every commit; without git there is none to follow.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]).filter(|log| Path::new(log).exists()) {
        println!("cargo:rerun-if-changed={log}");
    }
    Ok(())
}

/// `early/processor.rs`, for the oldest x86-64, into the command; other processors have one level only.
fn look_at_processor(compiler: &str, out: &Path) -> Result<(), Box<dyn std::error::Error>> {
    const SOURCE: &str = "early/processor.rs";
    println!("cargo:rerun-if-changed={SOURCE}");
    let of_target = |name: &str| std::env::var(format!("CARGO_CFG_TARGET_{name}")).unwrap_or_default();
    if (of_target("ARCH").as_str(), of_target("OS").as_str()) != ("x86_64", "linux") {
        return Ok(());
    }
    let object = out.join("processor.o");
    let mut command = Command::new(compiler);
    command.args(["--edition=2024", "--crate-name=processor", "--crate-type=lib", "--target"]);
    command.arg(std::env::var("TARGET")?).arg(SOURCE).arg(format!("--emit=obj={}", object.display()));
    command.args(
        ["target-cpu=x86-64", "opt-level=2", "panic=abort", "codegen-units=1"].map(|o| format!("-C{o}")),
    );
    command.args(["-Dwarnings"]).env("PLUMBLINE_TARGET_FEATURES", of_target("FEATURE"));
    if !command.status()?.success() {
        return Err(format!("{SOURCE} was not compiled").into());
    }
    println!("cargo:rustc-link-arg-bins={}", object.display());
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
