//! Errors as exceptions of Python: the classes of `plumbline.errors`, with the messages of the command line.

use plumbline_config as config;
use plumbline_estimator::ImuAdmission;
use plumbline_flight::flight::FlightError;
use pyo3::prelude::*;
use pyo3::types::{PyString, PyTuple};
use std::error::Error;

pyo3::import_exception!(plumbline.errors, ArgumentError);
pyo3::import_exception!(plumbline.errors, ArgumentTypeError);
pyo3::import_exception!(plumbline.errors, BusyError);
pyo3::import_exception!(plumbline.errors, ConfigError);
pyo3::import_exception!(plumbline.errors, ConnectionLost);
pyo3::import_exception!(plumbline.errors, DataError);
pyo3::import_exception!(plumbline.errors, OutOfOrderError);
pyo3::import_exception!(plumbline.errors, RunError);
pyo3::import_exception!(plumbline.errors, SampleError);

/// The exception with attributes set on it.
fn with<const N: usize>(py: Python<'_>, error: PyErr, attributes: [(&str, Bound<'_, PyAny>); N]) -> PyErr {
    let set = attributes.into_iter().try_for_each(|(name, value)| error.value(py).setattr(name, value));
    set.err().unwrap_or(error)
}

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
    let listed = || -> PyResult<Bound<'_, PyAny>> {
        let class = py.import("plumbline.errors")?.getattr("Violation")?;
        let entries = error.violations().iter().map(|v| class.call1((&v.key, v.line, &v.reason, &v.cure)));
        Ok(PyTuple::new(py, entries.collect::<PyResult<Vec<_>>>()?)?.into_any())
    };
    match listed() {
        Ok(violations) => with(py, ConfigError::new_err(one_line(error)), [("violations", violations)]),
        Err(error) => error,
    }
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

/// Reason of a refused sample in a word, as `SampleError.reason` has it, and in a sentence; `None` for an accepted one.
fn refusal(admission: ImuAdmission) -> Option<(&'static str, &'static str)> {
    Some(match admission {
        ImuAdmission::Accepted | ImuAdmission::ClockSet => return None,
        ImuAdmission::NotLater => ("not later", "its stamp is not later than that of the newest sample"),
        ImuAdmission::FarAhead => (
            "far ahead",
            "its stamp is far ahead of the newest sample; are all stamps nanoseconds of one clock?",
        ),
        ImuAdmission::NotFinite => ("not finite", "a component is NaN or infinite"),
        ImuAdmission::OutOfRange => {
            ("out of range", "a component is far beyond the range of the sensor; give rad/s and m/s^2")
        }
    })
}

/// Refuses an inertial sample that the estimator refused. `index` is its place in an array.
pub fn of_sample(
    py: Python<'_>,
    admission: ImuAdmission,
    stamp_ns: i64,
    index: Option<usize>,
) -> PyResult<()> {
    let Some((reason, words)) = refusal(admission) else { return Ok(()) };
    let place = index.map_or_else(String::new, |index| format!(" {index}"));
    let message = format!("inertial sample{place} of {stamp_ns} ns refused: {words}");
    let error = match admission {
        ImuAdmission::NotLater => OutOfOrderError::new_err(message),
        _ => SampleError::new_err(message),
    };
    Err(with_reason(py, error, reason, index))
}

/// Frame whose stamp the estimator refused.
pub fn of_frame(py: Python<'_>, stamp_ns: i64) -> PyErr {
    let message = format!(
        "frame of {stamp_ns} ns refused: its stamp does not follow those before; give nanoseconds of one clock, in order"
    );
    with_reason(py, OutOfOrderError::new_err(message), "not later", None)
}

fn with_reason(py: Python<'_>, error: PyErr, reason: &str, index: Option<usize>) -> PyErr {
    match index.into_pyobject(py) {
        Ok(index) => with(py, error, [("reason", PyString::new(py, reason).into_any()), ("index", index)]),
        Err(error) => error.into(),
    }
}
