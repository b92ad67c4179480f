//! Devices that play a known motion, for tests and fuzzers.

use super::mavlink;
use super::protocol::Protocol;
use ::mavlink::MavHeader;
use ::mavlink::dialects::common::{HIGHRES_IMU_DATA, HighresImuUpdatedFlags, MavMessage};
use crc::{CRC_16_XMODEM, Crc};
use plumbline_config::options::{ImuConfig, ImuProtocol, MavlinkImu};
use plumbline_protocol::{Imu, MAX_FRAME, Message, Settings, encode};

/// A sensor of wide ranges.
pub fn imu_config(rate_hz: f64) -> ImuConfig {
    ImuConfig::with_noise(rate_hz, (1e-3, 1e-5), (1e-2, 1e-3))
}

/// Rate of the x axis from one sample to the next, rad/s: the number of a sample stands in its values.
pub const STEP_RAD_S: f64 = 1e-4;

/// A device that measures at whole periods of the host's clock from `start_ns` on, and stamps by a clock of its own.
#[derive(Clone, Copy, Debug)]
pub struct Device {
    pub protocol: ImuProtocol,
    pub rate_hz: i64,
    pub start_ns: i64,
    /// Device seconds per host second, less one.
    pub skew: f64,
}

impl Device {
    /// Time at which sample `k` is measured by the host's clock, ns.
    pub fn truth_ns(&self, k: i64) -> i64 {
        self.start_ns + k * 1_000_000_000 / self.rate_hz
    }

    /// The device's time for a time of the host, ns.
    pub fn device_ns(&self, host_ns: i64) -> i64 {
        let since = host_ns - self.start_ns;
        3_000_000_000 + since + (since as f64 * self.skew).round() as i64
    }

    /// The frame of sample `k`.
    pub fn frame(&self, k: i64) -> Vec<u8> {
        let device_ns = self.device_ns(self.truth_ns(k));
        let gyro = [(k as f64 * STEP_RAD_S) as f32, 0.01, -0.02];
        let accel = [0.1, 0.2, 9.81 + 1e-3 * (k % 7) as f32];
        played(self.protocol, k, device_ns, gyro, accel)
    }
}

/// A protocol as it is where nothing is said of it.
pub fn opened(protocol: ImuProtocol) -> Box<dyn Protocol> {
    super::opened(protocol, (MavlinkImu::HighresImu, 200.0), Settings::default())
}

/// Frame of sample `k`, measured at `device_ns` of the device's clock, as a device sends it.
fn played(protocol: ImuProtocol, k: i64, device_ns: i64, gyro: [f32; 3], accel: [f32; 3]) -> Vec<u8> {
    match protocol {
        ImuProtocol::Plumbline => {
            let imu = Imu {
                sequence: k as u32,
                time_ns: device_ns as u64,
                gyro_rad_s: gyro,
                accel_m_s2: accel,
                temperature_c: Some(30.0),
                ..Imu::default()
            };
            encode(&Message::Imu(imu), &mut [0; MAX_FRAME]).to_vec()
        }
        ImuProtocol::Mavlink => {
            let ([xgyro, ygyro, zgyro], [xacc, yacc, zacc]) = (gyro, accel);
            let time_usec = (device_ns / 1000) as u64;
            let fields_updated = HighresImuUpdatedFlags::from_bits_retain(0b11_1111);
            let sample = HIGHRES_IMU_DATA {
                time_usec,
                xacc,
                yacc,
                zacc,
                xgyro,
                ygyro,
                zgyro,
                fields_updated,
                ..Default::default()
            };
            let header = MavHeader { system_id: 1, component_id: 1, sequence: 0 };
            mavlink::written(header, &MavMessage::HIGHRES_IMU(sample)).raw_bytes().to_vec()
        }
        ImuProtocol::VectorNav => {
            // TimeStartup and Imu.
            let values = accel.iter().chain(&gyro).flat_map(|value| value.to_le_bytes());
            let values: Vec<u8> = (device_ns as u64).to_le_bytes().into_iter().chain(values).collect();
            vectornav_frame(&[(0, 1 | 1 << 9)], &values)
        }
        ImuProtocol::Xsens => {
            // PacketCounter, SampleTimeFine, Acceleration and RateOfTurn.
            let mut content = vec![0x10, 0x20, 2];
            content.extend((k as u16).to_be_bytes());
            content.extend([0x10, 0x60, 4]);
            content.extend(((device_ns / 100_000) as u32).to_be_bytes());
            for (number, values) in [(0x4020_u16, accel), (0x8020, gyro)] {
                content.extend(number.to_be_bytes());
                content.push(12);
                content.extend(values.iter().flat_map(|value| value.to_be_bytes()));
            }
            xsens_message(0x36, &content)
        }
    }
}

/// A frame of VectorNav of these groups, fields and values.
pub fn vectornav_frame(fields: &[(u8, u16)], values: &[u8]) -> Vec<u8> {
    let mut covered = vec![fields.iter().fold(0, |groups, (group, _)| groups | 1 << group)];
    fields.iter().for_each(|(_, bits)| covered.extend(bits.to_le_bytes()));
    covered.extend(values);
    covered.extend(Crc::<u16>::new(&CRC_16_XMODEM).checksum(&covered.clone()).to_be_bytes());
    [&[0xFA], &covered[..]].concat()
}

/// A message of Xsens with a header and a checksum.
pub fn xsens_message(id: u8, content: &[u8]) -> Vec<u8> {
    let mut bytes = match content.len() {
        length @ 0..255 => vec![0xFF, id, length as u8],
        length => [&[0xFF, id, 0xFF], &(length as u16).to_be_bytes()[..]].concat(),
    };
    bytes.extend(content);
    bytes.push(bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_sub(*byte)));
    [&[0xFA], &bytes[..]].concat()
}
