//! Many values of a flight as columns: one array for each quantity.

use crate::arrays::column;
use crate::estimate::has_pose;
use nalgebra::{Isometry3, SMatrix, SVector};
use plumbline_config::ImuSample;
use plumbline_drivers::StampedPose;
use plumbline_estimator::estimate::{FrameFigures, NavCovariance, TrackingState};
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, Odometry};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Columns by their names.
struct Columns<'py>(Bound<'py, PyDict>);

impl<'py> Columns<'py> {
    fn new(py: Python<'py>) -> Self {
        Self(PyDict::new(py))
    }

    /// Adds a column of one number a row.
    fn put<T: crate::arrays::Number>(&self, name: &str, values: impl Iterator<Item = T>) -> PyResult<()> {
        self.0.set_item(name, column(self.0.py(), values.collect(), &[])?)
    }

    /// Adds a column of `N` real numbers a row.
    fn put_rows<const N: usize>(&self, name: &str, rows: impl Iterator<Item = [f64; N]>) -> PyResult<()> {
        self.0.set_item(name, column(self.0.py(), rows.flatten().collect(), &[N])?)
    }

    /// Adds a column of covariances of position, attitude and velocity; NaN where there is none.
    fn put_covariances<'a>(&self, rows: impl Iterator<Item = Option<&'a NavCovariance>>) -> PyResult<()> {
        let mut numbers = Vec::new();
        for row in rows {
            match row {
                // It lies by columns.
                Some(matrix) => numbers.extend(matrix.transpose().iter()),
                None => numbers.extend([f64::NAN; 81]),
            }
        }
        self.0.set_item("covariance", column(self.0.py(), numbers, &[9, 9])?)
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

/// The value, or NaN where there is none.
fn or_nan<const N: usize>(is_known: bool, value: [f64; N]) -> [f64; N] {
    if is_known { value } else { [f64::NAN; N] }
}

fn code(state: TrackingState) -> u8 {
    match state {
        TrackingState::Initialising => 0,
        TrackingState::Tracking => 1,
        TrackingState::Blind => 2,
        TrackingState::Failed => 3,
    }
}

/// Columns of estimates, one row a frame; real numbers are NaN in a row without a pose.
pub fn estimates<'py>(py: Python<'py>, rows: &[Estimate]) -> PyResult<Bound<'py, PyDict>> {
    let columns = Columns::new(py);
    let of = |of: fn(&Estimate) -> [f64; 3]| rows.iter().map(move |e| or_nan(e.has_pose(), of(e)));
    columns.put("frame", rows.iter().map(|e| e.frame_sequence))?;
    columns.put("stamp_ns", rows.iter().map(|e| e.stamp.as_nanos()))?;
    columns.put("state", rows.iter().map(|e| code(e.state)))?;
    columns.put("has_pose", rows.iter().map(Estimate::has_pose))?;
    columns.put("quality", rows.iter().map(|e| e.quality))?;
    columns.put("health", rows.iter().map(|e| e.health.0))?;
    columns.put("reset_counter", rows.iter().map(|e| e.reset_counter))?;
    columns.put_rows("position", of(|e| position(&e.pose_o_b)))?;
    columns.put_rows("orientation", rows.iter().map(|e| or_nan(e.has_pose(), orientation(&e.pose_o_b))))?;
    columns.put_rows("velocity", of(|e| numbers(&e.v_o_b)))?;
    columns.put_rows("gyro_bias", of(|e| numbers(&e.bias_gyro)))?;
    columns.put_rows("accel_bias", of(|e| numbers(&e.bias_accel)))?;
    columns.put_covariances(rows.iter().map(|e| e.has_pose().then_some(&e.covariance)))?;
    columns
        .put_rows("bias_variances", rows.iter().map(|e| or_nan(e.has_pose(), numbers(&e.bias_variances))))?;
    columns.put("time_offset_s", rows.iter().map(|e| or_nan(e.has_pose(), [e.time_offset_s])[0]))?;
    columns
        .put("time_offset_sigma_s", rows.iter().map(|e| or_nan(e.has_pose(), [e.time_offset_sigma_s])[0]))?;
    columns.put_rows("camera_position", of(|e| position(&e.pose_b_c0)))?;
    columns.put_rows(
        "camera_orientation",
        rows.iter().map(|e| or_nan(e.has_pose(), orientation(&e.pose_b_c0))),
    )?;
    let figures = Columns::new(py);
    for (index, name) in FrameFigures::NAMES.iter().enumerate() {
        figures.put(name, rows.iter().map(|e| e.figures.values()[index]))?;
    }
    columns.0.set_item("figures", figures.0)?;
    Ok(columns.0)
}

/// Columns of odometry, one row an inertial sample; real numbers are NaN in a row without a pose.
pub fn odometry<'py>(py: Python<'py>, rows: &[Odometry]) -> PyResult<Bound<'py, PyDict>> {
    let columns = Columns::new(py);
    let is_known = |o: &Odometry| has_pose(o.state);
    let of = |of: fn(&Odometry) -> [f64; 3]| rows.iter().map(move |o| or_nan(is_known(o), of(o)));
    columns.put("sequence", rows.iter().map(|o| o.sequence))?;
    columns.put("stamp_ns", rows.iter().map(|o| o.stamp.as_nanos()))?;
    columns.put("state", rows.iter().map(|o| code(o.state)))?;
    columns.put("has_pose", rows.iter().map(is_known))?;
    columns.put("quality", rows.iter().map(|o| o.quality))?;
    columns.put("reset_counter", rows.iter().map(|o| o.reset_counter))?;
    columns.put("jumps", rows.iter().map(|o| o.jumps))?;
    columns.put_rows("position", of(|o| position(&o.pose_o_b)))?;
    columns.put_rows("orientation", rows.iter().map(|o| or_nan(is_known(o), orientation(&o.pose_o_b))))?;
    columns.put_rows("velocity", of(|o| numbers(&o.v_o_b)))?;
    columns.put_rows("angular_rate", of(|o| numbers(&o.angular_rate_b)))?;
    columns.put_covariances(rows.iter().map(|o| is_known(o).then_some(&o.covariance)))?;
    Ok(columns.0)
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

/// Columns of poses of the odometry frame in the map, NaN while they are not known.
pub fn map<'py>(py: Python<'py>, rows: &[MapEstimate]) -> PyResult<Bound<'py, PyDict>> {
    let columns = Columns::new(py);
    columns.put("frame", rows.iter().map(|m| m.frame_sequence))?;
    columns.put("stamp_ns", rows.iter().map(|m| m.stamp.as_nanos()))?;
    let of = |m: &MapEstimate| m.pose_m_o.as_ref().map_or([f64::NAN; 3], position);
    columns.put_rows("position", rows.iter().map(of))?;
    let of = |m: &MapEstimate| m.pose_m_o.as_ref().map_or([f64::NAN; 4], orientation);
    columns.put_rows("orientation", rows.iter().map(of))?;
    columns.put("keyframes", rows.iter().map(|m| m.keyframes))?;
    columns.put("loops_used", rows.iter().map(|m| m.loops_used))?;
    Ok(columns.0)
}

/// Rotation as a matrix, row by row.
pub fn rotation<'py>(py: Python<'py>, rotation: &SMatrix<f64, 3, 3>) -> PyResult<Bound<'py, PyAny>> {
    crate::arrays::block(py, rotation.transpose().as_slice().to_vec(), &[3, 3])
}
