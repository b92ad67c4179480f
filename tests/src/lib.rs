//! Common parts of the system tests: the places of the shared data, and the flights.

use plumbline_flight::flight::{Flight, fly, open_simulation};
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_lab::report::Report;
use plumbline_simulator::{FlightPath, Scenario, Scene};
use plumbline_test_support::kept;
use std::path::PathBuf;

/// The folder of shared data where it holds `what`; else the test is to skip itself.
pub fn shared(what: &str) -> Option<PathBuf> {
    plumbline_test_support::shared(what).and_then(|_| plumbline_test_support::shared(""))
}

/// A simulated flight along a real trajectory, from 15 s into it, in images of half the size: fewer points, each with more noise.
pub fn along(path: &str, scene: Scene, duration_s: f64) -> Option<Scenario> {
    let file = shared("euroc/trajectories")?.join(format!("euroc/trajectories/{path}.tum.gz"));
    let path = FlightPath::Tum(file);
    Some(Scenario { scene, path, start_s: 15.0, duration_s, resolution_scale: 0.5, ..Scenario::default() })
}

/// A flight whose frames are rendered once for all tests.
pub fn simulated(scenario: &Scenario) -> Flight {
    let _alone = kept::alone(&format!("{scenario:?}"));
    open_simulation(None, scenario, false, 0.0, Some(&kept::folder())).expect("it is rendered")
}

/// Flies as fast as it goes, and sums the flight up.
pub fn reported(flight: Flight) -> Report {
    let options = RunOptions { speed: None, threads: 2 };
    let report = Report::new(&fly(flight, &options, &Control::default(), vec![]).expect("it flies"));
    println!("{}", report.summary());
    report
}
