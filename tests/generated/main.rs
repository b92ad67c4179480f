//! What is made of declarations: docstrings in the stubs of the Python module are made anew here and compared (`make messages` writes
//! them).

mod stubs;

use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

#[test]
fn docstrings_of_the_stubs_are_those_of_the_module() {
    let path = root().join("runtime/python/package/plumbline/_native.pyi");
    let kept = std::fs::read_to_string(&path).unwrap();
    let made = stubs::with_docstrings(&kept, &root().join("runtime/python/src"));
    if std::env::var_os("PLUMBLINE_WRITE_MESSAGES").is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    assert!(kept == made, "{}: is not what it is made of; `make messages` writes it", path.display());
}
