//! Inertial sensors that the kernel drives (Industrial I/O): sensors on the board's own buses, and those of depth cameras.
//!
//! sysfs says what a device measures, in which units and how its buffer is laid out ([`devices`], [`layout`]), and takes what
//! it is to do ([`setup`]); `/dev/iio:deviceN` gives the samples ([`mod@unit`]). Gyroscope and accelerometer may be one device or
//! two, which then measure at times of their own: the accelerometer is interpolated to the gyroscope's ([`merge`]).
//! [`IioImu`] is all of it behind [`ImuSource`](crate::ImuSource).
//!
//! Stamps are the kernel's, of the monotonic clock, where the driver stamps by that; some hand a device's own stamps on
//! (RealSense), which are then brought to the host's clock as those of a serial line are.
//!
//! Source: `Documentation/ABI/testing/sysfs-bus-iio` of the kernel.

pub mod devices;
mod imu;
pub mod layout;
pub(crate) mod merge;
mod setup;
#[cfg(test)]
mod tests;
mod unit;

pub use devices::{IioDeviceInfo, IioRoots, iio_devices};
pub use imu::IioImu;
