//! Input of the estimator beside inertial samples: frames and resets.

use plumbline_config::{ImageView, Timestamp};
use plumbline_fields::Record;

/// The images of one instant, lent for the time of the call.
///
/// ```
/// use plumbline_estimator::{FrameInput, ImageView, Timestamp};
///
/// # let (left, right) = (vec![0u8; 752 * 480], vec![0u8; 752 * 480]);
/// let view = |pixels| ImageView::new(752, 480, 752, pixels);
/// let frame = FrameInput::stereo(Timestamp::from_nanos(50_000_000), view(&left)?, view(&right)?);
/// assert!(frame.images.iter().all(Option::is_some));
/// # Ok::<(), plumbline_estimator::ImageError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// Number of the frame where the sensor counts them; `None`: one more than the frame before, from 0.
    pub sequence: Option<u64>,
    /// Measurement time by the camera's clock: the middle of the exposure.
    pub stamp: Timestamp,
    /// Left and right image; `None` for one that did not arrive.
    pub images: [Option<ImageView<'a>>; 2],
}

impl<'a> FrameInput<'a> {
    /// A frame of which images may be missing.
    #[must_use]
    pub fn new(stamp: Timestamp, images: [Option<ImageView<'a>>; 2]) -> Self {
        Self { sequence: None, stamp, images }
    }

    /// Both images of a stereo pair, taken together at `stamp`.
    #[must_use]
    pub fn stereo(stamp: Timestamp, left: ImageView<'a>, right: ImageView<'a>) -> Self {
        Self::new(stamp, [Some(left), Some(right)])
    }

    /// The image of a single camera.
    #[must_use]
    pub fn mono(stamp: Timestamp, image: ImageView<'a>) -> Self {
        Self::new(stamp, [Some(image), None])
    }

    /// Returns the frame with the sequence number of its sensor.
    #[must_use]
    pub fn numbered(self, sequence: u64) -> Self {
        Self { sequence: Some(sequence), ..self }
    }
}

/// Verdict on an inertial sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImuAdmission {
    /// Accepted.
    Accepted,
    /// Accepted: it follows samples that were refused for their stamps, whose clock has proved to run. Time goes on from
    /// here.
    ClockSet,
    /// Refused: not later than the newest sample.
    NotLater,
    /// Refused: so much later than the newest sample that its stamp must be wrong.
    FarAhead,
    /// Refused: a component is not a finite number.
    NotFinite,
    /// Refused: a component is far beyond the sensor's range.
    OutOfRange,
}

impl ImuAdmission {
    /// True if the sample is used.
    #[must_use]
    pub const fn is_accepted(self) -> bool {
        matches!(self, Self::Accepted | Self::ClockSet)
    }
}

/// Extent of a reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Record)]
#[record("ResetOrder.Kind", "an unknown kind of reset")]
pub enum ResetKind {
    /// The map and the window go; the pose stays, with biases and calibration: the new start continues from them.
    #[default]
    Soft,
    /// Discards everything, refined calibration, biases and stamps too: the new start begins at the origin.
    Hard,
}
