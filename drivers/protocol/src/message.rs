//! Messages and their layout in a payload.

/// The version that this crate speaks, as [`Hello`] tells it.
pub const VERSION: u8 = 1;

/// Temperature that stands for none.
const NO_TEMPERATURE: i16 = i16::MIN;

/// One message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// Device to host: a sample of the IMU.
    Imu(Imu),
    /// Device to host: the cameras were triggered.
    Trigger(Trigger),
    /// Device to host: who it is. Sent when it starts, and when asked for.
    Hello(Hello),
    /// Device to host: the answer to [`Message::AskTime`].
    Time(Time),
    /// Device to host: the settings in force. Sent after [`Message::Set`].
    Settings(Settings),
    /// Host to device: say who you are.
    AskHello,
    /// Host to device: what time is it?
    AskTime {
        /// The host's time, which the answer brings back, ns.
        asked_ns: u64,
    },
    /// Host to device: use these settings.
    Set(Settings),
}

/// A sample of the IMU.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Imu {
    /// Counts samples of the sensor, also those that were not sent; begins anew after 2^32.
    pub sequence: u32,
    /// Time of measurement (the data-ready interrupt) by the device's clock, ns since it started.
    pub time_ns: u64,
    /// Angular rate in the IMU's axes, rad/s.
    pub gyro_rad_s: [f32; 3],
    /// Specific force in the IMU's axes, m/s² (at rest it points up).
    pub accel_m_s2: [f32; 3],
    /// Temperature of the sensor, degrees Celsius, to a hundredth; `None` if it was not read with this sample.
    pub temperature_c: Option<f32>,
    /// Faults of this sample.
    pub flags: Flags,
}

/// Faults of a sample, as the device reports them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// Bit 0: an axis of the gyroscope is at the end of its range.
    pub gyro_saturated: bool,
    /// Bit 1: an axis of the accelerometer is.
    pub accel_saturated: bool,
    /// Bit 2: the sensor reports a failure, or gave the same sample again.
    pub sensor_failed: bool,
}

/// The cameras were triggered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Trigger {
    /// Counts triggers since the device started, from 0; begins anew after 2^32.
    pub counter: u32,
    /// Time of the edge by the device's clock, ns: the start of the exposure.
    pub time_ns: u64,
    /// Length of the pulse, ns: the exposure of cameras that expose during it; 0 where they decide
    /// themselves.
    pub pulse_ns: u32,
    /// Triggered cameras: bit 0 is the first.
    pub cameras: u8,
}

/// Identity of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hello {
    /// Version of the protocol, [`VERSION`].
    pub protocol: u8,
    /// Version of the firmware.
    pub firmware: [u8; 3],
    /// Number of the device, such as its chip's.
    pub device_id: u64,
    /// Samples a second, thousandths.
    pub imu_rate_mhz: u32,
    /// Largest angular rate that the sensor can report, rad/s.
    pub gyro_range_rad_s: f32,
    /// Largest specific force that the sensor can report, m/s².
    pub accel_range_m_s2: f32,
}

/// The time, asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Time {
    /// The host's time of the question, ns.
    pub asked_ns: u64,
    /// Arrival of the last byte of the question by the device's clock, ns.
    pub received_ns: u64,
    /// Departure of the first byte of this answer by the device's clock, ns.
    pub sent_ns: u64,
}

/// Rates and pulses that the host asks of the device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settings {
    /// Samples of the IMU a second, thousandths; 0 leaves it to the device.
    pub imu_rate_mhz: u32,
    /// Triggers a second, thousandths; 0 for none.
    pub trigger_rate_mhz: u32,
    /// Length of a trigger pulse, us.
    pub trigger_pulse_us: u32,
    /// Cameras to trigger: bit 0 is the first.
    pub cameras: u8,
}

impl Message {
    /// Type on the wire.
    #[must_use]
    pub const fn kind(&self) -> u8 {
        match self {
            Self::Imu(_) => 0x01,
            Self::Trigger(_) => 0x02,
            Self::Hello(_) => 0x03,
            Self::Time(_) => 0x04,
            Self::Settings(_) => 0x05,
            Self::AskHello => 0x81,
            Self::AskTime { .. } => 0x82,
            Self::Set(_) => 0x83,
        }
    }

    pub(crate) fn write(&self, to: &mut Writer<'_>) {
        match self {
            Self::Imu(imu) => imu.write(to),
            Self::Trigger(trigger) => trigger.write(to),
            Self::Hello(hello) => hello.write(to),
            Self::Time(time) => time.write(to),
            Self::Settings(settings) | Self::Set(settings) => settings.write(to),
            Self::AskHello => {}
            Self::AskTime { asked_ns } => asked_ns.write(to),
        }
    }

