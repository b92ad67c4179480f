//! Many values of a flight as columns: one array for each quantity.

use crate::arrays::{Number, column};
use nalgebra::{Isometry3, SVector};
use plumbline_config::ImuSample;
use plumbline_drivers::StampedPose;
use plumbline_estimator::estimate::TrackingState;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, Odometry};
use plumbline_record::fields::{Field, Record, Shape, Value};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Shape of a covariance of position, attitude and velocity.
const ROWS_OF_COVARIANCE: &[usize] = &[9, 9];

/// Columns by their names.
struct Columns<'py>(Bound<'py, PyDict>);

impl<'py> Columns<'py> {
    fn new(py: Python<'py>) -> Self {
        Self(PyDict::new(py))
    }

    /// Adds a column of one number a row.
    fn put<T: Number>(&self, name: &str, values: impl Iterator<Item = T>) -> PyResult<()> {
        self.0.set_item(name, column(self.0.py(), &values.collect::<Vec<T>>(), &[])?)
    }

    /// Adds a column of `N` real numbers a row.
    fn put_rows<const N: usize>(&self, name: &str, rows: impl Iterator<Item = [f64; N]>) -> PyResult<()> {
        self.0.set_item(name, column(self.0.py(), rows.collect::<Vec<_>>().as_flattened(), &[N])?)
    }

    /// Adds the columns of a field; real numbers are NaN in rows of which `is_known` says so.
    fn put_field<R: Record>(&self, field: &Field<R>, rows: &[R], is_known: fn(&R) -> bool) -> PyResult<()> {
        let [first, second] = names(field.about.name);
        let whole = || rows.iter().map(|row| (field.get)(row).whole());
        let reals = |name: &str, run: usize, shape: &[usize]| {
            let mut numbers = Vec::new();
            let width = shape.iter().product();
            for row in rows {
                match (field.get)(row) {
                    // It lies by columns.
                    Value::Floats([matrix, []]) if is_known(row) && shape == ROWS_OF_COVARIANCE => {
                        numbers.extend((0..width).map(|k| matrix[k % 9 * 9 + k / 9]));
                    }
                    Value::Floats(runs) if is_known(row) && runs[run].len() == width => {
                        numbers.extend(runs[run])
                    }
                    _ => numbers.resize(numbers.len() + width, f64::NAN),
                }
            }
            self.0.set_item(name, column(self.0.py(), &numbers, shape)?)
        };
        match field.about.shape {
            Shape::Uint64 => self.put(first, whole().map(|n| n as u64)),
            Shape::Uint32 => self.put(first, whole().map(|n| n as u32)),
            Shape::Sint32 => self.put(first, whole().map(|n| n as i8)),
            Shape::Flag => self.put(first, whole().map(|n| n != 0)),
            Shape::Enumerator(_) => self.put(first, whole().map(|n| n as u8)),
            Shape::Int64 => self.put(first, whole()),
            Shape::Covariance => reals(first, 0, ROWS_OF_COVARIANCE),
            Shape::Message(_) => self.put_part(field, rows),
            _ => match (field.get)(&R::default()) {
                Value::Floats([[_], []]) => reals(first, 0, &[]),
                Value::Floats([[_], [_]]) => reals(first, 0, &[]).and_then(|()| reals(second, 1, &[])),
                Value::Floats([numbers, []]) => reals(first, 0, &[numbers.len()]),
                // A pose.
                _ => reals(first, 0, &[3]).and_then(|()| reals(second, 1, &[4])),
            },
        }
    }

    /// Adds the counts in a part, by their names.
    fn put_part<R: Record>(&self, field: &Field<R>, rows: &[R]) -> PyResult<()> {
        let (columns, blank) = (Columns::new(self.0.py()), R::default());
        let Value::Part(part) = (field.get)(&blank) else { return Ok(()) };
        for tag in 1..=part.last_tag() {
            let Some((about, _)) = part.field(tag) else { continue };
            let value = |row: &R| match (field.get)(row) {
                Value::Part(part) => part.field(tag).map_or(0, |(_, value)| value.whole() as u32),
                _ => 0,
            };
            columns.put(about.name, rows.iter().map(value))?;
        }
        self.0.set_item(field.about.name, columns.0)
    }
}

