//! The IMU of an autopilot, by MAVLink 1 or 2.
//!
//! One of HIGHRES_IMU, RAW_IMU and SCALED_IMU* carries the samples; TIMESYNC, which we ask for, tells the
//! autopilot's time. While fewer samples come than the configuration says, the autopilot is asked for more
//! (MAV_CMD_SET_MESSAGE_INTERVAL) every few seconds.
//!
//! The common layer finds frames in the bytes; checksums, fields and the writing are those of the crate `mavlink`. Messages that
//! do not concern us are passed over byte by byte, which finds the frame behind them whatever they hold.
//!
//! Axes are the autopilot's: x forward, y right, z down; at rest z reads -9.81 m/s². They are the body's, `B`, of this
//! configuration: extrinsics of cameras are to be given against them.

use super::framing::{Scan, before_any};
use super::protocol::{Content, DeviceSample, Outgoing, Protocol, Questions, TimeAnswer, TimeUnit, vector};
use mavlink::dialects::common::{
    COMMAND_LONG_DATA, HIGHRES_IMU_DATA, MavCmd, MavMessage, RAW_IMU_DATA, SCALED_IMU_DATA, SCALED_IMU2_DATA,
    SCALED_IMU3_DATA, TIMESYNC_DATA,
};
use mavlink::{
    MAVLinkMessageRaw, MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader, Message as _, MessageData,
};
use plumbline_config::options::MavlinkImu;

/// First bytes of the frames of both versions.
const MARKS: [u8; 2] = [0xFE, 0xFD];
/// Flag of a frame whose checksum is followed by a signature of so many bytes.
const SIGNED: u8 = 1;
const SIGNATURE: usize = 13;
/// Messages that concern us.
const RECEIVED: [u32; 6] = [
    HIGHRES_IMU_DATA::ID,
    RAW_IMU_DATA::ID,
    SCALED_IMU_DATA::ID,
    SCALED_IMU2_DATA::ID,
    SCALED_IMU3_DATA::ID,
    TIMESYNC_DATA::ID,
];
/// The g of MAVLink's thousandths, m/s².
const G_M_S2: f64 = 9.80665;
/// Our component ID in the vehicle's system: MAV_COMP_ID_ONBOARD_COMPUTER.
const OUR_COMPONENT: u8 = 191;
/// The rate of the samples is looked at this often, ns.
const RATE_NS: i64 = 5_000_000_000;
/// Less than this share of the configured rate is asked to be more.
const ENOUGH: f64 = 0.9;

/// The IMU of an autopilot.
#[derive(Debug)]
pub struct Mavlink {
    /// Number of the message with the samples.
    id: u32,
    rate_hz: f64,
    /// System and component that the samples come from: the first that was heard.
    autopilot: Option<(u32, u8)>,
    questions: Questions,
    sequence: u8,
    samples: u64,
    /// Last check of the rate: its time, and the number of samples then.
    looked: Option<(i64, u64)>,
}

impl Mavlink {
    /// Samples of `message`, which should come `rate_hz` times a second.
    pub fn new(message: MavlinkImu, rate_hz: f64) -> Self {
        let id = match message {
            MavlinkImu::HighresImu => HIGHRES_IMU_DATA::ID,
            MavlinkImu::RawImu => RAW_IMU_DATA::ID,
            MavlinkImu::ScaledImu => SCALED_IMU_DATA::ID,
            MavlinkImu::ScaledImu2 => SCALED_IMU2_DATA::ID,
            MavlinkImu::ScaledImu3 => SCALED_IMU3_DATA::ID,
        };
        Self {
            id,
            rate_hz,
            autopilot: None,
            questions: Questions::default(),
            sequence: 0,
            samples: 0,
            looked: None,
        }
    }

    fn answer(&mut self, sync: &TIMESYNC_DATA) -> Content {
        // A question of the autopilot has tc1 = 0; an answer to somebody else another ts1.
        if sync.tc1 <= 0 || !self.questions.take(sync.ts1) {
            return Content::Other;
        }
        Content::Answer(TimeAnswer {
            asked_ns: sync.ts1,
            device_received_ns: sync.tc1,
            device_sent_ns: sync.tc1,
        })
    }

    fn say(&mut self, message: &MavMessage, into: &mut Outgoing) {
        let system_id = self.autopilot.map_or(1, |(system, _)| system);
        let header = MavHeader { system_id, component_id: OUR_COMPONENT, sequence: self.sequence };
        into.push(written(header, message).raw_bytes());
        self.sequence = self.sequence.wrapping_add(1);
    }

    /// True if too few samples came since the last check.
    fn is_slow(&mut self, now_ns: i64) -> bool {
        let Some((since_ns, samples)) = self.looked else {
            self.looked = Some((now_ns, self.samples));
            return true;
        };
        let span_ns = now_ns.saturating_sub(since_ns);
        if span_ns < RATE_NS {
            return false;
        }
        self.looked = Some((now_ns, self.samples));
        let came = self.samples.saturating_sub(samples) as f64;
        came < ENOUGH * self.rate_hz * span_ns as f64 * 1e-9
    }
}

impl Protocol for Mavlink {
    fn scan(&self, bytes: &[u8]) -> Scan {
        let (id, around) = match *bytes {
            [0xFE, _, _, _, _, id, ..] => (u32::from(id), 8),
            [0xFD, _, flags, _, _, _, _, a, b, c, ..] if flags & !SIGNED == 0 => {
                (u32::from_le_bytes([a, b, c, 0]), 12 + usize::from(flags) * SIGNATURE)
            }
            [0xFE, ref rest @ ..] if rest.len() < 5 => return Scan::More,
            [0xFD] | [0xFD, _] => return Scan::More,
            [0xFD, _, flags, ref rest @ ..] if rest.len() < 7 && flags & !SIGNED == 0 => return Scan::More,
            _ => (u32::MAX, 0),
        };
        if !RECEIVED.contains(&id) {
            return Scan::Noise(1 + before_any(&bytes[1..], &MARKS));
        }
        let length = usize::from(bytes[1]) + around;
        match bytes.get(..length) {
            None => Scan::More,
            Some(frame) if taken_apart(frame).is_some() => Scan::Frame(length),
            Some(_) => Scan::BadChecksum(1),
        }
    }

