//! The IMU of an autopilot, by MAVLink 1 or 2.
//!
//! One of HIGHRES_IMU, RAW_IMU and SCALED_IMU* carries the samples ([`messages`]); TIMESYNC, which we ask for, tells the
//! autopilot's time. While fewer samples come than the configuration says, the autopilot is asked for more
//! (MAV_CMD_SET_MESSAGE_INTERVAL) every few seconds.
//!
//! Frames are read by the common layer ([`wire`]) and not by the library that the bridge to the autopilot uses: that one
//! reads from a source that blocks, and generating its messages would be most of the build of this crate.

mod messages;
mod wire;

use super::framing::Scan;
use super::protocol::{Content, Outgoing, Protocol, Questions, TimeAnswer, TimeUnit};
use plumbline_config::options::MavlinkImu;
use wire::{MAX_WRITTEN, MavlinkFrame, MessageKind};

/// Our component ID in the vehicle's system: MAV_COMP_ID_ONBOARD_COMPUTER.
const OUR_COMPONENT: u8 = 191;
/// The rate of the samples is looked at this often, ns.
const RATE_NS: i64 = 5_000_000_000;
/// Less than this share of the configured rate is asked to be more.
const ENOUGH: f64 = 0.9;

/// The IMU of an autopilot.
#[derive(Debug)]
pub struct Mavlink {
    kind: MessageKind,
    rate_hz: f64,
    /// System and component that the samples come from: the first that was heard.
    autopilot: Option<(u8, u8)>,
    questions: Questions,
    sequence: u8,
    samples: u64,
    /// Last check of the rate: its time, and the number of samples then.
    looked: Option<(i64, u64)>,
}

impl Mavlink {
    /// Samples of `message`, which should come `rate_hz` times a second.
    #[must_use]
    pub fn new(message: MavlinkImu, rate_hz: f64) -> Self {
        let kind = match message {
            MavlinkImu::HighresImu => MessageKind::HIGHRES_IMU,
            MavlinkImu::RawImu => MessageKind::RAW_IMU,
            MavlinkImu::ScaledImu => MessageKind::SCALED_IMU,
            MavlinkImu::ScaledImu2 => MessageKind::SCALED_IMU2,
            MavlinkImu::ScaledImu3 => MessageKind::SCALED_IMU3,
        };
        Self {
            kind,
            rate_hz,
            autopilot: None,
            questions: Questions::default(),
            sequence: 0,
            samples: 0,
            looked: None,
        }
    }

    fn answer(&mut self, frame: &MavlinkFrame) -> Content {
        let sync = messages::timesync(&frame.payload);
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

    fn say(&mut self, kind: MessageKind, payload: [u8; wire::MAX_PAYLOAD], into: &mut Outgoing) {
        let system_id = self.autopilot.map_or(1, |(system, _)| system);
        let frame = MavlinkFrame { kind, system_id, component_id: OUR_COMPONENT, payload };
        into.push(wire::write(&frame, self.sequence, &mut [0; MAX_WRITTEN]));
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
        wire::scan(bytes)
    }

    fn decode(&mut self, frame: &[u8]) -> Content {
        let Some(frame) = wire::parse(frame) else { return Content::Malformed };
        let sender = (frame.system_id, frame.component_id);
        if self.autopilot.is_some_and(|autopilot| autopilot != sender) {
            return Content::Other;
        }
        if frame.kind == MessageKind::TIMESYNC {
            return self.answer(&frame);
        }
        if frame.kind != self.kind {
            return Content::Other;
        }
        self.autopilot = Some(sender);
        let content = messages::sample(frame.kind, &frame.payload);
        self.samples += u64::from(matches!(content, Content::Sample(_)));
        content
    }

    fn time_unit(&self) -> TimeUnit {
        match self.kind {
            MessageKind::HIGHRES_IMU | MessageKind::RAW_IMU => TimeUnit { bits: 64, tick_ns: 1_000 },
            _ => TimeUnit { bits: 32, tick_ns: 1_000_000 },
        }
    }

    fn asks_time(&self) -> bool {
        true
    }

    fn request(&mut self, now_ns: i64, into: &mut Outgoing) {
        if self.questions.is_due(now_ns) {
            self.say(MessageKind::TIMESYNC, messages::ask_time(now_ns), into);
        }
        if self.is_slow(now_ns) {
            let (system, component) = self.autopilot.unwrap_or((1, 1));
            let interval_us = (1e6 / self.rate_hz).round() as f32;
            let asked = messages::ask_for_messages(self.kind, interval_us, system, component);
            self.say(MessageKind::COMMAND_LONG, asked, into);
        }
    }

    fn restart(&mut self) {
        self.autopilot = None;
        self.questions = Questions::default();
        self.looked = None;
    }

    #[cfg(any(test, feature = "fuzzing"))]
    fn played(&self, _k: i64, device_ns: i64, gyro: [f32; 3], accel: [f32; 3]) -> Vec<u8> {
        fixture::highres_imu((device_ns / 1000) as u64, gyro, accel)
    }
}

#[cfg(test)]
mod tests;

/// Frames for tests of whole lines.
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) mod fixture {
    use super::*;

    /// HIGHRES_IMU of MAVLink 2.
    pub fn highres_imu(time_us: u64, gyro: [f32; 3], accel: [f32; 3]) -> Vec<u8> {
        let mut payload = [0; wire::MAX_PAYLOAD];
        payload[..8].copy_from_slice(&time_us.to_le_bytes());
        for (k, value) in accel.iter().chain(&gyro).enumerate() {
            payload[8 + 4 * k..12 + 4 * k].copy_from_slice(&value.to_le_bytes());
        }
        payload[60..62].copy_from_slice(&[0x3F, 0]);
        let frame = MavlinkFrame { kind: MessageKind::HIGHRES_IMU, system_id: 1, component_id: 1, payload };
        wire::write(&frame, 0, &mut [0; MAX_WRITTEN]).to_vec()
    }
}
