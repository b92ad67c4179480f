//! Output of the estimator as objects.

use crate::arrays::block;
use nalgebra::{Isometry3, SMatrix, Vector3};
use plumbline_estimator::estimate::{FrameFigures, TrackingState};
use plumbline_estimator::{Estimate, Odometry};
use plumbline_record::fields::Record as _;
use pyo3::prelude::*;
use pyo3::types::PyDict;

pub(crate) fn vector<'py>(py: Python<'py>, numbers: &Vector3<f64>) -> PyResult<Bound<'py, PyAny>> {
    block(py, numbers.as_slice(), &[3])
}

pub(crate) fn orientation<'py>(py: Python<'py>, pose: &Isometry3<f64>) -> PyResult<Bound<'py, PyAny>> {
    block(py, pose.rotation.coords.as_slice(), &[4])
}

/// Matrix, row by row.
pub(crate) fn matrix<'py, const N: usize>(
    py: Python<'py>,
    matrix: &SMatrix<f64, N, N>,
) -> PyResult<Bound<'py, PyAny>> {
    block(py, matrix.transpose().as_slice(), &[N, N])
}

/// Methods of a class of states: its own, and those that all have, of the state in this field.
macro_rules! state_methods {
    (impl $class:ident of $field:ident { $($own:tt)* }) => {
        #[pymethods]
        impl $class {
            $($own)*

            /// Time of the state on the clock of the IMU, ns.
            #[getter]
            fn stamp_ns(&self) -> i64 {
                self.$field.stamp.as_nanos()
            }

            /// "initialising", "tracking", "blind" (IMU alone) or "failed".
            #[getter]
            fn state(&self) -> &'static str {
                $crate::estimate::state_name(self.$field.state)
            }

            /// Quality from 0 to 100; -1 if the estimator failed.
            #[getter]
            fn quality(&self) -> i8 {
                self.$field.quality
            }

            /// Number of resets so far: the pose may jump where it changes.
            #[getter]
            fn reset_counter(&self) -> u32 {
                self.$field.reset_counter
            }

            /// Position of B in O, m, shape (3,).
            #[getter]
            fn position<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
                $crate::estimate::vector(py, &self.$field.pose_o_b.translation.vector)
            }

            /// Rotation that takes coordinates from B to O: quaternion x y z w, shape (4,).
            #[getter]
            fn orientation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
                $crate::estimate::orientation(py, &self.$field.pose_o_b)
            }

            /// Velocity of B in O, m/s, shape (3,).
            #[getter]
            fn velocity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
                $crate::estimate::vector(py, &self.$field.v_o_b)
            }

            /// Covariance of position (0:3, m), attitude (3:6, rad, right perturbation) and velocity (6:9, m/s), shape (9, 9).
            #[getter]
            fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
                $crate::estimate::matrix(py, &self.$field.covariance)
            }

            /// Pose of B in O as a matrix, shape (4, 4), m.
            fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
                $crate::estimate::matrix(py, &self.$field.pose_o_b.to_homogeneous())
            }
        }
    };
}

pub(crate) use state_methods;

/// Name of a state, as in the tables of `plumbline replay --states`.
pub const fn state_name(state: TrackingState) -> &'static str {
    match state {
        TrackingState::Initialising => "initialising",
        TrackingState::Tracking => "tracking",
        TrackingState::Blind => "blind",
        TrackingState::Failed => "failed",
    }
}

/// True if there is a pose in this state.
pub const fn has_pose(state: TrackingState) -> bool {
    matches!(state, TrackingState::Tracking | TrackingState::Blind)
}

/// Estimate at the time of one frame. `O` is the odometry frame: z up along gravity, origin at the first pose. `B` is the
/// body, the frame of the IMU.
#[pyclass(frozen, name = "Estimate", module = "plumbline")]
pub struct PyEstimate {
    pub estimate: Estimate,
}

