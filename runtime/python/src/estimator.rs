//! The estimator of a Python program: one object, samples in, estimates out.

use crate::arrays::{nanoseconds, rows, vector};
use crate::config::{PyConfig, config_of};
use crate::errors::{ArgumentError, ArgumentTypeError, BusyError, RunError, of_frame, of_sample};
use crate::image::LentImage;
use crate::table::state;
use nalgebra::Vector3;
use plumbline_config::options::image_sizes;
use plumbline_config::{ImuSample, Timestamp};
use plumbline_estimator::{Estimator, FrameInput, ResetKind};
use plumbline_record::digest::Digest;
use pyo3::prelude::*;
use std::sync::{Mutex, MutexGuard, TryLockError};

/// State of an estimator behind its lock.
struct State {
    estimator: Estimator,
    digest: Digest,
}

/// The estimator: a function of its configuration and the ordered list of its inputs. Two runs with the same inputs give
/// the same bits.
///
/// `config` is a `Config`, a configuration file, or the name of a preset. Add every inertial sample by `add_imu` or
/// `propagate`, in order of time, and a frame by `add_frame` once the samples reach `imu_needed_until` of its stamp.
/// One object serves one thread at a time: a call while another thread is in one raises `BusyError`.
#[pyclass(frozen, name = "Estimator", module = "plumbline")]
pub struct PyEstimator {
    /// Configuration of the estimator.
    #[pyo3(get)]
    config: PyConfig,
    state: Mutex<State>,
}

impl PyEstimator {
    fn lock(&self) -> PyResult<MutexGuard<'_, State>> {
        self.state.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => BusyError::new_err("the estimator is in use by another thread; give each thread its own, or take turns with a lock",
            ),
            TryLockError::Poisoned(_) => {
                RunError::new_err("the estimator ended by a fault of its own; make another, and please report this")
            }
        })
    }

    /// Image of one camera, checked; `None` for one that did not arrive.
    fn image(
        &self,
        image: Option<&Bound<'_, PyAny>>,
        name: &str,
        camera: usize,
    ) -> PyResult<Option<LentImage>> {
        let Some(image) = image else { return Ok(None) };
        if camera >= self.config.config.camera.len() {
            let message = format!("{name}: the configuration has one camera; leave it out");
            return Err(ArgumentError::new_err(message));
        }
        LentImage::of(image, name, image_sizes(&self.config.config.camera)[camera]).map(Some)
    }
}

fn sample(stamp_ns: i64, gyro: Vector3<f64>, accel: Vector3<f64>) -> ImuSample {
    ImuSample { stamp: Timestamp::from_nanos(stamp_ns), gyro, accel }
}

/// Sample of the arguments of a call.
fn sample_of(
    stamp_ns: &Bound<'_, PyAny>,
    gyro: &Bound<'_, PyAny>,
    accel: &Bound<'_, PyAny>,
) -> PyResult<ImuSample> {
    Ok(sample(nanoseconds(stamp_ns, "stamp_ns")?, vector(gyro, "gyro")?, vector(accel, "accel")?))
}

/// Kind of a reset by its name.
pub fn reset_kind(kind: &str) -> PyResult<ResetKind> {
    match kind {
        "soft" => Ok(ResetKind::Soft),
        "hard" => Ok(ResetKind::Hard),
        _ => Err(ArgumentError::new_err(format!("kind: expected 'soft' or 'hard', got '{kind}'"))),
    }
}

#[pymethods]
impl PyEstimator {
    #[new]
    fn new(py: Python<'_>, config: &Bound<'_, PyAny>) -> PyResult<Self> {
        let config = config_of(config)?;
        let estimator = py.detach(|| Estimator::new(config.setup()));
        Ok(Self { config: config.into(), state: Mutex::new(State { estimator, digest: Digest::default() }) })
    }

    /// Adds an inertial sample.
    ///
    /// stamp_ns: time of measurement, integer ns. gyro: angular rate, rad/s, three numbers. accel: specific force, m/s^2,
    /// three numbers; at rest it points up with 9.81. Raises `OutOfOrderError` or `SampleError` if the sample is refused.
    fn add_imu(
        &self,
        py: Python<'_>,
        stamp_ns: &Bound<'_, PyAny>,
        gyro: &Bound<'_, PyAny>,
        accel: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let sample = sample_of(stamp_ns, gyro, accel)?;
        let admission = self.lock()?.estimator.add_imu(&sample);
        of_sample(py, admission, sample.stamp.as_nanos(), None)
    }

