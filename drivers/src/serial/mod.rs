//! Inertial sensors on a serial line.
//!
//! A [`port`](Port) that comes and goes gives bytes; one [framing layer](framing) makes frames of them, whatever stands
//! between; a protocol says what they mean: [MAVLink](mavlink), [VectorNav](vectornav), [Xsens](xsens) and
//! [our own](plumbline). A [stream](Stream) makes readings of that, on the host's clock. [`SerialImu`] is all of it behind
//! [`ImuSource`](crate::ImuSource).

#[cfg(test)]
mod fixture;
pub mod framing;
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) mod fuzzing;
mod imu;
mod low_latency;
pub mod mavlink;
pub mod plumbline;
mod port;
mod ports;
pub mod protocol;
#[cfg(test)]
pub(crate) mod realtime;
mod stream;
#[cfg(test)]
mod tests;
pub mod vectornav;
pub mod xsens;

pub use imu::SerialImu;
pub use port::{Port, Waited, open_line};
pub use ports::{SerialPortInfo, serial_ports};
pub use stream::Stream;

use plumbline_config::options::{ImuProtocol, MavlinkImu};
use plumbline_protocol::Settings;
use protocol::Protocol;

/// Opens a protocol: `message` and `rate_hz` are for autopilots, `settings` for a microcontroller of our own.
pub(crate) fn opened(
    protocol: ImuProtocol,
    (message, rate_hz): (MavlinkImu, f64),
    settings: Settings,
) -> Box<dyn Protocol> {
    match protocol {
        ImuProtocol::Plumbline => Box::new(plumbline::Plumbline::new(settings)),
        ImuProtocol::Mavlink => Box::new(mavlink::Mavlink::new(message, rate_hz)),
        ImuProtocol::VectorNav => Box::new(vectornav::VectorNav),
        ImuProtocol::Xsens => Box::new(xsens::Xsens),
    }
}
