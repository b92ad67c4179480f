//! The Python package `lab/`, by its own tests.

use super::python::interpreter;
use std::path::Path;
use std::process::Command;

const PACKAGES: &str =
    "pytest, allantools, distributed, evo, mcap_protobuf, pyarrow, rosbags, tabulate, tomlkit, tqdm";

#[test]
fn the_experiments_pass_their_tests() {
    let Some(python) = interpreter(PACKAGES) else { return };
    crate::done(
        Command::new(python)
            .args(["-m", "pytest", "-q", "-p", "no:cacheprovider", "lab/tests"])
            .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../.."))
            .env("PYTHONPATH", "lab")
            .env("PLUMBLINE", env!("CARGO_BIN_EXE_plumbline")),
    );
}
