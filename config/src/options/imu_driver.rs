//! The inertial sensor as a device: where it is, and what it speaks.

use super::serial_line::{SerialLine, split_address};
use serde::{Deserialize, Serialize};

/// Inertial sensor of a live flight. `[imu]` states its rate and its ranges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuDriverConfig {
    /// Address, as [`ImuEndpoint::parse`] reads it; empty for none.
    pub connect: String,
    /// Protocol on a serial line.
    pub protocol: ImuProtocol,
    /// MAVLink message that carries the samples.
    pub mavlink_message: MavlinkImu,
    /// Delay subtracted from every stamp, s: the delay of the sensor's filter (half its averaging time), plus the
    /// shortest transmission time if the device does not answer time requests.
    pub delay_s: f64,
    /// Have the microcontroller trigger the cameras at their rate (`protocol = "plumbline"`).
    pub trigger_cameras: bool,
    /// Length of the trigger pulse, s.
    pub trigger_pulse_s: f64,
    /// How long the exposure of a triggered camera is: frames are stamped by the trigger and half of it.
    pub trigger_exposure: TriggerExposure,
}

impl Default for ImuDriverConfig {
    fn default() -> Self {
        Self {
            connect: String::new(),
            protocol: ImuProtocol::default(),
            mavlink_message: MavlinkImu::default(),
            delay_s: 0.0,
            trigger_cameras: false,
            trigger_pulse_s: 0.001,
            trigger_exposure: TriggerExposure::default(),
        }
    }
}

/// Source of the exposure time of a triggered camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TriggerExposure {
    /// Exposure equals the trigger pulse; if the microcontroller does not report its length, the camera's driver does.
    #[default]
    Pulse,
    /// The camera's driver: the pulse only begins the exposure.
    Camera,
}

/// Protocol of an inertial sensor on a serial line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImuProtocol {
    /// Protocol of Plumbline, for a microcontroller: `docs/serial-protocol.md`.
    #[default]
    Plumbline,
    /// MAVLink 1 or 2, of an autopilot.
    Mavlink,
    /// VectorNav's binary output.
    VectorNav,
    /// MTData2 of Xsens (Movella).
    Xsens,
}

/// Which message of MAVLink carries the samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MavlinkImu {
    /// Real numbers, stamps of a microsecond. PX4 has subtracted its own estimate of the biases.
    #[default]
    HighresImu,
    /// Whole numbers, stamps of a microsecond; in the units of SCALED_IMU, as ArduPilot sends it.
    RawImu,
    /// Thousandths of g and of rad/s, stamps of a millisecond: the first IMU.
    ScaledImu,
    /// SCALED_IMU2: the second IMU, in the units of SCALED_IMU.
    ScaledImu2,
    /// SCALED_IMU3: the third IMU, in the units of SCALED_IMU.
    ScaledImu3,
}

/// Address of an inertial sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ImuEndpoint {
    /// At the other end of a serial line: `serial://DEVICE:BAUD`.
    Serial(SerialLine),
    /// Driven by the kernel (Industrial I/O): `iio://NAME`, or `iio://GYROSCOPE,ACCELEROMETER` where they are two devices.
    Iio {
        /// Name, label or path of the device with the gyroscope.
        gyro: String,
        /// Name, label or path of the device with the accelerometer; `None` if `gyro` has both.
        accel: Option<String>,
    },
}

impl ImuEndpoint {
    /// Reads `serial://DEVICE:BAUD`, `iio://NAME` or `iio://GYROSCOPE,ACCELEROMETER`.
    ///
    /// # Errors
    /// What is wrong with the text, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (kind, rest) = split_address(text, "serial:// or iio://")?;
        match kind.as_str() {
            "serial" => SerialLine::parse(&rest).map(Self::Serial),
            "iio" => {
                let mut names = rest.split(',').map(str::to_owned);
                let (gyro, accel) = (names.next().unwrap_or_default(), names.next());
                if gyro.is_empty() || accel.as_ref().is_some_and(String::is_empty) || names.next().is_some() {
                    return Err(format!(
                        "{rest:?} is not the name of one device, or of two with a comma between"
                    ));
                }
                Ok(Self::Iio { gyro, accel })
            }
            _ => Err(format!("{kind:?} is neither serial nor iio")),
        }
    }
}
