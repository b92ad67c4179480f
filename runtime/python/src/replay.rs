//! A whole flight in virtual time, as `plumbline replay` flies it.

use crate::config::PyConfig;
use crate::errors::{RunError, of_flight};
use crate::opening::OpeningOptions;
use crate::table;
use plumbline_estimator::{Estimate, Odometry};
use plumbline_flight::flight::plausibility::watch::Watch;
use plumbline_flight::flight::{Flight, FlightError, Flown, KeptOdometry, KeptStates, Outputs, fly};
use plumbline_flight::log::WhenFull;
use plumbline_flight::pipeline::{self, Control, RunOptions};
use plumbline_lab::report::{Report, late_findings};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Period of the check for Ctrl-C.
const SIGNAL_PERIOD: Duration = Duration::from_millis(50);

/// Parts of a flight that are kept.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Keep {
    threads: usize,
    odometry: bool,
    record: Option<PathBuf>,
}

/// Result of a flight.
struct Replayed {
    flown: Flown,
    estimates: Vec<Estimate>,
    odometry: Option<Vec<Odometry>>,
    report: Report,
}

/// Runs a flight to its end; `None` when it was stopped by Ctrl-C.
fn flown(flight: Flight, keep: &Keep, control: &Arc<Control>) -> Result<Replayed, FlightError> {
    let mut outputs = Outputs::default();
    if let Some(path) = &keep.record {
        outputs.record(path, &flight, WhenFull::Wait)?;
    }
    let mut states = KeptStates::for_flight(&flight);
    let mut odometry = keep.odometry.then(|| KeptOdometry::for_flight(&flight));
    let watch = Watch::start(&flight.config, false, flight.findings.clone(), None);
    let mut watch = watch.map_err(|error| pipeline::RunError::Thread(error.to_string()))?;
    let (log_end, file_defects) = (flight.log_end.clone(), flight.file_defects.clone());
    let mut subscribers = outputs.subscribers();
    subscribers.push(&mut states);
    subscribers.extend(odometry.as_mut().map(|odometry| odometry as _));
    subscribers.push(&mut watch);
    let options = RunOptions { speed: None, threads: keep.threads };
    let (flown, outputs) = (fly(flight, &options, control, subscribers), outputs.finish());
    let flown = flown?;
    let mut findings = watch.finish();
    let late = late_findings(&flown, log_end.as_ref(), &file_defects, &findings);
    findings.extend(late);
    let report = Report::new(&flown).with(outputs).warning_of(findings);
    let odometry = odometry.map(KeptOdometry::into_rows);
    Ok(Replayed { flown, estimates: states.into_rows(), odometry, report })
}

/// Runs `work` on a thread of its own, and looks for Ctrl-C meanwhile, which stops `control`.
fn interruptible<T: Send>(py: Python<'_>, control: &Control, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let (done, waiting) = mpsc::channel();
    let waiting = Mutex::new(waiting);
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().name("replay".into()).spawn_scoped(scope, move || {
            // Nobody waits any more after a panic of the other side alone.
            let _ = done.send(work());
        });
        thread.map_err(|error| RunError::new_err(format!("cannot start a thread: {error}")))?;
        let mut interrupt = None;
        loop {
            match py
                .detach(|| waiting.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(SIGNAL_PERIOD))
            {
                Ok(value) => return interrupt.map_or(Ok(value), Err),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(RunError::new_err(
                        "the flight ended by a fault of its own; please report this",
                    ));
                }
                Err(RecvTimeoutError::Timeout) => {
                    if let Err(error) = py.check_signals() {
                        control.stop();
                        interrupt = Some(error);
                    }
                }
            }
        }
    })
}

/// Flies a recording or a simulated flight: see `plumbline.replay`.
#[pyfunction]
pub fn replay<'py>(
    py: Python<'py>,
    dataset: &Bound<'py, PyAny>,
    config: Option<&Bound<'py, PyAny>>,
    options: OpeningOptions,
    keep: Keep,
) -> PyResult<Bound<'py, PyDict>> {
    let flight = options.open(dataset, config)?;
    let control = Arc::new(Control::stopped_by(Arc::new(AtomicBool::new(false))));
    let replayed = interruptible(py, &control, || flown(flight, &keep, &control))?;
    let replayed = replayed.map_err(|error| of_flight(py, &error))?;
    if let Some(recording) = replayed.report.recording.as_ref().filter(|recording| recording.has_failed) {
        return Err(RunError::new_err(format!("the recording failed: {recording}")));
    }
    result(py, replayed)
}

fn result(py: Python<'_>, replayed: Replayed) -> PyResult<Bound<'_, PyDict>> {
    let Replayed { flown, estimates, odometry, report } = replayed;
    let stamps: Vec<_> = flown.poses.iter().map(|state| state.stamp).collect();
    let json = serde_json::to_string(&report).map_err(|error| RunError::new_err(error.to_string()))?;
    let values = PyDict::new(py);
    values.set_item("name", &flown.name)?;
    values.set_item("config", PyConfig::from(flown.config.clone()))?;
    values.set_item("estimates", table::estimates(py, &estimates)?)?;
    values.set_item("odometry", odometry.map(|rows| table::odometry(py, &rows)).transpose()?)?;
    values.set_item("map_trajectory", table::poses(py, &flown.final_poses())?)?;
    values.set_item("truth", table::poses(py, &flown.truth.poses(stamps))?)?;
    values.set_item("report", json)?;
    let findings: Vec<String> = report.warnings.iter().map(ToString::to_string).collect();
    values.set_item("findings", findings)?;
    Ok(values)
}
