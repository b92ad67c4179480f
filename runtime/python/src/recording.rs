//! The samples of a recording or of a simulated flight, for a loop of one's own around an estimator.

use crate::arrays::{block, nanoseconds};
use crate::config::PyConfig;
use crate::errors::{BusyError, of_data};
use crate::opening::OpeningOptions;
use crate::table;
use plumbline_config::options::image_sizes;
use plumbline_config::{GrayImage, ImuSample};
use plumbline_drivers::{ImuSource, StereoFrame, StereoSource};
use plumbline_flight::flight::Truth;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Mutex, MutexGuard};

struct Streams {
    imu: Box<dyn ImuSource>,
    stereo: Box<dyn StereoSource>,
    frame: StereoFrame,
    newest_imu_ns: i64,
}

/// Samples of a recording: see `plumbline.Recording`.
#[pyclass(frozen, module = "plumbline._native")]
pub struct Recording {
    #[pyo3(get)]
    config: PyConfig,
    #[pyo3(get)]
    name: String,
    #[pyo3(get)]
    findings: Vec<String>,
    truth: Truth,
    streams: Mutex<Streams>,
}

/// A frame as Python is given it: sequence number, stamp (ns), left and right image.
type Frame<'py> = (u64, i64, Option<Bound<'py, PyAny>>, Option<Bound<'py, PyAny>>);

impl Recording {
    fn lock(&self) -> PyResult<MutexGuard<'_, Streams>> {
        let busy =
            |_| BusyError::new_err("the recording is in use by another thread; give each thread its own");
        self.streams.try_lock().map_err(busy)
    }
}

fn pixels<'py>(py: Python<'py>, image: &GrayImage) -> PyResult<Bound<'py, PyAny>> {
    block(py, image.pixels(), &[image.height(), image.width()])
}

#[pymethods]
impl Recording {
    #[new]
    fn new(
        dataset: &Bound<'_, PyAny>,
        config: Option<&Bound<'_, PyAny>>,
        options: OpeningOptions,
    ) -> PyResult<Self> {
        let flight = options.open(dataset, config)?;
        let frame = StereoFrame::new(image_sizes(&flight.config.camera));
        let streams = Streams { imu: flight.imu, stereo: flight.stereo, frame, newest_imu_ns: i64::MIN };
        Ok(Self {
            config: flight.config.into(),
            name: flight.name,
            findings: flight.findings.iter().map(ToString::to_string).collect(),
            truth: flight.truth,
            streams: Mutex::new(streams),
        })
    }

    /// Next frame, or `None` at the end.
    fn next_frame<'py>(&self, py: Python<'py>) -> PyResult<Option<Frame<'py>>> {
        let mut streams = self.lock()?;
        let Streams { stereo, frame, .. } = &mut *streams;
        let is_there = py.detach(|| stereo.next_frame(frame)).map_err(|error| of_data(&error))?;
        if !is_there {
            return Ok(None);
        }
        let image =
            |camera: usize| frame.valid[camera].then(|| pixels(py, &frame.images[camera])).transpose();
        Ok(Some((frame.sequence, frame.stamp.as_nanos(), image(0)?, image(1)?)))
    }

    /// Inertial samples that were not handed out yet, up to the first that reaches `stamp_ns`; all that are left for `None`.
    fn imu_until<'py>(
        &self,
        py: Python<'py>,
        stamp_ns: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let until = stamp_ns.map_or(Ok(i64::MAX), |stamp| nanoseconds(stamp, "stamp_ns"))?;
        let mut guard = self.lock()?;
        let streams = &mut *guard;
        let read = py.detach(|| -> Result<Vec<ImuSample>, plumbline_drivers::DriverError> {
            let mut samples = Vec::new();
            while streams.newest_imu_ns < until {
                let Some(reading) = streams.imu.next_reading()? else { break };
                streams.newest_imu_ns = reading.sample.stamp.as_nanos();
                samples.push(reading.sample);
            }
            Ok(samples)
        });
        table::imu(py, &read.map_err(|error| of_data(&error))?)
    }

    /// True poses: as they were measured, or at these stamps where they are known at any time.
    fn truth_poses<'py>(
        &self,
        py: Python<'py>,
        stamps_ns: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let stamps = crate::arrays::stamps(stamps_ns, "stamps_ns")?;
        let stamps = stamps.into_iter().map(plumbline_config::Timestamp::from_nanos);
        table::poses(py, &self.truth.poses(stamps))
    }
}
