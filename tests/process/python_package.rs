//! The Python package as it is installed, by its own tests (`tests/python/test_*.py`).
//!
//! Here the module is that of the build under test, laid out as in a wheel; `make wheel-test` runs the same tests with the
//! wheel, in fresh environments of the oldest and the newest Python.

use super::python::interpreter;
use std::path::{Path, PathBuf};
use std::process::Command;

const PACKAGES: &str = "pytest, numpy, matplotlib, nbclient, ipykernel, mypy";

/// The extension module, which cargo builds beside these tests.
fn module() -> PathBuf {
    let tests = std::env::current_exe().unwrap();
    tests.with_file_name("libplumbline_python.so")
}

/// Lays the package out in `folder`.
fn install(package: &Path, folder: &Path) {
    let into = folder.join("plumbline");
    std::fs::create_dir(&into).unwrap();
    for entry in std::fs::read_dir(package).unwrap() {
        let entry = entry.unwrap();
        if entry.path().is_file() {
            std::fs::copy(entry.path(), into.join(entry.file_name())).unwrap();
        }
    }
    std::fs::copy(module(), into.join("_native.abi3.so")).unwrap();
}

#[test]
fn the_python_package_passes_its_tests() {
    let Some(python) = interpreter(PACKAGES) else { return };
    let project = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap();
    let folder = tempfile::tempdir().unwrap();
    install(&project.join("runtime/python/package/plumbline"), folder.path());
    let shared = plumbline_test_support::shared("").unwrap_or_else(|| project.join("../shared"));
    let output = Command::new(python)
        .args(["-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/python"])
        .current_dir(&project)
        .env("PYTHONPATH", folder.path())
        .env("PLUMBLINE_COMMAND", env!("CARGO_BIN_EXE_plumbline"))
        .env("PLUMBLINE_SHARED", shared)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", super::stderr(&output));
}
