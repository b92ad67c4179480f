//! Compiles the wire format, no protoc needed.

use prost::Message;
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed=proto");
    let file = "plumbline/v1/plumbline.proto";
    let descriptors = protox::compile([file], ["proto"])?;
    prost_build::Config::new().compile_fds(descriptors)?;
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).include_source_info(false).open_file(file)?;
    let bytes = compiler.file_descriptor_set().encode_to_vec();
    std::fs::write(Path::new(&std::env::var("OUT_DIR")?).join("plumbline.descriptors"), bytes)?;
    Ok(())
}
