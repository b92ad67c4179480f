//! The live inertial sensor that a configuration names, whichever it is.

use crate::iio::IioImu;
use crate::inertial::ImuMonitor;
use crate::serial::{SerialImu, TriggerEvent};
use crate::{DriverError, ImuSource, StopFlag};
use plumbline_config::Config;
use plumbline_config::options::ImuEndpoint;
use rtrb::Consumer;

/// A live inertial sensor and what belongs to it.
pub struct LiveImu {
    /// Its samples, stamped by the host's monotonic clock. It waits for a device that is missing, and ends when the flag
    /// that it was opened with is set.
    pub source: Box<dyn ImuSource>,
    /// What becomes of them, for whoever tells of it.
    pub monitor: ImuMonitor,
    /// The triggers of the cameras, where the sensor's microcontroller gives them.
    pub triggers: Option<Consumer<TriggerEvent>>,
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
            let mut imu = SerialImu::at(&line, driver, &config.imu, camera_rate_hz, stop.clone())?;
            LiveImu { monitor: imu.monitor(), triggers: imu.take_triggers(), source: Box::new(imu) }
        }
        ImuEndpoint::Iio { .. } => {
            let imu = IioImu::open(driver, &config.imu, stop.clone())?;
            LiveImu { monitor: imu.monitor(), triggers: None, source: Box::new(imu) }
        }
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::options::{CameraConfig, ImuConfig};

    fn config(connect: &str) -> Config {
        let mut config = Config::with_defaults(
            Vec::<CameraConfig>::new(),
            ImuConfig::with_noise(200.0, (1e-3, 1e-5), (1e-2, 1e-3)),
        );
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
            assert!(!imu.monitor.read().link.is_open && imu.triggers.is_none());
            stop.stop();
            assert_eq!(imu.source.next_reading().unwrap(), None);
        }
    }

    #[test]
    fn triggers_are_there_where_cameras_are_triggered() {
        let mut config = config("serial:///dev/nobody_has_this:921600");
        config.driver.imu.trigger_cameras = true;
        assert!(open_imu(&config, &StopFlag::new()).unwrap().unwrap().triggers.is_some());
    }

    #[test]
    fn an_address_that_says_nothing_is_refused_by_its_key() {
        let error = open_imu(&config("ttyS0"), &StopFlag::new()).err().unwrap().to_string();
        assert!(error.starts_with("driver.imu.connect: "), "{error}");
    }
}
