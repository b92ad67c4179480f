//! Content of the messages, in SI units.
//!
//! Axes are the autopilot's: x forward, y right, z down; at rest z reads -9.81 m/s². They are the body's, `B`, of this
//! configuration: extrinsics of cameras are to be given against them.

use super::super::protocol::{Content, DeviceSample, vector};
use super::wire::{MAX_PAYLOAD, MessageKind};

/// The g of MAVLink's thousandths, m/s².
const G_M_S2: f64 = 9.80665;
/// Bits of HIGHRES_IMU's `fields_updated` for all axes of accelerometer and gyroscope.
const UPDATED: u16 = 0b11_1111;
/// TIMESYNC: `tc1` and `ts1`.
pub struct Timesync {
    /// The time of whoever answers, ns; 0 in a question.
    pub tc1: i64,
    /// The time of whoever asks, ns.
    pub ts1: i64,
}

/// Numbers of a payload, little-endian. Places are constants within [`MAX_PAYLOAD`].
struct Fields<'a>(&'a [u8; MAX_PAYLOAD]);

impl Fields<'_> {
    fn at<const N: usize>(&self, place: usize) -> [u8; N] {
        std::array::from_fn(|k| self.0[place + k])
    }

    fn reals(&self, place: usize) -> [f64; 3] {
        std::array::from_fn(|k| f64::from(f32::from_le_bytes(self.at(place + 4 * k))))
    }

    fn thousandths(&self, place: usize) -> [f64; 3] {
        std::array::from_fn(|k| f64::from(i16::from_le_bytes(self.at(place + 2 * k))) * 1e-3)
    }
}

/// A sample of one of the IMU messages.
pub fn sample(kind: MessageKind, payload: &[u8; MAX_PAYLOAD]) -> Content {
    let fields = Fields(payload);
    match kind {
        MessageKind::HIGHRES_IMU => highres(&fields),
        MessageKind::RAW_IMU => scaled(&fields, u64::from_le_bytes(fields.at(0)), 8, 27),
        _ => scaled(&fields, u64::from(u32::from_le_bytes(fields.at(0))), 4, 22),
    }
}

/// HIGHRES_IMU: `time_usec`, accelerometer and gyroscope in SI, and later on temperature and what is new since the message
/// before.
fn highres(fields: &Fields<'_>) -> Content {
    let updated = u16::from_le_bytes(fields.at(60));
    // Some senders leave the field empty.
    if updated != 0 && updated & UPDATED != UPDATED {
        return Content::Other;
    }
    let (Some(accel), Some(gyro)) = (vector(fields.reals(8)), vector(fields.reals(20))) else {
        return Content::Malformed;
    };
    let temperature_c = f64::from(f32::from_le_bytes(fields.at(56)));
    Content::Sample(DeviceSample {
        ticks: u64::from_le_bytes(fields.at(0)),
        gyro,
        accel,
        temperature_c: Some(temperature_c).filter(|c| c.is_finite() && *c != 0.0),
        ..DeviceSample::default()
    })
}

/// RAW_IMU and SCALED_IMU*: thousandths of g and of rad/s from `place` on, hundredths of a degree (0 for none) at
/// `temperature`.
fn scaled(fields: &Fields<'_>, ticks: u64, place: usize, temperature: usize) -> Content {
    let accel = fields.thousandths(place).map(|g| g * G_M_S2);
    let hundredths = i16::from_le_bytes(fields.at(temperature));
    Content::Sample(DeviceSample {
        ticks,
        gyro: fields.thousandths(place + 6).into(),
        accel: accel.into(),
        temperature_c: (hundredths != 0).then(|| f64::from(hundredths) * 0.01),
        ..DeviceSample::default()
    })
}

/// Content of a TIMESYNC message.
pub fn timesync(payload: &[u8; MAX_PAYLOAD]) -> Timesync {
    let fields = Fields(payload);
    Timesync { tc1: i64::from_le_bytes(fields.at(0)), ts1: i64::from_le_bytes(fields.at(8)) }
}

/// The payload of a question for the time.
pub fn ask_time(now_ns: i64) -> [u8; MAX_PAYLOAD] {
    let mut payload = [0; MAX_PAYLOAD];
    payload[8..16].copy_from_slice(&now_ns.to_le_bytes());
    payload
}

/// COMMAND_LONG with MAV_CMD_SET_MESSAGE_INTERVAL: the autopilot `system_id` is to send `kind` every `interval_us`.
pub fn ask_for_messages(
    kind: MessageKind,
    interval_us: f32,
    system_id: u8,
    component_id: u8,
) -> [u8; MAX_PAYLOAD] {
    const SET_MESSAGE_INTERVAL: u16 = 511;
    let mut payload = [0; MAX_PAYLOAD];
    payload[0..4].copy_from_slice(&(kind.id as f32).to_le_bytes());
    payload[4..8].copy_from_slice(&interval_us.to_le_bytes());
    payload[28..30].copy_from_slice(&SET_MESSAGE_INTERVAL.to_le_bytes());
    (payload[30], payload[31]) = (system_id, component_id);
    payload
}
