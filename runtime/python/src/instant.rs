//! State at an instant.

use crate::estimate::{state_methods, state_name, vector};
use plumbline_estimator::Instant;
use pyo3::prelude::*;

/// State at an instant that was asked for. Frames as in `Estimate`.
#[pyclass(frozen, name = "Instant", module = "plumbline")]
pub struct PyInstant {
    pub instant: Instant,
}

state_methods! {
    impl PyInstant of instant {
        /// Time of the estimate before it, ns.
        #[getter]
        fn estimated_ns(&self) -> i64 {
            self.instant.estimated.as_nanos()
        }

        /// True if there is an estimate after it too: the answer would not change any more.
        #[getter]
        fn settled(&self) -> bool {
            self.instant.is_settled
        }

        /// Angular rate of B in B, bias removed, rad/s, shape (3,).
        #[getter]
        fn angular_rate<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
            vector(py, &self.instant.angular_rate_b)
        }

        fn __repr__(&self) -> String {
            let (at, p) = (&self.instant, &self.instant.pose_o_b.translation.vector);
            let stamp_ns = at.stamp.as_nanos();
            let state = state_name(at.state);
            format!(
                "<plumbline.Instant at {stamp_ns} ns: {state}, position [{:.3}, {:.3}, {:.3}] m>",
                p.x, p.y, p.z
            )
        }
    }
}
