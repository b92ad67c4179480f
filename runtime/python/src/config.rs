//! Configurations, with the validation and the messages of the command line.

use crate::arrays::kind_of;
use crate::errors::{ArgumentTypeError, of_config, of_flight};
use plumbline_config::{Config, PRESETS, ValidConfig, import};
use plumbline_flight::flight::with_overrides;
use plumbline_record::digest::config_hash;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::path::PathBuf;

/// Configuration of a vehicle, proven valid: calibration, sensors, estimator. It does not change.
#[pyclass(frozen, name = "Config", module = "plumbline", eq)]
#[derive(Clone, PartialEq)]
pub struct PyConfig {
    pub config: ValidConfig,
}

impl From<ValidConfig> for PyConfig {
    fn from(config: ValidConfig) -> Self {
        Self { config }
    }
}

#[pymethods]
impl PyConfig {
    /// Reads a configuration file (TOML).
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        Config::load(path).map(Self::from).map_err(|error| of_config(py, &error))
    }

    /// Parses the text of a configuration file. `origin` names it in messages.
    #[staticmethod]
    #[pyo3(signature = (text, origin = "configuration"))]
    fn from_toml(py: Python<'_>, text: &str, origin: &str) -> PyResult<Self> {
        Config::from_toml_str(text, origin).map(Self::from).map_err(|error| of_config(py, &error))
    }

    /// Configuration that ships with Plumbline: one of `Config.presets()`.
    #[staticmethod]
    fn preset(py: Python<'_>, name: &str) -> PyResult<Self> {
        Config::preset(name).map(Self::from).map_err(|error| of_config(py, &error))
    }

    /// Names of all presets.
    #[staticmethod]
    fn presets(py: Python<'_>) -> PyResult<Bound<'_, PyTuple>> {
        PyTuple::new(py, PRESETS)
    }

    /// Preset `euroc` with the calibration of a EuRoC data set.
    #[staticmethod]
    fn from_euroc(py: Python<'_>, folder: PathBuf) -> PyResult<Self> {
        let imported = Config::preset("euroc").and_then(|base| import::euroc_into(base.into_inner(), folder));
        imported.map(Self::from).map_err(|error| of_config(py, &error))
    }

    /// Configuration with keys changed: `estimator__points__max_points=200`, or
    /// `**{"estimator.points.max_points": 200}`.
    #[pyo3(signature = (**changes))]
    fn replace(&self, py: Python<'_>, changes: Option<Bound<'_, PyDict>>) -> PyResult<Self> {
        let changes = changes.unwrap_or_else(|| PyDict::new(py));
        let changes = py.import("plumbline.settings")?.call_method1("changes", (changes,))?;
        with_overrides(&self.config, &changes.extract::<Vec<String>>()?)
            .map(Self::from)
            .map_err(|error| of_flight(py, &error))
    }

    /// The whole configuration as TOML, defaults included.
    fn to_toml(&self, py: Python<'_>) -> PyResult<String> {
        self.config.to_toml().map_err(|error| of_config(py, &error))
    }

    /// Doubts: settings that are valid, and yet probably a mistake, as sentences.
    fn doubts(&self) -> Vec<String> {
        self.config.doubts().iter().map(ToString::to_string).collect()
    }

    /// SHA-256 of the configuration, as reports and flight logs state it.
    #[getter]
    fn hash(&self) -> String {
        config_hash(&self.config)
    }

    /// Size of each camera's images: (width, height), px.
    #[getter]
    fn image_sizes(&self) -> Vec<(usize, usize)> {
        self.config.camera.iter().map(|camera| (camera.width_px, camera.height_px)).collect()
    }

    /// Rates of cameras and IMU, Hz.
    #[getter]
    fn rates_hz(&self) -> (f64, f64) {
        (self.config.camera[0].rate_hz, self.config.imu.rate_hz)
    }

    fn __hash__(&self) -> u64 {
        let digits = config_hash(&self.config);
        digits.get(..16).and_then(|digits| u64::from_str_radix(digits, 16).ok()).unwrap_or(0)
    }

    fn __repr__(&self) -> String {
        let hash = config_hash(&self.config);
        format!(
            "<plumbline.Config {} camera(s), hash {}>",
            self.config.camera.len(),
            hash.get(..12).unwrap_or(&hash)
        )
    }

    fn __reduce__(&self, py: Python<'_>) -> PyResult<(Py<PyAny>, (String, &'static str))> {
        let make = py.get_type::<Self>().getattr("from_toml")?.unbind();
        Ok((make, (self.to_toml(py)?, "pickled configuration")))
    }
}

/// Configuration that an argument names: a `Config`, a file, or a preset.
pub fn config_of(value: &Bound<'_, PyAny>) -> PyResult<ValidConfig> {
    if let Ok(config) = value.cast::<PyConfig>() {
        return Ok(config.get().config.clone());
    }
    let path: PathBuf = value.extract().map_err(|_| {
        let got = kind_of(value);
        let message = format!("config: expected a Config, a file or the name of a preset, got {got}");
        ArgumentTypeError::new_err(message)
    })?;
    Config::load_or_preset(path).map_err(|error| of_config(value.py(), &error))
}
