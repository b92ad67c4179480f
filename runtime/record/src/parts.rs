//! Messages of a log about images and about itself.

use crate::fields::{Enumeration, Part, Parts, Record as _, Shape, Value};
use crate::said::Dropped;
use plumbline_config::Timestamp;

/// Image of a frame, by its size and the hash of its pixels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ImageAbout {
    /// Width, px.
    pub width_px: u32,
    /// Height, px.
    pub height_px: u32,
    /// SHA-256 of the pixels, row by row.
    pub sha256: Vec<u8>,
}

/// Stereo frame without its pixels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FrameAbout {
    /// Counts frames of the sensor.
    pub sequence: u64,
    /// Measurement time by the camera's clock.
    pub stamp: Timestamp,
    /// Left image; `None` when it did not arrive.
    pub left: Option<ImageAbout>,
    /// Right image; `None` when it did not arrive.
    pub right: Option<ImageAbout>,
}

/// State of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recording {
    /// End of the recording.
    pub end: End,
    /// Running SHA-256 over the inputs and orders of the file.
    pub seal: Vec<u8>,
    /// Entries that found the recorder's queue full since the start of the flight.
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
impl Part for End {
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

impl Part for Option<ImageAbout> {
    const SHAPE: Shape = Shape::Message(ImageAbout::NAME);

    fn get(&self) -> Value<'_> {
        self.as_ref().map_or(Value::Missing, |image| Value::Part(image))
    }

    fn set(&mut self, value: Value<'_>) -> Result<(), &'static str> {
        *self = match value {
            Value::Missing => None,
            value => {
                let mut image = ImageAbout::blank();
                image.set(value)?;
                Some(image)
            }
        };
        Ok(())
    }

    fn open(&mut self) -> Option<&mut dyn Parts> {
        self.as_mut().map(|image| image as &mut dyn Parts)
    }
}
