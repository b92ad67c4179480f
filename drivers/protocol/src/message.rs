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
            Self::Trigger(trigger) => {
                to.put(trigger.counter.to_le_bytes());
                to.put(trigger.time_ns.to_le_bytes());
                to.put(trigger.pulse_ns.to_le_bytes());
                to.put([trigger.cameras]);
            }
            Self::Hello(hello) => hello.write(to),
            Self::Time(time) => {
                to.put(time.asked_ns.to_le_bytes());
                to.put(time.received_ns.to_le_bytes());
                to.put(time.sent_ns.to_le_bytes());
            }
            Self::Settings(settings) | Self::Set(settings) => settings.write(to),
            Self::AskHello => {}
            Self::AskTime { asked_ns } => to.put(asked_ns.to_le_bytes()),
        }
    }

    /// None for a type that is not known, or a payload that is too short for it.
    pub(crate) fn read(kind: u8, from: &mut Reader<'_>) -> Option<Self> {
        Some(match kind {
            0x01 => Self::Imu(Imu::read(from)?),
            0x02 => Self::Trigger(Trigger {
                counter: from.u32()?,
                time_ns: from.u64()?,
                pulse_ns: from.u32()?,
                cameras: from.u8()?,
            }),
            0x03 => Self::Hello(Hello::read(from)?),
            0x04 => {
                Self::Time(Time { asked_ns: from.u64()?, received_ns: from.u64()?, sent_ns: from.u64()? })
            }
            0x05 => Self::Settings(Settings::read(from)?),
            0x81 => Self::AskHello,
            0x82 => Self::AskTime { asked_ns: from.u64()? },
            0x83 => Self::Set(Settings::read(from)?),
            _ => return None,
        })
    }
}

impl Imu {
    fn write(&self, to: &mut Writer<'_>) {
        to.put(self.sequence.to_le_bytes());
        to.put(self.time_ns.to_le_bytes());
        for value in self.gyro_rad_s.iter().chain(&self.accel_m_s2) {
            to.put(value.to_le_bytes());
        }
        // The cast saturates; what is no number is none.
        let hundredths =
            |c: f32| if c.is_nan() { NO_TEMPERATURE } else { ((c * 100.0) as i16).max(NO_TEMPERATURE + 1) };
        to.put(self.temperature_c.map_or(NO_TEMPERATURE, hundredths).to_le_bytes());
        to.put([self.flags.bits()]);
    }

    fn read(from: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            sequence: from.u32()?,
            time_ns: from.u64()?,
            gyro_rad_s: from.vector()?,
            accel_m_s2: from.vector()?,
            temperature_c: Some(i16::from_le_bytes(from.take()?))
                .filter(|hundredths| *hundredths != NO_TEMPERATURE)
                .map(|hundredths| f32::from(hundredths) / 100.0),
            flags: Flags::from_bits(from.u8()?),
        })
    }
}

impl Flags {
    const fn bits(self) -> u8 {
        self.gyro_saturated as u8 | (self.accel_saturated as u8) << 1 | (self.sensor_failed as u8) << 2
    }

    const fn from_bits(bits: u8) -> Self {
        Self { gyro_saturated: bits & 1 != 0, accel_saturated: bits & 2 != 0, sensor_failed: bits & 4 != 0 }
    }
}

impl Hello {
    fn write(&self, to: &mut Writer<'_>) {
        to.put([self.protocol]);
        to.put(self.firmware);
        to.put(self.device_id.to_le_bytes());
        to.put(self.imu_rate_mhz.to_le_bytes());
        to.put(self.gyro_range_rad_s.to_le_bytes());
        to.put(self.accel_range_m_s2.to_le_bytes());
    }

    fn read(from: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            protocol: from.u8()?,
            firmware: from.take()?,
            device_id: from.u64()?,
            imu_rate_mhz: from.u32()?,
            gyro_range_rad_s: from.f32()?,
            accel_range_m_s2: from.f32()?,
        })
    }
}

impl Settings {
    fn write(&self, to: &mut Writer<'_>) {
        to.put(self.imu_rate_mhz.to_le_bytes());
        to.put(self.trigger_rate_mhz.to_le_bytes());
        to.put(self.trigger_pulse_us.to_le_bytes());
        to.put([self.cameras]);
    }

    fn read(from: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            imu_rate_mhz: from.u32()?,
            trigger_rate_mhz: from.u32()?,
            trigger_pulse_us: from.u32()?,
            cameras: from.u8()?,
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

    fn u8(&mut self) -> Option<u8> {
        self.take().map(u8::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.take().map(u64::from_le_bytes)
    }

    fn f32(&mut self) -> Option<f32> {
        self.take().map(f32::from_le_bytes)
    }

    fn vector(&mut self) -> Option<[f32; 3]> {
        Some([self.f32()?, self.f32()?, self.f32()?])
    }
}