    /// Adds inertial samples in order of time, and returns their number.
    ///
    /// stamps_ns: integers, ns, shape (N,). gyro: rad/s, shape (N, 3). accel: m/s^2, shape (N, 3). Stops at the first sample
    /// that is refused and raises, with its index in the exception: those before it were added.
    fn add_imu_array(
        &self,
        py: Python<'_>,
        stamps_ns: &Bound<'_, PyAny>,
        gyro: &Bound<'_, PyAny>,
        accel: &Bound<'_, PyAny>,
    ) -> PyResult<usize> {
        let rows = rows([(stamps_ns, "stamps_ns"), (gyro, "gyro"), (accel, "accel")])?;
        let samples: Vec<ImuSample> =
            rows.into_iter().map(|(stamp, gyro, accel)| sample(stamp, gyro.into(), accel.into())).collect();
        let mut guard = self.lock()?;
        let estimator = &mut guard.estimator;
        let refused = py.detach(|| {
            let mut added = samples.iter().map(|sample| (sample.stamp, estimator.add_imu(sample)));
            added.by_ref().enumerate().find(|(_, (_, admission))| !admission.is_accepted())
        });
        let Some((index, (stamp, admission))) = refused else { return Ok(samples.len()) };
        of_sample(py, admission, stamp.as_nanos(), Some(index)).map(|()| index)
    }

    /// Adds an inertial sample as `add_imu`, and returns the newest state carried forward to its time: odometry at the rate
    /// of the IMU. `None` while there is no pose. Use it for every sample or for none.
    fn propagate(
        &self,
        py: Python<'_>,
        stamp_ns: &Bound<'_, PyAny>,
        gyro: &Bound<'_, PyAny>,
        accel: &Bound<'_, PyAny>,
    ) -> PyResult<Option<Py<PyAny>>> {
        let sample = sample_of(stamp_ns, gyro, accel)?;
        let (admission, odometry) = self.lock()?.estimator.propagate_admitted(&sample);
        of_sample(py, admission, sample.stamp.as_nanos(), None)?;
        odometry.map(|odometry| state(py, "Odometry", &odometry)).transpose()
    }

    /// Adds a frame, and returns the estimate at its time.
    ///
    /// stamp_ns: time of the middle of the exposure by the clock of the cameras, integer ns. left, right: grey images, arrays
    /// of uint8 of the shape (height, width); `None` for one that did not arrive. Rows may be padded, as those of a crop of a
    /// larger image. Images are not copied, and the GIL is released: nothing may write to them until the call returns.
    /// sequence: number of the frame where the camera counts them; without it, one more than the frame before.
    /// Raises `OutOfOrderError` if the stamp does not follow those before.
    #[pyo3(signature = (stamp_ns, left, right = None, *, sequence = None))]
    fn add_frame(
        &self,
        py: Python<'_>,
        stamp_ns: &Bound<'_, PyAny>,
        left: Option<&Bound<'_, PyAny>>,
        right: Option<&Bound<'_, PyAny>>,
        sequence: Option<u64>,
    ) -> PyResult<Py<PyAny>> {
        let stamp_ns = nanoseconds(stamp_ns, "stamp_ns")?;
        if left.is_none() && right.is_none() {
            return Err(ArgumentTypeError::new_err("left and right: both are None; pass at least one image"));
        }
        let images = [self.image(left, "left", 0)?, self.image(right, "right", 1)?];
        let mut guard = self.lock()?;
        let State { estimator, digest } = &mut *guard;
        let estimate = py.detach(|| {
            let views = [0, 1].map(|camera: usize| images[camera].as_ref().and_then(LentImage::view));
            let frame = FrameInput { sequence, ..FrameInput::new(Timestamp::from_nanos(stamp_ns), views) };
            let estimate = estimator.add_frame(&frame);
            digest.add(&estimate);
            estimate
        });
        if estimate.is_refused() { Err(of_frame(py, stamp_ns)) } else { state(py, "Estimate", &estimate) }
    }

    /// Time up to which inertial samples must have been added before the frame of that stamp is, ns.
    fn imu_needed_until(&self, stamp_ns: &Bound<'_, PyAny>) -> PyResult<i64> {
        let stamp = Timestamp::from_nanos(nanoseconds(stamp_ns, "stamp_ns")?);
        Ok(self.lock()?.estimator.imu_needed_until(stamp).as_nanos())
    }

    /// Restarts the estimator before the next frame. "soft": the pose stays, with biases and calibration, and the new start
    /// continues from them. "hard": the new start begins at the origin.
    #[pyo3(signature = (kind = "soft"))]
    fn reset(&self, kind: &str) -> PyResult<()> {
        let kind = reset_kind(kind)?;
        self.lock()?.estimator.reset(kind);
        Ok(())
    }

    /// SHA-256 over the bits of all estimates so far, in hexadecimal: `estimate_digest` of the report of a replay of the same
    /// inputs.
    fn digest(&self) -> PyResult<String> {
        Ok(self.lock()?.digest.hex())
    }

    fn __repr__(&self) -> String {
        format!("<plumbline.Estimator of {} camera(s)>", self.config.config.camera.len())
    }
}