/// Names of a field in Python; the second is that of the rotation of a pose, or of the other number of a pair.
fn names(field: &'static str) -> [&'static str; 2] {
    match field {
        "frame_sequence" => ["frame", ""],
        "stamp" => ["stamp_ns", ""],
        "pose_o_b" | "pose_m_o" => ["position", "orientation"],
        "pose_b_c0" => ["camera_position", "camera_orientation"],
        "v_o_b" => ["velocity", ""],
        "angular_rate_b" => ["angular_rate", ""],
        "bias_gyro" => ["gyro_bias", ""],
        "bias_accel" => ["accel_bias", ""],
        "time_offset_s" => ["time_offset_s", "time_offset_sigma_s"],
        name => [name, ""],
    }
}

fn numbers<const N: usize>(vector: &SVector<f64, N>) -> [f64; N] {
    vector.data.0[0]
}

fn position(pose: &Isometry3<f64>) -> [f64; 3] {
    numbers(&pose.translation.vector)
}

fn orientation(pose: &Isometry3<f64>) -> [f64; 4] {
    numbers(&pose.rotation.coords)
}

/// Columns of every field of records; real numbers are NaN in rows of which `is_known` says so.
fn records<'py, R: Record>(py: Python<'py>, rows: &[R], is_known: fn(&R) -> bool) -> PyResult<Columns<'py>> {
    let columns = Columns::new(py);
    R::FIELDS.iter().try_for_each(|field| columns.put_field(field, rows, is_known))?;
    Ok(columns)
}

/// Columns of estimates, one row a frame; real numbers are NaN in a row without a pose.
pub fn estimates<'py>(py: Python<'py>, rows: &[Estimate]) -> PyResult<Bound<'py, PyDict>> {
    let columns = records(py, rows, Estimate::has_pose)?;
    columns.put("has_pose", rows.iter().map(Estimate::has_pose))?;
    Ok(columns.0)
}

/// A record as an object of this class of `plumbline.states`.
pub fn state<R: Record>(py: Python<'_>, class: &str, record: &R) -> PyResult<Py<PyAny>> {
    let columns = records(py, std::slice::from_ref(record), |_| true)?;
    Ok(py.import("plumbline.states")?.call_method1(class, (columns.0,))?.unbind())
}

/// True if there is a pose in this state.
const fn has_pose(state: TrackingState) -> bool {
    matches!(state, TrackingState::Tracking | TrackingState::Blind)
}

/// Columns of odometry, one row an inertial sample; real numbers are NaN in a row without a pose.
pub fn odometry<'py>(py: Python<'py>, rows: &[Odometry]) -> PyResult<Bound<'py, PyDict>> {
    let columns = records(py, rows, |o| has_pose(o.state))?;
    columns.put("has_pose", rows.iter().map(|o| has_pose(o.state)))?;
    Ok(columns.0)
}

/// Columns of poses of the odometry frame in the map, NaN while they are not known.
pub fn map<'py>(py: Python<'py>, rows: &[MapEstimate]) -> PyResult<Bound<'py, PyDict>> {
    Ok(records(py, rows, |_| true)?.0)
}

/// Columns of poses.
pub fn poses<'py>(py: Python<'py>, rows: &[StampedPose]) -> PyResult<Bound<'py, PyDict>> {
    let columns = Columns::new(py);
    columns.put("stamp_ns", rows.iter().map(|p| p.stamp.as_nanos()))?;
    columns.put_rows("position", rows.iter().map(|p| position(&p.pose)))?;
    columns.put_rows("orientation", rows.iter().map(|p| orientation(&p.pose)))?;
    Ok(columns.0)
}

/// Columns of inertial samples.
pub fn imu<'py>(py: Python<'py>, rows: &[ImuSample]) -> PyResult<Bound<'py, PyDict>> {
    let columns = Columns::new(py);
    columns.put("stamp_ns", rows.iter().map(|s| s.stamp.as_nanos()))?;
    columns.put_rows("gyro", rows.iter().map(|s| numbers(&s.gyro)))?;
    columns.put_rows("accel", rows.iter().map(|s| numbers(&s.accel)))?;
    Ok(columns.0)
}
