//! Inertial measurements: the sample buffer and preintegration between two times.

pub mod buffer;
pub mod preintegration;

pub use buffer::ImuBuffer;
pub use preintegration::{ImuNoise, Preintegration};
