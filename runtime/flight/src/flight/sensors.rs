//! Opening live sensors: the inertial sensor and the cameras that a configuration names.

use super::capture::{PairCounts, SharedMeter, StreamFigures, Watched};
use super::{Flight, FlightError};
use crate::pipeline::Stamps;
use plumbline_config::ValidConfig;
use plumbline_config::options::{AutopilotEndpoint, ImuDriverConfig, ImuEndpoint};
use plumbline_drivers::{
    CameraMonitor, ImuMonitor, ImuSource, StereoSource, StopFlag, open_cameras, open_imu,
};

/// Sensors of a flight: views to be read during the flight and after it.
#[derive(Clone, Debug)]
pub struct LiveSensors {
    /// The inertial sensor.
    pub imu: SensorView<ImuMonitor>,
    /// The cameras.
    pub cameras: SensorView<CameraMonitor>,
    /// Stamps that the inertial sensor is expected to send, in words.
    pub sample_clock: String,
}

/// View of one sensor.
#[derive(Clone, Debug)]
pub struct SensorView<M> {
    /// Address, as the configuration has it.
    pub name: String,
    /// Counts of its driver.
    pub monitor: M,
    meter: SharedMeter,
}

impl<M> SensorView<M> {
    /// Figures of its stream, complete after the flight.
    pub fn figures(&self) -> (StreamFigures, PairCounts) {
        self.meter.figures()
    }
}

/// Opens the sensors of `config`, whose streams end when `stop` is set. Those that are not there yet are waited for.
///
/// # Errors
/// When the configuration names none, or what is there cannot be used. The message names the key or the device.
pub fn open_sensors(config: &ValidConfig, stop: &StopFlag) -> Result<(Flight, LiveSensors), FlightError> {
    config.refuse_unset_keys()?;
    check_line(config)?;
    let imu = open_imu(config, stop)?.ok_or_else(|| {
        FlightError::Invalid(
            "driver.imu.connect is empty: say where the IMU is, serial://DEVICE:BAUD or iio://NAME \
             (`plumbline devices` lists what is there)"
                .into(),
        )
    })?;
    let cameras = open_cameras(config, stop)?.ok_or_else(no_cameras)?;
    let (source, meter) = Watched::<dyn ImuSource>::new(imu.source, config.imu.rate_hz);
    let imu = SensorView { name: config.driver.imu.connect.clone(), monitor: imu.monitor, meter };
    let (stereo, meter) = Watched::<dyn StereoSource>::new(cameras.source, config.camera[0].rate_hz);
    let cameras = SensorView { name: cameras_name(config), monitor: cameras.monitor, meter };
    let name = format!("live, {} and {}", cameras.name, imu.name);
    let flight = Flight::new(config.clone(), Box::new(source), Box::new(stereo), name);
    let flight = Flight { stamps: Stamps::OfHost, ..flight };
    Ok((flight, LiveSensors { imu, cameras, sample_clock: sample_clock(&config.driver.imu) }))
}

/// Stamps that an inertial sensor is expected to send, in words.
fn sample_clock(driver: &ImuDriverConfig) -> String {
    if let Ok(ImuEndpoint::Iio { .. }) = ImuEndpoint::parse(&driver.connect) {
        return "the time of measurement in nanoseconds of the kernel's clock".into();
    }
    format!("the time of measurement in {}", driver.protocol.stamp_unit(driver.mavlink_message))
}

fn no_cameras() -> FlightError {
    FlightError::Invalid(
        "driver.v4l2.left is empty, and so is driver.frames.listen: name the cameras (`plumbline devices` lists those that \
         are there), or a socket for frames of your own"
            .into(),
    )
}

fn cameras_name(config: &ValidConfig) -> String {
    let (v4l2, frames) = (&config.driver.v4l2, &config.driver.frames);
    match (v4l2.left.is_empty(), v4l2.right.is_empty()) {
        (true, _) => frames.listen.clone(),
        (false, true) => v4l2.left.clone(),
        (false, false) => format!("{}, {}", v4l2.left, v4l2.right),
    }
}

/// A serial line has one reader.
fn check_line(config: &ValidConfig) -> Result<(), FlightError> {
    let imu = ImuEndpoint::parse(&config.driver.imu.connect);
    let autopilot = AutopilotEndpoint::parse(&config.autopilot.connect);
    match (imu, autopilot) {
        (Ok(ImuEndpoint::Serial(imu)), Ok(AutopilotEndpoint::Serial(line))) if imu.device == line.device => {
            Err(FlightError::Invalid(format!(
                "driver.imu.connect and autopilot.connect are both {}, which has one reader: give the IMU of the \
                 autopilot a port of its own, or tell the autopilot by UDP",
                line.device
            )))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Config;

    fn refused(change: impl FnOnce(&mut Config)) -> String {
        let config = Config::preset("sim").unwrap().with("test", change).unwrap();
        open_sensors(&config, &StopFlag::new()).err().unwrap().to_string()
    }

    #[test]
    fn a_configuration_without_sensors_is_refused_by_its_keys() {
        assert!(refused(|_| {}).starts_with("driver.imu.connect is empty"));
        let without_cameras = refused(|c| c.driver.imu.connect = "iio://nobody-has-this".into());
        assert!(
            without_cameras.contains("driver.v4l2.left") && without_cameras.contains("driver.frames.listen")
        );
    }

    #[test]
    fn one_line_is_not_read_twice() {
        let said = refused(|c| {
            c.driver.imu.connect = "serial:///dev/ttyNOBODY:921600".into();
            c.autopilot.connect = "serial:///dev/ttyNOBODY:921600".into();
        });
        assert!(said.contains("/dev/ttyNOBODY") && said.contains("autopilot.connect"), "{said}");
    }
}
