//! The serial protocol between Plumbline and a microcontroller that reads an IMU and triggers the cameras.
//!
//! Both directions, for both sides: `no_std`, no allocation, no `unsafe`, every length bounded. What stands on the wire is
//! told byte by byte in `docs/serial-protocol.md` of the project; in short, a frame is
//!
//! ```text
//! 00 | COBS( type | payload | CRC-32 ) | 00
//! ```
//!
//! little-endian, with the CRC of zlib (ISO-HDLC) over type and payload. A zero byte stands nowhere else, so that whoever
//! lost the thread finds it at the next one. A payload may grow at its end in versions to come: a receiver takes what it
//! knows and passes over the rest.
//!
//! - [`Message`] and its parts: what can be said;
//! - [`encode`] and [`decode`]: one message to one frame, and back;
//! - [`Receiver`]: bytes as an interrupt delivers them to messages;
//! - [`Timer`]: a timer that begins anew every few seconds to nanoseconds that never do.
//!
//! [`frame_header`] is of another way into a flight: frames of a program on the same computer.
//!
//! # Example: the loop of a firmware
//!
//! ```
//! use plumbline_protocol::{Flags, Imu, MAX_FRAME, Message, Receiver, Time, Timer, encode};
//!
//! # struct Board; impl Board { fn ticks(&self) -> u32 { 170 } fn byte(&mut self) -> Option<u8> { None } fn send(&mut self, _: &[u8]) {}
//! #   fn imu(&mut self) -> Option<(u32, [f32; 3], [f32; 3])> { Some((0, [0.0; 3], [0.0, 0.0, 9.81])) } }
//! # let mut board = Board;
//! let mut timer = Timer::new(170_000_000);
//! let mut receiver = Receiver::new();
//! let mut frame = [0; MAX_FRAME];
//! let mut sequence = 0;
//! # for _ in 0..3 {
//! while let Some(byte) = board.byte() {
//!     if let Some(Ok(Message::AskTime { asked_ns })) = receiver.push(byte) {
//!         let received_ns = timer.nanos(board.ticks());
//!         let sent_ns = timer.nanos(board.ticks());
//!         let answer = Message::Time(Time { asked_ns, received_ns, sent_ns });
//!         board.send(encode(&answer, &mut frame));
//!     }
//! }
//! // The time is that of the data-ready interrupt, not of the transfer that followed it.
//! if let Some((ticks, gyro_rad_s, accel_m_s2)) = board.imu() {
//!     let time_ns = timer.nanos(ticks);
//!     let sample = Imu { sequence, time_ns, gyro_rad_s, accel_m_s2, temperature_c: None, flags: Flags::default() };
//!     board.send(encode(&Message::Imu(sample), &mut frame));
//!     sequence = sequence.wrapping_add(1);
//! }
//! # }
//! ```
#![no_std]

mod frame;
pub mod frame_header;
mod message;
mod receiver;
#[cfg(test)]
mod tests;
mod timer;

pub use frame::{FrameError, MAX_FRAME, decode, encode};
pub use message::{Flags, Hello, Imu, Message, Settings, Time, Trigger, VERSION};
pub use receiver::Receiver;
pub use timer::Timer;
