//! The messages of protobuf in Rust, and the descriptors that are sent with them, are in the repository: no build of the product
//! compiles a schema. Here they are made anew from the schemas, and compared; so are the docstrings in the stubs of the Python
//! module. `make messages` writes them.

mod stubs;

use prost::Message;
use std::path::{Path, PathBuf};

/// A file that is made of others, by its path in the repository.
struct Made {
    path: &'static str,
    bytes: Vec<u8>,
}

#[test]
fn generated_messages_are_those_of_the_schemas() {
    let root = root();
    let folders = |folders: &[&str]| folders.iter().map(|folder| root.join(folder)).collect::<Vec<_>>();
    let foxglove = (folders(&["runtime/flight/proto"]), "foxglove/foxglove.proto");
    check_made([
        Made { path: "runtime/flight/generated/foxglove.rs", bytes: types(compiled(&foxglove)) },
        Made { path: "runtime/flight/generated/foxglove.descriptors", bytes: descriptors(&foxglove) },
    ]);
}

#[test]
fn docstrings_of_the_stubs_are_those_of_the_module() {
    let (root, path) = (root(), "runtime/python/package/plumbline/_native.pyi");
    let kept = std::fs::read_to_string(root.join(path)).unwrap();
    let made = stubs::with_docstrings(&kept, &root.join("runtime/python/src"));
    check_made([Made { path, bytes: made.into_bytes() }]);
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Compares files with what they are made of, or writes them.
fn check_made(all: impl IntoIterator<Item = Made>) {
    let root = root();
    for made in all {
        let file = root.join(made.path);
        if std::env::var_os("PLUMBLINE_WRITE_MESSAGES").is_some() {
            std::fs::write(&file, &made.bytes).unwrap();
        }
        let kept = std::fs::read(&file).unwrap_or_default();
        assert!(kept == made.bytes, "{}: is not what it is made of; `make messages` writes it", made.path);
    }
}

/// Compilers of others make of the schema's text what the tables say.
#[test]
fn the_schema_of_the_tables_compiles() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../runtime/record/proto");
    let all = compiled(&(vec![folder], "plumbline/v1/plumbline.proto"));
    let names: Vec<_> = all.file.iter().flat_map(|file| &file.message_type).map(|m| m.name()).collect();
    assert!(names.contains(&"Envelope") && names.contains(&"Odometry"), "{names:?}");
}

/// Where schemas are looked for, and one of them.
type Schema = (Vec<PathBuf>, &'static str);

fn compiled((folders, file): &Schema) -> prost_types::FileDescriptorSet {
    protox::compile([file], folders).unwrap()
}

/// The types of all messages of one package, in Rust.
fn types(messages: prost_types::FileDescriptorSet) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    prost_build::Config::new().out_dir(folder.path()).compile_fds(messages).unwrap();
    let made: Vec<PathBuf> =
        std::fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().path()).collect();
    let [file] = made.as_slice() else { panic!("one package, and so one file, not {made:?}") };
    std::fs::read(file).unwrap()
}

/// A schema with all that it imports, as logs and the network carry it.
fn descriptors((folders, file): &Schema) -> Vec<u8> {
    let mut compiler = protox::Compiler::new(folders).unwrap();
    compiler.include_imports(true).include_source_info(false).open_file(file).unwrap();
    compiler.file_descriptor_set().encode_to_vec()
}