    /// None for a type that is not known, or a payload that is too short for it.
    pub(crate) fn read(kind: u8, from: &mut Reader<'_>) -> Option<Self> {
        Some(match kind {
            0x01 => Self::Imu(Wire::read(from)?),
            0x02 => Self::Trigger(Wire::read(from)?),
            0x03 => Self::Hello(Wire::read(from)?),
            0x04 => Self::Time(Wire::read(from)?),
            0x05 => Self::Settings(Wire::read(from)?),
            0x81 => Self::AskHello,
            0x82 => Self::AskTime { asked_ns: Wire::read(from)? },
            0x83 => Self::Set(Wire::read(from)?),
            _ => return None,
        })
    }
}

/// Part of a payload.
trait Wire: Sized {
    fn write(&self, to: &mut Writer<'_>);

    /// None when there are too few bytes.
    fn read(from: &mut Reader<'_>) -> Option<Self>;
}

/// Little-endian numbers.
macro_rules! numbers {
    ($($number:ty),+) => {$(
        impl Wire for $number {
            fn write(&self, to: &mut Writer<'_>) {
                to.put(self.to_le_bytes());
            }

            fn read(from: &mut Reader<'_>) -> Option<Self> {
                from.take().map(Self::from_le_bytes)
            }
        }
    )+};
}

numbers!(u8, i16, u32, u64, f32);

/// Structures, their fields in the order in which they stand here.
macro_rules! structures {
    ($($name:ident { $($field:ident),+ })+) => {$(
        impl Wire for $name {
            fn write(&self, to: &mut Writer<'_>) {
                $(self.$field.write(to);)+
            }

            fn read(from: &mut Reader<'_>) -> Option<Self> {
                Some(Self { $($field: Wire::read(from)?),+ })
            }
        }
    )+};
}

structures! {
    Imu { sequence, time_ns, gyro_rad_s, accel_m_s2, temperature_c, flags }
    Trigger { counter, time_ns, pulse_ns, cameras }
    Hello { protocol, firmware, device_id, imu_rate_mhz, gyro_range_rad_s, accel_range_m_s2 }
    Time { asked_ns, received_ns, sent_ns }
    Settings { imu_rate_mhz, trigger_rate_mhz, trigger_pulse_us, cameras }
}

impl<T: Wire + Copy + Default> Wire for [T; 3] {
    fn write(&self, to: &mut Writer<'_>) {
        self.iter().for_each(|value| value.write(to));
    }

    fn read(from: &mut Reader<'_>) -> Option<Self> {
        Some([T::read(from)?, T::read(from)?, T::read(from)?])
    }
}

/// A temperature, in hundredths of a degree.
impl Wire for Option<f32> {
    fn write(&self, to: &mut Writer<'_>) {
        // The cast saturates; what is no number is none.
        let hundredths = |c: &f32| ((c * 100.0) as i16).max(NO_TEMPERATURE + 1);
        self.as_ref().filter(|c| !c.is_nan()).map_or(NO_TEMPERATURE, hundredths).write(to);
    }

    fn read(from: &mut Reader<'_>) -> Option<Self> {
        let hundredths = i16::read(from)?;
        Some((hundredths != NO_TEMPERATURE).then(|| f32::from(hundredths) / 100.0))
    }
}

impl Wire for Flags {
    fn write(&self, to: &mut Writer<'_>) {
        let bits = [self.gyro_saturated, self.accel_saturated, self.sensor_failed];
        bits.iter().rev().fold(0, |flags, is_set| flags << 1 | u8::from(*is_set)).write(to);
    }

    fn read(from: &mut Reader<'_>) -> Option<Self> {
        let bits = u8::read(from)?;
        Some(Self {
            gyro_saturated: bits & 1 != 0,
            accel_saturated: bits & 2 != 0,
            sensor_failed: bits & 4 != 0,
        })
    }
}

/// Puts bytes one after the other; what does not fit is left out, which no message of this crate comes to.
pub(crate) struct Writer<'a> {
    pub(crate) bytes: &'a mut [u8],
    pub(crate) length: usize,
}

impl Writer<'_> {
    pub(crate) fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        if let Some(place) = self.bytes.get_mut(self.length..self.length + N) {
            place.copy_from_slice(&bytes);
            self.length += N;
        }
    }
}

/// Takes bytes one after the other; none when there are too few.
pub(crate) struct Reader<'a>(pub(crate) &'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (bytes, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*bytes)
    }
}
