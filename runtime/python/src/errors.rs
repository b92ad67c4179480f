//! Errors as exceptions of Python: the classes of `plumbline.errors`, with the messages of the command line.

use plumbline_config::{ConfigError, Violation};
use plumbline_drivers::DriverError;
use plumbline_estimator::ImuAdmission;
use plumbline_flight::flight::FlightError;
use plumbline_flight::log::LogError;
use plumbline_lab::evaluate::EvaluateError;
use pyo3::exceptions::PyImportError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyString, PyTuple};
use std::error::Error;

/// Module of the exception classes.
const MODULE: &str = "plumbline.errors";

/// A class of [`MODULE`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// Wrong value, shape or layout of an argument.
    Argument,
    /// Wrong type of an argument.
    ArgumentType,
    /// Estimator or connection in use by another thread.
    Busy,
    /// Recording, log or trajectory that cannot be read or used.
    Data,
    /// Flight that failed.
    Run,
    /// Local socket that cannot be reached, or was closed.
    Lost,
}

impl Class {
    const fn name(self) -> &'static str {
        match self {
            Self::Argument => "ArgumentError",
            Self::ArgumentType => "ArgumentTypeError",
            Self::Busy => "BusyError",
            Self::Data => "DataError",
            Self::Run => "RunError",
            Self::Lost => "ConnectionLost",
        }
    }

    /// Exception with a message.
    pub fn error(self, py: Python<'_>, message: impl Into<String>) -> PyErr {
        raised(py, self.name(), (message.into(),), &[])
    }
}

/// Exception of the class `name`, with attributes set on it.
fn raised<'py>(
    py: Python<'py>,
    name: &str,
    arguments: impl IntoPyObject<'py, Target = PyTuple, Output = Bound<'py, PyTuple>, Error = PyErr>,
    attributes: &[(&str, Bound<'py, PyAny>)],
) -> PyErr {
    let made = || -> PyResult<PyErr> {
        let class = class(py, name)?;
        let exception = class.call1(arguments.into_pyobject(py)?)?;
        for (attribute, value) in attributes {
            exception.setattr(*attribute, value)?;
        }
        Ok(PyErr::from_value(exception))
    };
    made().unwrap_or_else(|error| error)
}

fn class<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    static CLASSES: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let module =
        CLASSES.get_or_try_init(py, || py.import(MODULE).map(|module| module.into_any().unbind()))?;
    module.bind(py).getattr(name).map_err(|_| PyImportError::new_err(format!("{MODULE} has no {name}")))
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
pub fn of_config(py: Python<'_>, error: &ConfigError) -> PyErr {
    config_error(py, one_line(error), error.violations())
}

fn config_error(py: Python<'_>, message: String, violations: &[Violation]) -> PyErr {
    let listed = || -> PyResult<Bound<'_, PyAny>> {
        let class = class(py, "Violation")?;
        let entries = violations.iter().map(|v| class.call1((&v.key, v.line, &v.reason, &v.cure)));
        Ok(PyTuple::new(py, entries.collect::<PyResult<Vec<_>>>()?)?.into_any())
    };
    match listed() {
        Ok(violations) => raised(py, "ConfigError", (message,), &[("violations", violations)]),
        Err(error) => error,
    }
}

/// Flight that cannot be opened or flown.
pub fn of_flight(py: Python<'_>, error: &FlightError) -> PyErr {
    match error {
        FlightError::Config(config) | FlightError::Calibration(config) => {
            config_error(py, one_line(error), config.violations())
        }
        FlightError::Run(_) | FlightError::Autopilot(_) => Class::Run.error(py, one_line(error)),
        _ => Class::Data.error(py, one_line(error)),
    }
}

/// Sensor data that cannot be read.
pub fn of_driver(py: Python<'_>, error: &DriverError) -> PyErr {
    Class::Data.error(py, one_line(error))
}

/// Flight log that cannot be read.
pub fn of_log(py: Python<'_>, error: &LogError) -> PyErr {
    Class::Data.error(py, one_line(error))
}

/// Trajectories that cannot be compared.
pub fn of_evaluation(py: Python<'_>, error: &EvaluateError) -> PyErr {
    Class::Data.error(py, one_line(error))
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

/// Inertial sample that the estimator refused; `None` for an accepted one. `index` is its place in an array.
pub fn of_sample(
    py: Python<'_>,
    admission: ImuAdmission,
    stamp_ns: i64,
    index: Option<usize>,
) -> Option<PyErr> {
    let (reason, words) = refusal(admission)?;
    let name = if admission == ImuAdmission::NotLater { "OutOfOrderError" } else { "SampleError" };
    let place = index.map_or_else(String::new, |index| format!(" {index}"));
    let message = format!("inertial sample{place} of {stamp_ns} ns refused: {words}");
    Some(with_reason(py, name, message, reason, index))
}

/// Frame whose stamp the estimator refused.
pub fn of_frame(py: Python<'_>, stamp_ns: i64) -> PyErr {
    let message = format!(
        "frame of {stamp_ns} ns refused: its stamp does not follow those before; give nanoseconds of one clock, in order"
    );
    with_reason(py, "OutOfOrderError", message, "not later", None)
}

fn with_reason(py: Python<'_>, name: &str, message: String, reason: &str, index: Option<usize>) -> PyErr {
    let index = match index.into_pyobject(py) {
        Ok(index) => index,
        Err(error) => return error.into(),
    };
    raised(py, name, (message,), &[("reason", PyString::new(py, reason).into_any()), ("index", index)])
}
