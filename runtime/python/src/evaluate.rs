//! Trajectories against their truth, as `plumbline evaluate` compares them.

use crate::arrays::{numbers, stamps};
use crate::errors::{ArgumentError, RunError, of_data};
use crate::estimate::{matrix, vector};
use crate::table;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use plumbline_config::Timestamp;
use plumbline_drivers::StampedPose;
use plumbline_lab::evaluate::{AlignmentMode, Delta, EvaluateOptions, evaluate, load_trajectory};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// A quaternion printed with three decimals is still normal to this.
const NORM_TOLERANCE: f64 = 0.01;

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
        let time_offset_s = self.time_offset_s;
        if !time_offset_s.is_finite() {
            let message = format!("time_offset: expected a number of seconds, got {time_offset_s}");
            return Err(ArgumentError::new_err(message));
        }
        let delta = self.delta_m.map_or(Delta::Frames(self.delta_frames), Delta::Metres);
        let (max_difference_s, all_pairs) = (self.max_difference_s, self.all_pairs);
        Ok(EvaluateOptions { max_difference_s, alignment, delta, all_pairs, time_offset_s })
    }
}

/// Poses of three arrays: stamps (ns), positions (m), quaternions x y z w. Rows of NaN, which have no pose, are left out.
fn poses(
    (stamps_ns, positions, orientations): (&Bound<'_, PyAny>, &Bound<'_, PyAny>, &Bound<'_, PyAny>),
) -> PyResult<Vec<StampedPose>> {
    let stamps_ns = stamps(stamps_ns, "stamp_ns")?;
    let (positions, orientations) =
        (numbers(positions, "position", 3)?, numbers(orientations, "orientation", 4)?);
    let (positions, orientations) = (positions.as_chunks::<3>().0, orientations.as_chunks::<4>().0);
    if positions.len() != stamps_ns.len() || orientations.len() != stamps_ns.len() {
        let (n, p, q) = (stamps_ns.len(), positions.len(), orientations.len());
        let message = format!("{n} stamps, {p} positions and {q} orientations; give as many of each");
        return Err(ArgumentError::new_err(message));
    }
    let mut poses = Vec::with_capacity(stamps_ns.len());
    for (row, ((stamp, position), orientation)) in
        stamps_ns.iter().zip(positions).zip(orientations).enumerate()
    {
        if position.iter().chain(orientation).all(|number| number.is_nan()) {
            continue;
        }
        let rotation = Quaternion::from(*orientation);
        if (rotation.norm() - 1.0).abs() > NORM_TOLERANCE {
            let message =
                format!("orientation {row}: a quaternion x y z w has length 1, this one {}", rotation.norm());
            return Err(ArgumentError::new_err(message));
        }
        let pose =
            Isometry3::from_parts(Translation3::from(*position), UnitQuaternion::from_quaternion(rotation));
        poses.push(StampedPose { stamp: Timestamp::from_nanos(*stamp), pose });
    }
    Ok(poses)
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
    estimate: (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>),
    truth: (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>),
    options: EvaluateArguments,
) -> PyResult<Bound<'py, PyDict>> {
    let options = options.checked()?;
    let estimate = poses((&estimate.0, &estimate.1, &estimate.2))?;
    let truth = poses((&truth.0, &truth.1, &truth.2))?;
    let evaluated = py.detach(|| evaluate(&estimate, &truth, &options));
    let evaluation = evaluated.map_err(|error| of_data(&error))?;
    let similarity = &evaluation.similarity;
    let values = PyDict::new(py);
    let json = serde_json::to_string(&evaluation).map_err(|error| RunError::new_err(error.to_string()))?;
    values.set_item("figures", json)?;
    values.set_item("rotation", matrix(py, similarity.rotation.to_rotation_matrix().matrix())?)?;
    values.set_item("translation", vector(py, &similarity.translation)?)?;
    values.set_item("scale", similarity.scale)?;
    Ok(values)
}
