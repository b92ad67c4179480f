//! Errors as exceptions of Python: the classes of `plumbline.errors`, with the messages of the command line.

use plumbline_config as config;
use plumbline_estimator::ImuAdmission;
use plumbline_flight::flight::FlightError;
use pyo3::call::PyCallArgs;
use pyo3::prelude::*;
use std::error::Error;

pyo3::import_exception!(plumbline.errors, ArgumentError);
pyo3::import_exception!(plumbline.errors, ArgumentTypeError);
pyo3::import_exception!(plumbline.errors, BusyError);
pyo3::import_exception!(plumbline.errors, ConnectionLost);
pyo3::import_exception!(plumbline.errors, DataError);
pyo3::import_exception!(plumbline.errors, RunError);

/// Message of an error with its causes, on one line.
pub fn one_line(error: &dyn Error) -> String {
    let mut line = error.to_string();
    let mut cause = error.source();
    while let Some(next) = cause {
        let text = next.to_string();
        // A message that quotes its cause has said it.
        if !line.contains(&text) {
            line = format!("{line}: {text}");
        }
        cause = next.source();
    }
    line
}

/// Configuration that is refused, with each refused key as a `Violation`.
pub fn of_config(py: Python<'_>, error: &config::ConfigError) -> PyErr {
    let violations: Vec<_> =
        error.violations().iter().map(|v| (&v.key, v.line, &v.reason, &v.cure)).collect();
    made(py, "of_config", (one_line(error), violations))
}

/// Flight that cannot be opened or flown.
pub fn of_flight(py: Python<'_>, error: &FlightError) -> PyErr {
    match error {
        FlightError::Config(config) | FlightError::Calibration(config) => of_config(py, config),
        FlightError::Run(_) | FlightError::Autopilot(_) => RunError::new_err(one_line(error)),
        _ => of_data(error),
    }
}

/// Sensor data, flight log or trajectories that cannot be read or used.
pub fn of_data(error: &dyn Error) -> PyErr {
    DataError::new_err(one_line(error))
}

/// Exception that this function of `plumbline.errors` makes.
fn made<'py>(py: Python<'py>, function: &str, arguments: impl PyCallArgs<'py>) -> PyErr {
    let made = py.import("plumbline.errors").and_then(|errors| errors.call_method1(function, arguments));
    made.map_or_else(|error| error, PyErr::from_value)
}

/// Refuses an inertial sample that the estimator refused. `index` is its place in an array.
pub fn of_sample(
    py: Python<'_>,
    admission: ImuAdmission,
    stamp_ns: i64,
    index: Option<usize>,
) -> PyResult<()> {
    match admission.is_accepted() {
        true => Ok(()),
        false => Err(made(py, "of_sample", (format!("{admission:?}"), stamp_ns, index))),
    }
}

/// Frame whose stamp the estimator refused.
pub fn of_frame(py: Python<'_>, stamp_ns: i64) -> PyErr {
    made(py, "of_frame", (stamp_ns,))
}
