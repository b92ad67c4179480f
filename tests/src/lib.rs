//! Common parts of the system tests: the places of the shared data, and the flights.

use plumbline_lab::campaign::{CampaignFault, Entry};
use plumbline_simulator::Scene;
use std::path::PathBuf;

/// The folder of shared data where it holds `what`; else the test is to skip itself.
#[must_use]
pub fn shared(what: &str) -> Option<PathBuf> {
    plumbline_test_support::shared(what).and_then(|_| plumbline_test_support::shared(""))
}

/// A simulated flight along a real trajectory, from 15 s into it.
#[must_use]
pub fn entry(
    path: &str,
    scene: (&'static str, Scene),
    seed: u64,
    duration_s: f64,
    fault: CampaignFault,
) -> Option<Entry> {
    let trajectories = shared("euroc/trajectories")?.join("euroc/trajectories");
    Some(Entry::new(&trajectories, (path, 15.0), scene, seed, duration_s, fault))
}
