//! The messages of ROS 2 that hold images and inertial samples (`sensor_msgs`, as of Humble to Kilted).

use super::cdr::Cdr;
use plumbline_config::{ImuSample, Timestamp};

/// Nanoseconds of a second.
const SECOND_NS: i64 = 1_000_000_000;

/// What a topic carries that can be flown with.
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
    /// By the name of the type.
    pub(crate) fn of(type_name: &str) -> Option<Self> {
        match type_name {
            "sensor_msgs/msg/Image" => Some(Self::Image),
            "sensor_msgs/msg/CompressedImage" => Some(Self::Compressed),
            "sensor_msgs/msg/Imu" => Some(Self::Imu),
            _ => None,
        }
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
        /// What a pixel is, such as mono8 or bgr8.
        encoding: &'a str,
        /// Whether of two bytes the higher comes first.
        is_big: bool,
        /// Bytes from row to row.
        step: usize,
        /// The rows.
        data: &'a [u8],
    },
    /// A PNG or JPEG file.
    File(&'a [u8]),
}

/// The stamp of the header that every one of these messages begins with.
pub(crate) fn stamp(bytes: &[u8]) -> Option<Timestamp> {
    header(&mut Cdr::new(bytes)?)
}

/// Stamp and name of the frame; the first is what is wanted.
fn header(cdr: &mut Cdr<'_>) -> Option<Timestamp> {
    let (seconds, nanos) = (i64::from(cdr.i32()?), i64::from(cdr.u32()?));
    let _frame = cdr.sequence()?;
    (nanos < SECOND_NS).then(|| Timestamp::from_nanos(seconds * SECOND_NS + nanos))
}

/// The inertial sample in `bytes`; orientation and covariances are passed over.
pub(crate) fn imu(bytes: &[u8]) -> Option<ImuSample> {
    let mut cdr = Cdr::new(bytes)?;
    let stamp = header(&mut cdr)?;
    // A quaternion and a covariance of nine.
    for _ in 0..4 + 9 {
        cdr.f64()?;
    }
    let gyro = cdr.vector()?;
    for _ in 0..9 {
        cdr.f64()?;
    }
    Some(ImuSample { stamp, gyro, accel: cdr.vector()? })
}

/// The image in `bytes`.
pub(crate) fn image(kind: Kind, bytes: &[u8]) -> Option<ImageMessage<'_>> {
    let mut cdr = Cdr::new(bytes)?;
    header(&mut cdr)?;
    match kind {
        Kind::Imu => None,
        Kind::Compressed => {
            // The format is in the file as well.
            let _format = cdr.sequence()?;
            cdr.sequence().map(ImageMessage::File)
        }
        Kind::Image => {
            let (height, width) = (cdr.u32()? as usize, cdr.u32()? as usize);
            let encoding = cdr.text()?;
            let is_big = cdr.u8()? != 0;
            let step = cdr.u32()? as usize;
            Some(ImageMessage::Raw { width, height, encoding, is_big, step, data: cdr.sequence()? })
        }
    }
}
