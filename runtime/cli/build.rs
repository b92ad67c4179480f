//! Compiles what looks at the processor before anything else runs.

use std::path::Path;
use std::process::Command;

/// `early/processor.rs`, for the oldest x86-64, into the command; other processors have one level only.
fn main() -> Result<(), Box<dyn std::error::Error>> {
    const SOURCE: &str = "early/processor.rs";
    println!("cargo:rerun-if-changed={SOURCE}");
    let of_target = |name: &str| std::env::var(format!("CARGO_CFG_TARGET_{name}")).unwrap_or_default();
    if (of_target("ARCH").as_str(), of_target("OS").as_str()) != ("x86_64", "linux") {
        return Ok(());
    }
    let object = Path::new(&std::env::var("OUT_DIR")?).join("processor.o");
    let mut command = Command::new(std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into()));
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
