//! The bridge to the vehicle's autopilot: where it is, and what it is sent.

use super::serial_line::{SerialLine, split_address};
use plumbline_keys::keys;
use std::net::IpAddr;

/// Odometry for PX4 or ArduPilot as MAVLink `ODOMETRY`.
#[keys]
pub struct AutopilotConfig {
    /// Address: "udp://HOST:PORT" if the autopilot listens; "udpin://ADDRESS:PORT" if this computer listens, or
    /// "udpin://ADDRESS:PORT?from=HOST" to accept that address only; "serial://DEVICE:BAUD", such as
    /// "serial:///dev/ttyS0:921600"; empty for none.
    #[key(default)]
    pub connect: String,
    /// Rate of the odometry messages.
    #[key(default = 40.0, range = 30.0..=50.0, unit = HZ, cure = "write it in Hz; PX4 asks for 30 to 50")]
    pub rate_hz: f64,
    /// The vehicle's MAVLink system (MAV_SYS_ID of PX4, SYSID_THISMAV of ArduPilot).
    #[key(default = 1, range = 1..=255, cure = "write the number of the vehicle, as its autopilot has it")]
    pub system_id: u32,
    /// Clock that stamps the odometry: "companion" (the clock of this computer; the autopilot converts the stamps) or
    /// "autopilot" (the clock of the autopilot, by TIMESYNC; until TIMESYNC has locked, odometry is reported as lost).
    #[key(default)]
    pub clock: AutopilotClock,
    /// Messages while the odometry is lost: "last" (the last pose with quality -1 and a large covariance) or "none" (no
    /// message, for an autopilot that ignores quality and covariance).
    #[key(default)]
    pub lost_pose: LostPose,
    /// Optical flow of the left camera, for one that looks down: "off", "always", or "when-lost" (while the odometry is lost or
    /// its quality is below 20, and for 2 s after). With two cameras the distance to the ground goes out all the time unless "off".
    #[key(default)]
    pub flow: FlowMessages,
}

/// Condition on which optical flow is sent.
#[keys("kebab-case")]
pub enum FlowMessages {
    /// Never.
    #[default]
    Off,
    /// With every frame.
    Always,
    /// While the odometry cannot be used, and until it has been usable again for some time.
    WhenLost,
}

/// Clock that stamps the odometry.
#[keys("lowercase")]
pub enum AutopilotClock {
    /// This computer's (since boot); the autopilot converts. PX4 does by its own TIMESYNC, ArduPilot by the
    /// smallest delay it sees.
    #[default]
    Companion,
    /// Clock of the autopilot, by TIMESYNC. Until TIMESYNC has locked, odometry is reported as lost.
    Autopilot,
}

/// Messages while the odometry is lost.
#[keys("lowercase")]
pub enum LostPose {
    /// The last pose with quality -1 and a large covariance.
    #[default]
    Last,
    /// No message, for an autopilot that heeds neither quality nor covariance. Configurations of before 2026 call it `nan`.
    #[serde(alias = "nan")]
    None,
}

/// Address of an autopilot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AutopilotEndpoint {
    /// It listens at this host and port: `udp://HOST:PORT` (or `udpout:`).
    Udp(String),
    /// It sends to an address and port of ours, and is answered there: `udpin://ADDRESS:PORT`, or
    /// `udpin://ADDRESS:PORT?from=HOST`.
    UdpIn {
        /// Address and port of this computer.
        at: String,
        /// Address of the only host that is listened to.
        from: Option<IpAddr>,
    },
    /// It is at the other end of a serial line: `serial://DEVICE:BAUD`.
    Serial(SerialLine),
}

impl AutopilotEndpoint {
    /// Reads `udp://HOST:PORT`, `udpin://ADDRESS:PORT`, `udpin://ADDRESS:PORT?from=HOST` or `serial://DEVICE:BAUD`.
    ///
    /// # Errors
    /// Fault of the text, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (kind, rest) = split_address(text, "udp://, udpin:// or serial://")?;
        match kind.as_str() {
            "udp" | "udpout" => host_and_port(&rest).map(|()| Self::Udp(rest)),
            "udpin" => udp_in(&rest),
            "serial" => SerialLine::parse(&rest).map(Self::Serial),
            _ => Err(format!("{kind:?} is none of udp, udpin and serial")),
        }
    }
}

fn udp_in(text: &str) -> Result<AutopilotEndpoint, String> {
    let (at, from) = text.split_once("?from=").map_or((text, None), |(at, from)| (at, Some(from)));
    host_and_port(at)?;
    let not_an_address = |from: &str| format!("{from:?} behind ?from= is no address such as 192.168.1.10");
    let from = from.map(|from| from.parse().map_err(|_| not_an_address(from))).transpose()?;
    Ok(AutopilotEndpoint::UdpIn { at: at.to_owned(), from })
}

/// Accepts `HOST:PORT`; the error says what is wrong with another text.
fn host_and_port(text: &str) -> Result<(), String> {
    let Some((_, port)) = text.rsplit_once(':').filter(|(host, _)| !host.is_empty()) else {
        return Err(format!("{text:?} lacks its host, or the port after the last colon"));
    };
    match port.parse::<u16>() {
        Ok(port) if port > 0 => Ok(()),
        _ => Err(format!("{port:?} is not a port")),
    }
}
