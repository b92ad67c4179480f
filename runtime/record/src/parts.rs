//! Messages of a log about images and about itself.

use crate::said::{Dropped, EntryKind};
use plumbline_config::Timestamp;
use plumbline_fields::{Enumeration, Field, FieldContent, Record, Shape, Value};

/// The count of dropped entries of a kind.
macro_rules! dropped {
    ($tag:literal, $kind:ident, $wire:literal, $about:literal) => {
        Field::<Self>::new(
            ($tag, "dropped", $wire, $about),
            Shape::Uint64,
            |o| Value::Whole(o.dropped.of(EntryKind::$kind) as i64),
            |o, value| {
                o.dropped.0[EntryKind::$kind as usize] = value.whole() as u64;
                Ok(())
            },
        )
    };
}

/// Image of a frame, by its size and the hash of its pixels.
#[derive(Clone, Debug, Default, PartialEq, Eq, Record)]
#[record("Image")]
pub struct ImageAbout {
    /// Width, px.
    #[field(1)]
    pub width_px: u32,
    /// Height, px.
    #[field(2)]
    pub height_px: u32,
    /// SHA-256 of the pixels, row by row.
    #[field(3)]
    pub sha256: Vec<u8>,
}

/// Stereo frame without its pixels. Its images, where they are kept, come before it on /input/left and /input/right.
#[derive(Clone, Debug, Default, PartialEq, Eq, Record)]
#[record("Frame")]
pub struct FrameAbout {
    /// Counts frames of the sensor.
    #[field(1)]
    pub sequence: u64,
    /// Measurement time by the camera's clock.
    #[field(2, wire = "stamp_ns")]
    pub stamp: Timestamp,
    /// Left image; absent when it did not arrive.
    #[field(3)]
    pub left: Option<ImageAbout>,
    /// Right image; absent when it did not arrive.
    #[field(4)]
    pub right: Option<ImageAbout>,
}

/// State of a recording, once in every chunk.
#[derive(Clone, Debug, Default, PartialEq, Eq, Record)]
#[record(
    "Recording",
    dropped!(3, Imu, "imu_dropped", "Entries that found the recorder's queue full since the start of the flight. What a re-execution needs:"),
    dropped!(4, Frame, "frames_dropped", ""),
    dropped!(5, Order, "orders_dropped", ""),
    dropped!(6, Estimate, "estimates_dropped", "And what it makes again:"),
    dropped!(7, Odometry, "odometry_dropped", ""),
    dropped!(8, Event, "events_dropped", ""),
    dropped!(9, MapEstimate, "map_estimates_dropped", ""),
    dropped!(10, Instant, "instants_dropped", "")
)]
pub struct RecordingState {
    /// End of the recording.
    #[field(1)]
    pub end: End,
    /// Running SHA-256 over the inputs and orders of this file up to here.
    #[field(2)]
    pub seal: Vec<u8>,
    /// Entries that found the recorder's queue full since the start of the flight.
    #[field(none)]
    pub dropped: Dropped,
}

/// End of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum End {
    /// It goes on.
    #[default]
    NotYet,
    /// The flight ended.
    OfFlight,
    /// The files reached their limit; the flight went on.
    OfRoom,
}

/// An end that this build does not know is none: the log goes on, or breaks off.
impl FieldContent for End {
    const SHAPE: Shape = {
        static ABOUT: Enumeration = Enumeration {
            name: "Recording.End",
            first: 0,
            names: &["END_NOT_YET", "END_OF_FLIGHT", "END_OF_ROOM"],
            about: &[
                "It goes on.",
                "The flight ended.",
                "The files reached their limit; the flight went on.",
            ],
        };
        Shape::Enumerator(&ABOUT)
    };

    fn get(&self) -> Value<'_> {
        Value::Whole(*self as i64)
    }

    fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
        *self = match value.whole() {
            1 => Self::OfFlight,
            2 => Self::OfRoom,
            _ => Self::NotYet,
        };
        Ok(())
    }
}
