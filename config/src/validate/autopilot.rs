//! Validation of the autopilot's address, and of what its line can carry.

use crate::error::Violation;
use crate::options::{AutopilotConfig, AutopilotEndpoint, SerialLine};

/// An ODOMETRY message on the wire, bytes.
const ODOMETRY_BYTES: f64 = 245.0;
/// All other messages in a second, bytes.
const OTHERS_BYTES_S: f64 = 800.0;
/// Bits on a serial line for one byte: start, eight bits, stop.
const BAUD_PER_BYTE: f64 = 10.0;

pub(super) fn check(autopilot: &AutopilotConfig, found: &mut Vec<Violation>) {
    if autopilot.connect.is_empty() {
        return;
    }
    let mut refuse = |reason: String, cure: &str| {
        found.push(Violation::new("autopilot.connect", reason, cure));
    };
    match AutopilotEndpoint::parse(&autopilot.connect) {
        Err(reason) => refuse(
            reason,
            "write udp://HOST:PORT, udpin://ADDRESS:PORT or serial://DEVICE:BAUD, such as \
             \"udp://127.0.0.1:14540\" or \"serial:///dev/ttyS0:921600\", or \"\" for no autopilot",
        ),
        Ok(AutopilotEndpoint::Serial(SerialLine { baud, .. })) => {
            let needed = (autopilot.rate_hz * ODOMETRY_BYTES + OTHERS_BYTES_S) * BAUD_PER_BYTE;
            if f64::from(baud) < needed {
                let reason = format!(
                    "{baud} baud are too slow for autopilot.rate_hz = {}: {needed:.0} are needed",
                    autopilot.rate_hz
                );
                refuse(reason, "use a faster line, such as 921600");
            }
        }
        Ok(AutopilotEndpoint::Udp(_) | AutopilotEndpoint::UdpIn { .. }) => {}
    }
}
