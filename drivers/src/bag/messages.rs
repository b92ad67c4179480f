//! The ROS messages that hold images and inertial samples: `sensor_msgs` of ROS 2, as of Humble to Kilted, and of ROS 1.

use super::wire::{Encoding, Wire};
use plumbline_config::{ImuSample, Timestamp};

/// Kinds of messages that a flight can use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    /// `sensor_msgs/msg/Image`.
    Image,
    /// `sensor_msgs/msg/CompressedImage`.
    Compressed,
    /// `sensor_msgs/msg/Imu`.
    Imu,
}

impl Kind {
    /// By the name of the type, in ROS 2 or ROS 1.
    fn of(type_name: &str) -> Option<Self> {
        match type_name {
            "sensor_msgs/msg/Image" | "sensor_msgs/Image" => Some(Self::Image),
            "sensor_msgs/msg/CompressedImage" | "sensor_msgs/CompressedImage" => Some(Self::Compressed),
            "sensor_msgs/msg/Imu" | "sensor_msgs/Imu" => Some(Self::Imu),
            _ => None,
        }
    }
}

/// Kind and encoding of the messages of a topic that can be flown with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Format {
    /// Kind of the messages.
    pub(crate) kind: Kind,
    /// Encoding of the messages.
    pub(crate) encoding: Encoding,
}

impl Format {
    /// Format of messages of that type and encoding; `None` for those that cannot be flown with.
    pub(crate) fn of(type_name: &str, encoding: &str) -> Option<Self> {
        Some(Self { kind: Kind::of(type_name)?, encoding: Encoding::named(encoding)? })
    }
}

/// An image as it stands in a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ImageMessage<'a> {
    /// Rows of pixels.
    Raw {
        /// Width, px.
        width: usize,
        /// Height, px.
        height: usize,
        /// Pixel encoding, such as mono8 or bgr8.
        encoding: &'a str,
        /// True if pixels of two bytes are big-endian.
        is_big: bool,
        /// Bytes from row to row.
        step: usize,
        /// The rows.
        data: &'a [u8],
    },
    /// A PNG or JPEG file.
    File(&'a [u8]),
}

/// Stamp of the header that every one of these messages begins with.
pub(crate) fn stamp(encoding: Encoding, bytes: &[u8]) -> Option<Timestamp> {
    Wire::new(encoding, bytes)?.header().map(Timestamp::from_nanos)
}

/// The field of the nanoseconds in the header.
pub(crate) fn nanoseconds(encoding: Encoding, bytes: &[u8]) -> Option<i64> {
    Wire::new(encoding, bytes)?.header_time().map(|(_, nanos)| nanos)
}

/// An inertial message: what it says of a quantity that it does not hold is no sample of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ImuMessage {
    /// Numbers of the sample, possible or not.
    pub(crate) sample: ImuSample,
    /// True where the covariance (-1) denies the rates of rotation, and the accelerations.
    pub(crate) is_denied: [bool; 2],
}

/// The inertial message in `bytes`; the orientation is passed over.
pub(crate) fn imu(encoding: Encoding, bytes: &[u8]) -> Option<ImuMessage> {
    let mut wire = Wire::new(encoding, bytes)?;
    let stamp = Timestamp::from_nanos(wire.header()?);
    // A quaternion and a covariance of nine.
    for _ in 0..4 + 9 {
        wire.f64()?;
    }
    let gyro = wire.vector()?;
    let gyro_variance = wire.f64()?;
    for _ in 1..9 {
        wire.f64()?;
    }
    let accel = wire.vector()?;
    // The last fields; a message that ends before them has been read by others as well.
    let accel_variance = wire.f64().unwrap_or(0.0);
    let is_denied = [gyro_variance == -1.0, accel_variance == -1.0];
    Some(ImuMessage { sample: ImuSample { stamp, gyro, accel }, is_denied })
}

/// The image in `bytes`.
pub(crate) fn image(format: Format, bytes: &[u8]) -> Option<ImageMessage<'_>> {
    let mut wire = Wire::new(format.encoding, bytes)?;
    wire.header()?;
    match format.kind {
        Kind::Imu => None,
        Kind::Compressed => {
            // The format is in the file as well.
            let _format = wire.sequence()?;
            wire.sequence().map(ImageMessage::File)
        }
        Kind::Image => {
            let (height, width) = (wire.u32()? as usize, wire.u32()? as usize);
            let encoding = wire.text()?;
            let is_big = wire.u8()? != 0;
            let step = wire.u32()? as usize;
            Some(ImageMessage::Raw { width, height, encoding, is_big, step, data: wire.sequence()? })
        }
    }
}