    fn decode(&mut self, frame: &[u8]) -> Content {
        let Some(frame) = taken_apart(frame) else { return Content::Malformed };
        let sender = (frame.system_id(), frame.component_id());
        if self.autopilot.is_some_and(|autopilot| autopilot != sender) {
            return Content::Other;
        }
        let id = frame.message_id();
        let message = MavMessage::parse(frame.version(), id, frame.payload());
        if let Ok(MavMessage::TIMESYNC(sync)) = &message {
            return self.answer(sync);
        }
        if id != self.id {
            return Content::Other;
        }
        self.autopilot = Some(sender);
        let content = message.map_or(Content::Malformed, |message| sample(&message));
        self.samples += u64::from(matches!(content, Content::Sample(_)));
        content
    }

    fn time_unit(&self) -> TimeUnit {
        match self.id {
            HIGHRES_IMU_DATA::ID | RAW_IMU_DATA::ID => TimeUnit { bits: 64, tick_ns: 1_000 },
            _ => TimeUnit { bits: 32, tick_ns: 1_000_000 },
        }
    }

    fn asks_time(&self) -> bool {
        true
    }

    fn request(&mut self, now_ns: i64, into: &mut Outgoing) {
        if self.questions.is_due(now_ns) {
            let asked = TIMESYNC_DATA { ts1: now_ns, ..TIMESYNC_DATA::default() };
            self.say(&MavMessage::TIMESYNC(asked), into);
        }
        if self.is_slow(now_ns) {
            let (system, component) = self.autopilot.unwrap_or((1, 1));
            let asked = COMMAND_LONG_DATA {
                param1: self.id as f32,
                param2: (1e6 / self.rate_hz).round() as f32,
                command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                target_system: system as u8,
                target_component: component,
                ..COMMAND_LONG_DATA::default()
            };
            self.say(&MavMessage::COMMAND_LONG(asked), into);
        }
    }

    fn restart(&mut self) {
        self.autopilot = None;
        self.questions = Questions::default();
        self.looked = None;
    }
}

/// A whole frame with the right checksum.
fn taken_apart(frame: &[u8]) -> Option<MAVLinkMessageRaw> {
    if frame.first() == Some(&0xFD) {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.as_mut_slice().get_mut(..frame.len())?.copy_from_slice(frame);
        raw.has_valid_crc::<MavMessage>().then_some(MAVLinkMessageRaw::V2(raw))
    } else {
        let mut raw = MAVLinkV1MessageRaw::new();
        raw.as_mut_slice().get_mut(..frame.len())?.copy_from_slice(frame);
        raw.has_valid_crc::<MavMessage>().then_some(MAVLinkMessageRaw::V1(raw))
    }
}

/// A message as a frame of MAVLink 2.
pub(super) fn written(header: MavHeader, message: &MavMessage) -> MAVLinkV2MessageRaw {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message(header, message);
    raw
}

/// A sample of one of the IMU messages.
fn sample(message: &MavMessage) -> Content {
    macro_rules! scaled {
        ($imu:ident, $ticks:expr) => {{
            let gyro = [$imu.xgyro, $imu.ygyro, $imu.zgyro];
            scaled($ticks, gyro, [$imu.xacc, $imu.yacc, $imu.zacc])
        }};
    }
    match message {
        MavMessage::HIGHRES_IMU(imu) => highres(imu),
        MavMessage::RAW_IMU(imu) => scaled!(imu, imu.time_usec),
        MavMessage::SCALED_IMU(imu) => scaled!(imu, imu.time_boot_ms.into()),
        MavMessage::SCALED_IMU2(imu) => scaled!(imu, imu.time_boot_ms.into()),
        MavMessage::SCALED_IMU3(imu) => scaled!(imu, imu.time_boot_ms.into()),
        _ => Content::Other,
    }
}

/// Bits of HIGHRES_IMU's `fields_updated` for all axes of accelerometer and gyroscope.
const UPDATED: u16 = 0b11_1111;

/// HIGHRES_IMU: accelerometer and gyroscope in SI, and what is new since the message before.
fn highres(imu: &HIGHRES_IMU_DATA) -> Content {
    let updated = imu.fields_updated.bits();
    // Some senders leave the field empty.
    if updated != 0 && updated & UPDATED != UPDATED {
        return Content::Other;
    }
    let accel = vector([imu.xacc, imu.yacc, imu.zacc].map(f64::from));
    let gyro = vector([imu.xgyro, imu.ygyro, imu.zgyro].map(f64::from));
    let (Some(accel), Some(gyro)) = (accel, gyro) else { return Content::Malformed };
    Content::Sample(DeviceSample { ticks: imu.time_usec, gyro, accel, ..DeviceSample::default() })
}

/// RAW_IMU and SCALED_IMU*: thousandths of rad/s and of g.
fn scaled(ticks: u64, gyro: [i16; 3], accel: [i16; 3]) -> Content {
    let thousandths = |value: i16| f64::from(value) * 1e-3;
    Content::Sample(DeviceSample {
        ticks,
        gyro: gyro.map(thousandths).into(),
        accel: accel.map(|value| thousandths(value) * G_M_S2).into(),
        ..DeviceSample::default()
    })
}

#[cfg(test)]
mod tests;
