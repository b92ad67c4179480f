//! Python.
use pyo3::prelude::*;
/// Module.
#[pymodule]
mod _native {}
