//! Calibration files: read into the structs of a format, named by their keys where they are of another program, and refused
//! with file, key and cure.

use super::{Matrix, distortion, pose_problem};
use crate::camera::Distortion;
use crate::error::{ConfigError, Violation};
use crate::options::isometry_from_rows;
use crate::text;
use nalgebra::Isometry3;
use serde::Deserialize;
use serde::de::{DeserializeOwned, IgnoredAny};
use std::collections::BTreeMap;
use std::path::Path;

/// Deepest nesting and most nodes of a calibration file; real ones have 4 levels and some 200 nodes.
const MAX_DEPTH: usize = 32;
const MAX_NODES: usize = 50_000;

/// Cure for files that another option takes, with keys at the top of them. Prefixes end with `*`.
const OTHER_OPTIONS: [(&str, &str); 3] = [
    (
        "value0 body_T_cam0 num_of_cam cam0_calib extrinsicRotation relative_config_imu Camera.* Camera1.*",
        "`plumbline config import --rig` takes it as it is",
    ),
    ("T_BS", "a sensor.yaml: give the folder of its data set with --euroc"),
    (
        "projection_parameters mirror_parameters",
        "a camera file of camodocal: give the configuration of VINS-Fusion or VINS-Mono that names it",
    ),
];

const ANOTHER: &str = "calibrate with Kalibr, or write its keys with these numbers (mind the direction of the extrinsics: T_cam_imu \
                       takes coordinates from the IMU to the camera)";

/// A calibration file whose syntax is sound.
pub(super) struct File {
    pub origin: String,
    text: String,
    keys: Vec<String>,
}

impl File {
    /// Reads a file.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        Self::parse(&text::read_bounded(path)?, &path.display().to_string())
    }

    /// Parses the text of a file, as [`Self::read`].
    pub fn parse(content: &str, origin: &str) -> Result<Self, ConfigError> {
        let text = without_directive(content);
        // A text may have no keys, if its syntax is sound.
        let keys: BTreeMap<String, IgnoredAny> = deserialized(&text, origin)
            .or_else(|_| deserialized(&text, origin).map(|IgnoredAny| BTreeMap::new()))?;
        Ok(Self { origin: origin.to_owned(), text, keys: keys.into_keys().collect() })
    }

    pub fn has(&self, key: &str) -> bool {
        match key.strip_suffix('*') {
            Some(prefix) => self.keys.iter().any(|name| name.starts_with(prefix)),
            None => self.keys.iter().any(|name| name == key),
        }
    }

    /// The content, as a format has it.
    pub fn get<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        deserialized(&self.text, &self.origin)
    }

    /// Error of a key.
    pub fn refuse(&self, key: &str, reason: impl Into<String>, cure: impl Into<String>) -> ConfigError {
        ConfigError::one(&self.origin, Violation::new(key, reason, cure))
    }

    /// Refusal of the file of another program, or of no calibration at all.
    pub fn other(&self, expected: &str) -> ConfigError {
        let is_of = |(keys, _): &&(&str, &str)| keys.split(' ').any(|key| self.has(key));
        let cure = OTHER_OPTIONS.iter().find(is_of).map_or(ANOTHER, |(_, cure)| cure);
        let content = match &self.keys[..] {
            [] => "it has no keys".to_owned(),
            keys => format!("its first keys: {}", keys[..keys.len().min(3)].join(", ")),
        };
        let reason = format!("is no file of Kalibr ({content}); {expected} is expected");
        self.refuse("(file)", reason, cure)
    }
}

/// OpenCV writes `%YAML:1.0`, which is no YAML directive: blanked, so that lines keep their numbers.
fn without_directive(text: &str) -> String {
    let text = text.trim_start_matches('\u{feff}');
    match text.strip_prefix("%YAML") {
        Some(rest) => rest.find('\n').map_or_else(String::new, |end| rest[end..].to_owned()),
        None => text.to_owned(),
    }
}

