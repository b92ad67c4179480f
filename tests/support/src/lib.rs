//! Common parts of the tests of all crates: the places of the data ([`shared`]), what tests make once for all ([`kept`]), and the
//! skip of a test that cannot run here ([`skip()`]). Without dependencies, so that every crate can have it.

pub mod kept;
pub mod skip;

pub use skip::{Need, skip};

use std::path::PathBuf;

/// `what` in the folder of shared data: the environment variable `PLUMBLINE_SHARED`, else `../shared` beside the
/// workspace. Where it is not there, the test is to [`skip()`] itself.
pub fn shared(what: &str) -> Option<PathBuf> {
    let path = folder("PLUMBLINE_SHARED", "../shared").join(what);
    if path.exists() {
        return Some(path);
    }
    skip(Need::SharedData, format_args!("{} is not there (set PLUMBLINE_SHARED)", path.display()));
    None
}

/// The interpreter of the tests' Python environment: in `PLUMBLINE_VENV`, else in `VENV`, which `make` sets, else in
/// `.venv` of the workspace. It may not be there.
pub fn python() -> PathBuf {
    let venv = if std::env::var_os("PLUMBLINE_VENV").is_some() { "PLUMBLINE_VENV" } else { "VENV" };
    folder(venv, ".venv").join("bin/python")
}

/// Duration of the soak tests' long flight, minutes, as `make soak SOAK_MINUTES=30` sets it. Below [`SOAK_IN_FULL_MIN`] the
/// others do less too.
pub fn soak_minutes() -> u32 {
    std::env::var("PLUMBLINE_SOAK_MINUTES")
        .ok()
        .and_then(|minutes| minutes.parse().ok())
        .unwrap_or(SOAK_IN_FULL_MIN)
}

/// From here on the soak tests do all that they can, minutes.
pub const SOAK_IN_FULL_MIN: u32 = 10;

/// The workspace.
pub fn workspace() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// A folder named by a variable, else one of the workspace.
fn folder(variable: &str, otherwise: &str) -> PathBuf {
    workspace().join(std::env::var_os(variable).map_or_else(|| otherwise.into(), PathBuf::from))
}
