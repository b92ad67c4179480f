//! Trajectories against their truth, as `plumbline evaluate` compares them.

use crate::arrays::{block, rows};
use crate::errors::{ArgumentError, RunError, of_data};
use crate::table;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use plumbline_config::Timestamp;
use plumbline_drivers::StampedPose;
use plumbline_lab::evaluate::{AlignmentMode, Delta, EvaluateOptions, evaluate, load_trajectory};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Stamps, positions and orientations.
type Columns<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Options, as `plumbline.evaluate` puts them together.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct EvaluateArguments {
    align: String,
    delta_frames: usize,
    delta_m: Option<f64>,
    all_pairs: bool,
    max_difference_s: f64,
    time_offset_s: f64,
}

impl EvaluateArguments {
    fn checked(&self) -> PyResult<EvaluateOptions> {
        let known = AlignmentMode::NAMED.iter().find(|(name, ..)| *name == self.align);
        let alignment = known.map(|(.., mode)| *mode).ok_or_else(|| {
            let message = format!("align: expected none, origin, yaw, se3 or sim3, got '{}'", self.align);
            ArgumentError::new_err(message)
        })?;
        let delta = self.delta_m.map_or(Delta::Frames(self.delta_frames), Delta::Metres);
        let Self { max_difference_s, all_pairs, time_offset_s, .. } = *self;
        Ok(EvaluateOptions { max_difference_s, alignment, delta, all_pairs, time_offset_s })
    }
}

/// Poses of three arrays: stamps (ns), positions (m), quaternions x y z w.
fn poses((stamps_ns, position, orientation): &Columns<'_>) -> PyResult<Vec<StampedPose>> {
    let arguments = [(stamps_ns, "stamp_ns"), (position, "position"), (orientation, "orientation")];
    let poses = rows(arguments)?.into_iter().map(|(stamp, position, orientation)| {
        let rotation = UnitQuaternion::from_quaternion(Quaternion::from(orientation));
        let pose = Isometry3::from_parts(Translation3::from(position), rotation);
        StampedPose { stamp: Timestamp::from_nanos(stamp), pose }
    });
    Ok(poses.collect())
}

/// Reads a trajectory file, or the truth of a EuRoC data set.
#[pyfunction]
pub fn read_trajectory(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let read = py.detach(|| load_trajectory(&path));
    table::poses(py, &read.map_err(|error| of_data(&error))?)
}

/// Compares two trajectories, each three arrays; figures as JSON, and the alignment. See `plumbline.evaluate`.
#[pyfunction]
#[pyo3(name = "evaluate")]
pub fn evaluate_trajectories<'py>(
    py: Python<'py>,
    estimate: Columns<'py>,
    truth: Columns<'py>,
    options: EvaluateArguments,
) -> PyResult<Bound<'py, PyDict>> {
    let options = options.checked()?;
    let (estimate, truth) = (poses(&estimate)?, poses(&truth)?);
    let evaluated = py.detach(|| evaluate(&estimate, &truth, &options));
    let evaluation = evaluated.map_err(|error| of_data(&error))?;
    let similarity = &evaluation.similarity;
    let values = PyDict::new(py);
    let json = serde_json::to_string(&evaluation).map_err(|error| RunError::new_err(error.to_string()))?;
    values.set_item("figures", json)?;
    let rotation = similarity.rotation.to_rotation_matrix().matrix().transpose();
    values.set_item("rotation", block(py, rotation.as_slice(), &[3, 3])?)?;
    values.set_item("translation", block(py, similarity.translation.as_slice(), &[3])?)?;
    values.set_item("scale", similarity.scale)?;
    Ok(values)
}