/// Content of a text; else an error by key, or by line and column where the text has no keys.
fn deserialized<T: DeserializeOwned>(text: &str, origin: &str) -> Result<T, ConfigError> {
    let options = serde_saphyr::options! {
        budget: serde_saphyr::budget! { max_depth: MAX_DEPTH, max_nodes: MAX_NODES, max_documents: 1 },
        with_snippet: false,
    };
    let mut track = serde_path_to_error::Track::new();
    let read = serde_saphyr::with_deserializer_from_str_with_options(text, options, |yaml| {
        T::deserialize(serde_path_to_error::Deserializer::new(yaml, &mut track))
    });
    read.map_err(|error| {
        let at = error.location().map_or((1, 1), |at| (at.line() as usize, at.column() as usize));
        let message = error.to_string().replace('\n', " ").replace("invalid u64", "no whole number");
        let missing = message.split('`').nth(1).filter(|_| message.contains("missing field"));
        let path = track.path().to_string();
        let violation = match (missing, path.as_str()) {
            (Some(name), ".") => Violation::new(name, "missing", MISSING),
            (Some(name), path) => Violation::new(format!("{path}.{name}"), "missing", MISSING),
            (None, ".") => {
                let (line, column) = at;
                let reason = format!("line {line}, column {column}: {message}; correct the syntax there");
                return ConfigError::unusable(origin, reason);
            }
            (None, path) => Violation::new(path, message, VALUE).at_line(Some(at.0)),
        };
        ConfigError::one(origin, violation)
    })
}

const MISSING: &str = "add it, or check that this is the right kind of file";
const VALUE: &str =
    "write a value of that kind: numbers have no quotation marks, no unit and no decimal comma";

/// A table of a file; keys in errors begin with its path.
#[derive(Clone, Copy)]
pub(super) struct At<'a> {
    pub file: &'a File,
    pub path: &'a str,
}

/// Values of a table by their keys.
pub(super) type Values = BTreeMap<String, Scalar>;

/// Number, or something else.
#[derive(Deserialize)]
#[serde(untagged)]
pub(super) enum Scalar {
    Number(f64),
    Other(IgnoredAny),
}

impl At<'_> {
    /// Number of a key among the values of the table.
    pub fn number(&self, values: &Values, key: &str) -> Result<f64, ConfigError> {
        match values.get(key) {
            Some(Scalar::Number(number)) => Ok(*number),
            Some(Scalar::Other(_)) => Err(self.refuse(key, "is no number", VALUE)),
            None => Err(self.missing(key)),
        }
    }

    pub fn missing(&self, key: &str) -> ConfigError {
        self.refuse(key, "missing", MISSING)
    }

    /// Error of a key of the table.
    pub fn refuse(&self, key: &str, reason: impl Into<String>, cure: impl Into<String>) -> ConfigError {
        self.file.refuse(&format!("{}{key}", self.path), reason, cure)
    }

    /// A rigid transform from a matrix that was checked to be one.
    pub fn rigid(&self, key: &str, Matrix(rows): &Matrix<4>) -> Result<Isometry3<f64>, ConfigError> {
        match pose_problem(rows) {
            // The cure names the matrix as the file does.
            Some((reason, cure)) => Err(self.refuse(key, reason, cure.replace("T_BC", key))),
            None => Ok(isometry_from_rows(rows)),
        }
    }

    /// Distortion of the model that the program calls `name`, each coefficient by `of`. `models` are those that it may name, and ours.
    pub fn distortion(
        &self,
        key: &str,
        name: &str,
        models: &[(&str, &str)],
        of: impl FnMut(&'static str) -> Result<f64, ConfigError>,
    ) -> Result<Distortion, ConfigError> {
        let ours = models.iter().find(|(theirs, _)| *theirs == name).map_or("", |(_, ours)| ours);
        distortion(ours, of)?.ok_or_else(|| {
            let names: Vec<&str> = models.iter().map(|(name, _)| *name).collect();
            self.refuse(key, "is no known model", format!("calibrate with one of {}", names.join(", ")))
        })
    }
}
