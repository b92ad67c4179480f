//! The bridge to the vehicle's autopilot: where it is, and what it is sent.

use serde::{Deserialize, Serialize};

/// Odometry for PX4 or ArduPilot as MAVLink `ODOMETRY`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AutopilotConfig {
    /// Where the autopilot is, as [`AutopilotEndpoint::parse`] reads it; empty for none.
    pub connect: String,
    /// Odometry messages a second, whatever the estimator does.
    pub rate_hz: f64,
    /// The vehicle's MAVLink system, which the bridge is a component of.
    pub system_id: u32,
    /// Whose clock stamps the odometry.
    pub clock: AutopilotClock,
    /// What stands for the pose while there is none.
    pub lost_pose: LostPose,
}

/// Whose clock stamps the odometry.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AutopilotClock {
    /// This computer's (since boot); the autopilot converts. PX4 does by its own TIMESYNC, ArduPilot by the
    /// smallest delay it sees.
    #[default]
    Companion,
    /// The autopilot's, by our TIMESYNC; until that has locked, odometry says that it is lost.
    Autopilot,
}

/// What stands for the pose while there is none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LostPose {
    /// No number at all: nothing that an autopilot could fuse, whatever it heeds.
    #[default]
    Nan,
    /// The last that was known, for an autopilot that heeds the quality.
    Last,
}

impl Default for AutopilotConfig {
    fn default() -> Self {
        Self {
            connect: String::new(),
            rate_hz: 40.0,
            system_id: 1,
            clock: AutopilotClock::default(),
            lost_pose: LostPose::default(),
        }
    }
}

/// Where an autopilot is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AutopilotEndpoint {
    /// It listens at this host and port: `udp://HOST:PORT` (or `udpout:`).
    Udp(String),
    /// It sends to this address and port of ours, and is answered there: `udpin://ADDRESS:PORT`.
    UdpIn(String),
    /// It is at the other end of this device, at this many baud: `serial://DEVICE:BAUD`.
    Serial {
        /// Path of the device.
        device: String,
        /// Symbols a second; ten carry a byte.
        baud: u32,
    },
}

/// Slowest and fastest serial lines that are accepted, baud.
const BAUD: std::ops::RangeInclusive<u32> = 9_600..=12_000_000;
/// The longest text that is looked at, bytes.
const MAX_BYTES: usize = 256;

impl AutopilotEndpoint {
    /// Reads `udp://HOST:PORT`, `udpin://ADDRESS:PORT` or `serial://DEVICE:BAUD`.
    ///
    /// # Errors
    /// What is wrong with the text, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        if text.len() > MAX_BYTES || !text.chars().all(|c| c.is_ascii_graphic()) {
            return Err(format!("is longer than {MAX_BYTES} bytes, or holds spaces or special characters"));
        }
        let Some((kind, rest)) = text.split_once("://") else {
            return Err(format!("{text:?} does not begin with udp://, udpin:// or serial://"));
        };
        let Some((place, number)) = rest.rsplit_once(':').filter(|(place, _)| !place.is_empty()) else {
            return Err(format!("{text:?} lacks its host or device, or the number after the last colon"));
        };
        match kind {
            "udp" | "udpout" | "udpin" => {
                number
                    .parse::<u16>()
                    .ok()
                    .filter(|port| *port > 0)
                    .ok_or_else(|| format!("{number:?} is no port"))?;
                let address = rest.to_owned();
                Ok(if kind == "udpin" { Self::UdpIn(address) } else { Self::Udp(address) })
            }
            "serial" => {
                let baud = number.parse().ok().filter(|baud| BAUD.contains(baud)).ok_or_else(|| {
                    format!("{number:?} is no speed from {} to {} baud", BAUD.start(), BAUD.end())
                })?;
                if !place.starts_with('/') {
                    return Err(format!("{place:?} is no absolute path of a device"));
                }
                Ok(Self::Serial { device: place.to_owned(), baud })
            }
            _ => Err(format!("{kind:?} is none of udp, udpin and serial")),
        }
    }
}