state_methods! {
    impl PyEstimate of estimate {
        /// Sequence number of the frame.
        #[getter]
        fn frame(&self) -> u64 {
            self.estimate.frame_sequence
        }

        /// True if pose, velocity, biases and covariance are valid.
        #[getter]
        fn has_pose(&self) -> bool {
            self.estimate.has_pose()
        }

        /// Bias of the gyroscope, rad/s, shape (3,).
        #[getter]
        fn gyro_bias<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
            vector(py, &self.estimate.bias_gyro)
        }

        /// Bias of the accelerometer, m/s^2, shape (3,).
        #[getter]
        fn accel_bias<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
            vector(py, &self.estimate.bias_accel)
        }

        /// Variances of the biases: gyroscope (0:3, rad^2/s^2) and accelerometer (3:6, m^2/s^4), shape (6,).
        #[getter]
        fn bias_variances<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
            block(py, self.estimate.bias_variances.as_slice(), &[6])
        }

        /// Position of the left camera in B, refined online, m, shape (3,).
        #[getter]
        fn camera_position<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
            vector(py, &self.estimate.pose_b_c0.translation.vector)
        }

        /// Rotation that takes coordinates from the left camera to B, refined online: quaternion x y z w, shape (4,).
        #[getter]
        fn camera_orientation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
            orientation(py, &self.estimate.pose_b_c0)
        }

        /// Time of the IMU minus time of the cameras, refined online, s.
        #[getter]
        fn time_offset_s(&self) -> f64 {
            self.estimate.time_offset_s
        }

        /// Standard deviation of `time_offset_s`, s.
        #[getter]
        fn time_offset_sigma_s(&self) -> f64 {
            self.estimate.time_offset_sigma_s
        }

        /// Errors and warnings: bits of `plumbline.Health`.
        #[getter]
        fn health(&self) -> u32 {
            self.estimate.health.0
        }

        /// Names of the bits of `health`.
        #[getter]
        fn health_names(&self) -> Vec<&'static str> {
            self.estimate.health.names().collect()
        }

        /// Counts of the frame by name: points, lines, landmarks, iterations.
        #[getter]
        fn figures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
            let figures = PyDict::new(py);
            for field in FrameFigures::FIELDS {
                figures.set_item(field.about.name, (field.get)(&self.estimate.figures).whole())?;
            }
            Ok(figures)
        }

        fn __repr__(&self) -> String {
            let e = &self.estimate;
            let place = match e.pose() {
                Some(pose) => {
                    let p = &pose.translation.vector;
                    format!("position [{:.3}, {:.3}, {:.3}] m", p.x, p.y, p.z)
                }
                None => "no pose".into(),
            };
            let state = state_name(e.state);
            format!(
                "<plumbline.Estimate frame {} at {} ns: {state}, {place}>",
                e.frame_sequence,
                e.stamp.as_nanos()
            )
        }
    }
}

/// State carried forward to an inertial sample, at the rate of the IMU. Frames as in `Estimate`.
#[pyclass(frozen, name = "Odometry", module = "plumbline")]
pub struct PyOdometry {
    pub odometry: Odometry,
}

state_methods! {
    impl PyOdometry of odometry {
        /// Count of odometry outputs.
        #[getter]
        fn sequence(&self) -> u64 {
            self.odometry.sequence
        }

        /// True if pose, velocity and covariance are valid.
        #[getter]
        fn has_pose(&self) -> bool {
            has_pose(self.odometry.state)
        }

        /// Angular rate of B in B, bias removed, rad/s, shape (3,).
        #[getter]
        fn angular_rate<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
            vector(py, &self.odometry.angular_rate_b)
        }

        /// Number of steps within the same odometry frame so far: corrections that were too large to enter bit by bit.
        #[getter]
        fn jumps(&self) -> u32 {
            self.odometry.jumps
        }

        fn __repr__(&self) -> String {
            let (o, p) = (&self.odometry, &self.odometry.pose_o_b.translation.vector);
            let state = state_name(o.state);
            format!(
                "<plumbline.Odometry at {} ns: {state}, position [{:.3}, {:.3}, {:.3}] m>",
                o.stamp.as_nanos(),
                p.x,
                p.y,
                p.z
            )
        }
    }
}
