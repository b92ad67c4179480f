//! What the system tests and the benchmarks share: where the shared data are, the flights they fly, and
//! detectors of line segments with the images to judge them by.

pub mod flow;
pub mod lines;

use plumbline::campaign::{Entry, Fault};
use plumbline_drivers::simulator::Scene;
use std::path::PathBuf;

/// The folder of shared data: the environment variable `PLUMBLINE_SHARED`, else `../shared` beside the
/// workspace. `None`, and a word on what is skipped, when it is not there.
#[must_use]
pub fn shared(what: &str) -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared");
    let folder = std::env::var_os("PLUMBLINE_SHARED").map_or_else(|| beside.into(), PathBuf::from);
    if folder.join(what).exists() {
        return Some(folder);
    }
    println!("skipped: {} is not there (set PLUMBLINE_SHARED)", folder.join(what).display());
    None
}

/// A simulated flight along a real trajectory, from 15 s into it.
#[must_use]
pub fn entry(
    path: &str,
    scene: (&'static str, Scene),
    seed: u64,
    duration_s: f64,
    fault: Fault,
) -> Option<Entry> {
    let trajectories = shared("euroc/trajectories")?.join("euroc/trajectories");
    Some(Entry::new(&trajectories, (path, 15.0), scene, seed, duration_s, fault))
}
