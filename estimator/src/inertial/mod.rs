//! Inertial measurements: the sample buffer and preintegration between two times, and
//! how far readings are to be believed.

pub mod belief;
pub mod buffer;
pub mod preintegration;
pub mod stuck;
pub mod vibration;

pub use belief::{BelievedSample, SensorLimits};
pub use buffer::ImuBuffer;
pub use preintegration::{ImuNoise, Preintegration};
pub use stuck::{Sensors, StuckWatch, Unmeasured};
pub use vibration::Vibration;
