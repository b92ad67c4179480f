//! What sensors deliver: inertial samples and 8-bit grey images.

use crate::Timestamp;
use nalgebra::Vector3;

/// One reading of the inertial measurement unit, in the body frame `B` (the IMU's own).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Measurement time.
    pub stamp: Timestamp,
    /// Angular rate of `B`, rad/s, with bias and noise.
    pub gyro: Vector3<f64>,
    /// Specific force in `B`, m/s² (at rest it points up, +9.81), with bias and noise.
    pub accel: Vector3<f64>,
}

impl ImuSample {
    /// Whether every component is a finite number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.gyro.iter().chain(self.accel.iter()).all(|x| x.is_finite())
    }
}

/// An owned 8-bit grey image, rows without padding.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GrayImage {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl GrayImage {
    /// A black image of `width` x `height` pixels.
    #[must_use]
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![0; width * height] }
    }

    /// Takes `pixels` (row-major, `width * height` of them); `None` when their number differs.
    #[must_use]
    pub fn from_pixels(width: usize, height: usize, pixels: Vec<u8>) -> Option<Self> {
        (pixels.len() == width * height).then_some(Self { width, height, pixels })
    }

    /// Width in pixels.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The pixels, row-major.
    #[must_use]
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// The pixels, row-major, to be written in place.
    pub fn pixels_mut(&mut self) -> &mut [u8] {
        &mut self.pixels
    }

    /// A borrowed view of the whole image.
    #[must_use]
    pub fn view(&self) -> ImageView<'_> {
        ImageView { width: self.width, height: self.height, pixels: &self.pixels }
    }
}

/// A borrowed 8-bit grey image, rows without padding: `pixels.len() == width * height`.
#[derive(Clone, Copy, Debug)]
pub struct ImageView<'a> {
    width: usize,
    height: usize,
    pixels: &'a [u8],
}

impl<'a> ImageView<'a> {
    /// Width in pixels.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The pixels, row-major.
    #[must_use]
    pub fn pixels(&self) -> &'a [u8] {
        self.pixels
    }
}
