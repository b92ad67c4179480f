//! The inertial sensor as a device: where it is, and what it speaks.

use super::serial_line::{SerialLine, split_address};
use plumbline_keys::keys;

/// Inertial sensor of a live flight. `[imu]` states its rate and its ranges.
#[keys]
pub struct ImuDriverConfig {
    /// Address of the sensor. On a serial line: "serial://DEVICE:BAUD", such as "serial:///dev/serial/by-id/usb-...:921600".
    /// With a kernel driver: "iio://NAME", or "iio://GYROSCOPE,ACCELEROMETER" for two devices. `plumbline devices` lists both
    /// kinds. Empty for none.
    #[key(default)]
    pub connect: String,
    /// Protocol on a serial line: "plumbline" (a microcontroller of your own, docs/serial-protocol.md), "mavlink" (an
    /// autopilot), "vectornav" (binary output) or "xsens" (MTData2).
    #[key(default)]
    pub protocol: ImuProtocol,
    /// MAVLink message that carries the samples: "highres_imu", "raw_imu", "scaled_imu", "scaled_imu2" or "scaled_imu3".
    #[key(default)]
    pub mavlink_message: MavlinkImu,
    /// Delay subtracted from every stamp. It is the delay of the sensor's filter (half its averaging time, which for
    /// PX4's HIGHRES_IMU is 1 / IMU_INTEG_RATE), plus the shortest transmission time if the device does not answer
    /// time requests.
    #[key(default = 0.0, range = 0.0..=0.1, unit = SECONDS)]
    pub delay_s: f64,
    /// Let the microcontroller trigger the cameras (protocol "plumbline"). The rate is their frame rate.
    #[key(default = false)]
    pub trigger_cameras: bool,
    /// Length of the trigger pulse.
    #[key(default = 0.001, range = 1e-6..=0.1, unit = SECONDS)]
    pub trigger_pulse_s: f64,
}

/// Protocol of an inertial sensor on a serial line.
#[keys("lowercase")]
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

impl ImuProtocol {
    /// Every protocol.
    pub const ALL: [Self; 4] = [Self::Plumbline, Self::Mavlink, Self::VectorNav, Self::Xsens];

    /// Least length of a sample on the wire, bytes; with `message` of MAVLink.
    #[must_use]
    pub fn sample_bytes(self, message: MavlinkImu) -> f64 {
        match (self, message) {
            (Self::Plumbline | Self::Xsens, _) => 47.0,
            (Self::VectorNav, _) => 40.0,
            (Self::Mavlink, MavlinkImu::HighresImu) => 70.0,
            (Self::Mavlink, MavlinkImu::RawImu) => 34.0,
            (Self::Mavlink, _) => 30.0,
        }
    }

    /// Unit of the stamps that a sensor sends, in words; with `message` of MAVLink.
    #[must_use]
    pub fn stamp_unit(self, message: MavlinkImu) -> &'static str {
        match (self, message) {
            (Self::Plumbline | Self::VectorNav, _) => "nanoseconds",
            (Self::Mavlink, MavlinkImu::HighresImu | MavlinkImu::RawImu) => "microseconds",
            (Self::Mavlink, _) => "milliseconds",
            (Self::Xsens, _) => "tenths of a millisecond",
        }
    }
}

/// Message of MAVLink that carries the samples.
#[keys("snake_case")]
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
    /// Fault of the text, in words.
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
