//! The live sensors that a configuration names, whichever they are.

use crate::clock::{StampFigures, StampProblem};
use crate::frame_socket::{SocketFigures, SocketMonitor, SocketStereo};
use crate::iio::IioImu;
use crate::inertial::ImuMonitor;
use crate::serial::SerialImu;
use crate::v4l2::{V4l2Monitor, V4l2Options, V4l2Stereo};
use crate::{DriverError, ImuSource, StereoSource, StopFlag};
use plumbline_config::Config;
use plumbline_config::options::{ImuEndpoint, image_sizes};
use std::path::Path;

/// A live inertial sensor and what belongs to it.
pub struct LiveImu {
    /// Samples, stamped by the host's monotonic clock. It waits for a device that is missing, and ends when the flag that it
    /// was opened with is set.
    pub source: Box<dyn ImuSource>,
    /// Figures of the samples, for the report.
    pub monitor: ImuMonitor,
}

/// Opens the sensor of `driver.imu.connect`; none where that is empty.
///
/// # Errors
/// When the address says nothing, or what is there can never be the sensor. One that is not there is waited for.
pub fn open_imu(config: &Config, stop: &StopFlag) -> Result<Option<LiveImu>, DriverError> {
    let driver = &config.driver.imu;
    if driver.connect.is_empty() {
        return Ok(None);
    }
    Ok(Some(match ImuEndpoint::parse(&driver.connect).map_err(DriverError::ImuAddress)? {
        ImuEndpoint::Serial(line) => {
            let camera_rate_hz = config.camera.first().map_or(0.0, |camera| camera.rate_hz);
            let imu = SerialImu::at(&line, driver, &config.imu, camera_rate_hz, stop.clone())?;
            LiveImu { monitor: imu.monitor(), source: Box::new(imu) }
        }
        ImuEndpoint::Iio { .. } => {
            let imu = IioImu::open(driver, &config.imu, stop.clone())?;
            LiveImu { monitor: imu.monitor(), source: Box::new(imu) }
        }
    }))
}

/// Live cameras and what belongs to them.
pub struct LiveCameras {
    /// Their frames, stamped by the host's monotonic clock. It waits for cameras that are missing, and ends when the flag
    /// that it was opened with is set.
    pub source: Box<dyn StereoSource>,
    /// Figures of the cameras, for the report.
    pub monitor: CameraMonitor,
}

/// Figures of live cameras while another thread reads them.
#[derive(Clone, Debug)]
pub enum CameraMonitor {
    /// Monitor of cameras driven by the kernel (V4L2).
    V4l2(V4l2Monitor),
    /// Monitor of a program that sends frames over a socket.
    Socket(SocketMonitor),
}

impl CameraMonitor {
    /// Reasons why left and right camera bring nothing; `None` while they do.
    pub fn trouble(&self) -> [Option<String>; 2] {
        match self {
            Self::V4l2(monitor) => monitor.trouble(),
            Self::Socket(monitor) => [monitor.trouble(), None],
        }
    }
}

impl CameraMonitor {
    /// Stamps of the frames, and what is wrong with them.
    pub fn stamps(&self) -> (StampFigures, Option<StampProblem>) {
        match self {
            Self::V4l2(monitor) => {
                let [left, right] = monitor.figures().cameras;
                let stamps = StampFigures {
                    used: left.images + right.images,
                    restamped: left.restamped + right.restamped,
                    refused: left.disordered + right.disordered,
                };
                (stamps, left.problem.or(right.problem))
            }
            Self::Socket(monitor) => {
                let SocketFigures { frames: used, restamped, disordered: refused, problem, .. } =
                    monitor.figures();
                (StampFigures { used, restamped, refused }, problem)
            }
        }
    }
}

/// Opens the cameras of `driver.v4l2`, or the socket of `driver.frames`; none where neither is configured.
///
/// # Errors
/// When a device that is there cannot do what is asked of it, or the socket cannot be made. Cameras that are not there are
/// waited for.
pub fn open_cameras(config: &Config, stop: &StopFlag) -> Result<Option<LiveCameras>, DriverError> {
    if let Some(options) = V4l2Options::for_config(config) {
        let cameras = V4l2Stereo::open(&options, stop.clone())?;
        let monitor = CameraMonitor::V4l2(cameras.monitor());
        return Ok(Some(LiveCameras { source: Box::new(cameras), monitor }));
    }
    let (listen, Some(first)) = (&config.driver.frames.listen, config.camera.first()) else {
        return Ok(None);
    };
    if listen.is_empty() {
        return Ok(None);
    }
    let frames =
        SocketStereo::open(Path::new(listen), image_sizes(&config.camera), first.rate_hz, stop.clone())?;
    let monitor = CameraMonitor::Socket(frames.monitor());
    Ok(Some(LiveCameras { source: Box::new(frames), monitor }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::camera::Distortion;
    use plumbline_config::options::{CameraConfig, ImuConfig};

    fn config(connect: &str) -> Config {
        let mut config =
            Config::new(Vec::<CameraConfig>::new(), ImuConfig::with_noise(200.0, (1e-3, 1e-5), (1e-2, 1e-3)));
        config.driver.imu.connect = connect.into();
        config
    }

    #[test]
    fn no_sensor_is_opened_where_none_is_named() {
        assert!(open_imu(&config(""), &StopFlag::new()).unwrap().is_none());
    }

    #[test]
    fn sensors_that_are_not_there_are_waited_for_and_end_when_told() {
        for connect in ["serial:///dev/nobody_has_this:921600", "iio://nobody-has-this"] {
            let stop = StopFlag::new();
            let mut imu = open_imu(&config(connect), &stop).unwrap().unwrap();
            assert!(!imu.monitor.read().link.is_open);
            stop.stop();
            assert_eq!(imu.source.next_reading().unwrap(), None);
        }
    }

    #[test]
    fn cameras_are_those_that_are_named_or_none() {
        let mut config = config("");
        assert!(open_cameras(&config, &StopFlag::new()).unwrap().is_none());
        config.camera.push(CameraConfig {
            width_px: 64,
            height_px: 48,
            rate_hz: 20.0,
            readout_s: 0.0,
            exposure_s: 0.0,
            mask: None,
            focal_px: [40.0; 2],
            centre_px: [31.5, 23.5],
            distortion: Distortion::Equidistant { k1: 0.0, k2: 0.0, k3: 0.0, k4: 0.0 },
            pose_b_c: std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 })),
        });
        let folder = tempfile::tempdir().unwrap();
        config.driver.frames.listen = folder.path().join("frames").display().to_string();
        let cameras = open_cameras(&config, &StopFlag::new()).unwrap().unwrap();
        assert!(cameras.monitor.trouble()[0].as_ref().is_some_and(|why| why.contains("no program sends")));
        config.driver.v4l2.left = "/dev/v4l/by-path/nobody-has-this".into();
        let cameras = open_cameras(&config, &StopFlag::new()).unwrap().unwrap();
        assert!(cameras.monitor.trouble()[0].as_ref().is_some_and(|why| why.contains("driver.v4l2.left")));
    }

    #[test]
    fn an_address_that_says_nothing_is_refused_by_its_key() {
        let error = open_imu(&config("ttyS0"), &StopFlag::new()).err().unwrap().to_string();
        assert!(error.starts_with("driver.imu.connect: "), "{error}");
    }
}
