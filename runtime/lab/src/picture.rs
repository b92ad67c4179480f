//! A colour picture to draw on: smooth lines and dots, written as PNG.
//!
//! Coordinates are those of the estimator: pixel centres are at whole numbers. What lies outside is left
//! out, so that nothing that is drawn can panic.

use nalgebra::Vector2;
use plumbline_config::ImageView;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError};
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Red, green and blue.
pub type Rgb = [u8; 3];

/// Why a picture is not on disk.
#[derive(Debug, Error)]
pub enum PictureError {
    /// The file cannot be created or written.
    #[error("{}: {source}; choose another place to write to", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// PNG cannot hold the picture.
    #[error("{}: {message}; draw a smaller picture", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Words of the encoder.
        message: String,
    },
}

impl PictureError {
    fn of(path: &Path, error: EncodingError) -> Self {
        match error {
            EncodingError::IoError(source) => Self::Io { path: path.into(), source },
            other => Self::Format { path: path.into(), message: other.to_string() },
        }
    }
}

/// An RGB picture of 8 bits a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RgbImage {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl RgbImage {
    /// A picture of one colour.
    #[must_use]
    pub fn new(width: usize, height: usize, colour: Rgb) -> Self {
        Self { width, height, pixels: colour.repeat(width * height) }
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

    /// The colour of a pixel; `None` outside.
    #[must_use]
    pub fn pixel(&self, x: usize, y: usize) -> Option<Rgb> {
        self.at(x, y).map(|at| [self.pixels[at], self.pixels[at + 1], self.pixels[at + 2]])
    }

    fn at(&self, x: usize, y: usize) -> Option<usize> {
        (x < self.width && y < self.height).then(|| 3 * (y * self.width + x))
    }

    /// Lays `colour` over a pixel, as opaque as `share` of 0 to 1 says.
    pub fn blend(&mut self, x: usize, y: usize, colour: Rgb, share: f32) {
        let Some(at) = self.at(x, y) else { return };
        for (old, new) in self.pixels[at..at + 3].iter_mut().zip(colour) {
            // A float to u8 saturates.
            *old = (f32::from(*old) + share * (f32::from(new) - f32::from(*old))).round() as u8;
        }
    }

    /// Copies a grey image, with its upper left pixel at `left`, `top`, and its light times `brightness`.
    pub fn gray(&mut self, image: &ImageView<'_>, left: usize, top: usize, brightness: f32) {
        for (y, row) in image.rows().enumerate() {
            for (x, &grey) in row.iter().enumerate() {
                let Some(at) = self.at(left + x, top + y) else { break };
                self.pixels[at..at + 3].fill((f32::from(grey) * brightness) as u8);
            }
        }
    }

    /// Copies another picture, with its upper left pixel at `left`, `top`.
    pub fn paste(&mut self, other: &Self, left: usize, top: usize) {
        let width = 3 * other.width.min(self.width.saturating_sub(left));
        for (y, row) in other.pixels.chunks_exact(3 * other.width.max(1)).enumerate() {
            let Some(at) = self.at(left, top + y) else { break };
            self.pixels[at..at + width].copy_from_slice(&row[..width]);
        }
    }

    /// Fills a rectangle.
    pub fn fill(&mut self, left: usize, top: usize, width: usize, height: usize, colour: Rgb) {
        for y in top..top.saturating_add(height).min(self.height) {
            for x in left..left.saturating_add(width).min(self.width) {
                self.blend(x, y, colour, 1.0);
            }
        }
    }

    /// Draws a smooth line with round ends. One that has no finite place is left out.
    pub fn line(&mut self, from: Vector2<f32>, to: Vector2<f32>, thickness: f32, colour: Rgb) {
        let way = to - from;
        if !way.iter().chain(from.iter()).all(|v| v.is_finite()) {
            return;
        }
        let (length_squared, reach) = (way.norm_squared(), 0.5 * thickness + 0.5);
        // Rows of a steep line, columns of a flat one: few pixels beside the line are looked at.
        let is_flat = way.x.abs() >= way.y.abs();
        let (along, across) = if is_flat { (0, 1) } else { (1, 0) };
        let sizes = [self.width, self.height];
        let slope = if way[along] == 0.0 { 0.0 } else { way[across] / way[along] };
        let ends = (from[along].min(to[along]), from[along].max(to[along]));
        for u in span(ends.0 - reach, ends.1 + reach, sizes[along]) {
            let centre = from[across] + slope * ((u as f32).clamp(ends.0, ends.1) - from[along]);
            // Across a diagonal line the reach is longer by the root of two.
            let wide = 1.5 * reach;
            for v in span(centre - wide, centre + wide, sizes[across]) {
                let (x, y) = if is_flat { (u, v) } else { (v, u) };
                let place = Vector2::new(x as f32, y as f32) - from;
                let t = (place.dot(&way) / length_squared.max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
                let share = (reach - (place - way * t).norm()).clamp(0.0, 1.0);
                self.blend(x, y, colour, share);
            }
        }
    }

    /// Draws a smooth disc.
    pub fn disc(&mut self, centre: Vector2<f32>, radius: f32, colour: Rgb) {
        self.line(centre, centre, 2.0 * radius, colour);
    }

    /// Writes the picture as a PNG file.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_png(&self, path: &Path) -> Result<(), PictureError> {
        let io = |source| PictureError::Io { path: path.into(), source };
        let mut file = BufWriter::new(File::create(path).map_err(io)?);
        self.encode(&mut file).map_err(|e| PictureError::of(path, e))?;
        file.flush().map_err(io)
    }

    fn encode(&self, file: impl std::io::Write) -> Result<(), EncodingError> {
        let mut encoder = Encoder::new(file, self.width as u32, self.height as u32);
        encoder.set_color(ColorType::Rgb);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_compression(Compression::Fast);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.pixels)?;
        writer.finish()
    }
}

/// The whole numbers of `from` to `to` that are below `size`.
fn span(from: f32, to: f32, size: usize) -> std::ops::Range<usize> {
    // A float to usize saturates, and what is below 0 is 0.
    if to < 0.0 { 0..0 } else { from.ceil() as usize..((to.floor() as usize).saturating_add(1)).min(size) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::GrayImage;
    use proptest::prelude::*;

    const WHITE: Rgb = [255; 3];

    fn black() -> RgbImage {
        RgbImage::new(24, 16, [0; 3])
    }

    fn light(picture: &RgbImage, x: usize, y: usize) -> u8 {
        picture.pixel(x, y).unwrap()[1]
    }

    #[test]
    fn a_line_covers_its_pixels_and_no_others() {
        for turned in [false, true] {
            let mut picture = RgbImage::new(16, 16, [0; 3]);
            let place = |a: f32, b: f32| if turned { Vector2::new(b, a) } else { Vector2::new(a, b) };
            picture.line(place(3.0, 5.0), place(12.0, 5.0), 1.0, WHITE);
            for (u, v) in (0..16).flat_map(|u| (0..16).map(move |v| (u, v))) {
                let expected = if (3..=12).contains(&u) && v == 5 { 255 } else { 0 };
                let (x, y) = if turned { (v, u) } else { (u, v) };
                assert_eq!(light(&picture, x, y), expected, "({x} {y})");
            }
        }
    }

    #[test]
    fn the_light_of_a_line_is_its_length_times_its_thickness() {
        for (x, y) in [(60.0, 10.0), (60.3, 44.7), (12.4, 57.1), (50.0, 58.0)] {
            let mut picture = RgbImage::new(64, 64, [0; 3]);
            let (from, to) = (Vector2::new(8.2, 9.1), Vector2::new(x, y));
            picture.line(from, to, 3.0, WHITE);
            let light: f32 = picture.pixels.iter().map(|&p| f32::from(p) / 765.0).sum();
            let round_ends = std::f32::consts::PI * 1.5 * 1.5;
            let expected = 3.0 * (to - from).norm() + round_ends;
            assert!((light / expected - 1.0).abs() < 0.02, "{light} against {expected}");
        }
    }

    #[test]
    fn a_line_between_two_rows_lights_both_by_half() {
        let mut picture = black();
        picture.line(Vector2::new(2.0, 6.5), Vector2::new(20.0, 6.5), 1.0, WHITE);
        assert_eq!([5, 6, 7, 8].map(|y| light(&picture, 10, y)), [0, 128, 128, 0]);
    }

    #[test]
    fn a_disc_is_round() {
        let mut picture = black();
        picture.disc(Vector2::new(10.0, 8.0), 3.0, WHITE);
        assert_eq!([8, 10, 12].map(|x| light(&picture, x, 8)), [255; 3]);
        assert_eq!((light(&picture, 13, 11), light(&picture, 7, 5), light(&picture, 15, 8)), (0, 0, 0));
    }

    #[test]
    fn gray_and_pictures_are_cut_at_the_rim() {
        let image = GrayImage::from_pixels(4, 2, vec![200; 8]).unwrap();
        let mut picture = black();
        picture.gray(&image.view(), 22, 15, 0.5);
        assert_eq!((light(&picture, 21, 15), light(&picture, 22, 15), light(&picture, 23, 14)), (0, 100, 0));
        picture.paste(&RgbImage::new(5, 5, [9; 3]), 21, 13);
        picture.paste(&RgbImage::new(5, 5, [9; 3]), 100, 100);
        assert_eq!((light(&picture, 21, 13), light(&picture, 23, 15)), (9, 9));
    }

    #[test]
    fn what_is_written_can_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.png");
        let mut picture = RgbImage::new(3, 2, [10, 20, 30]);
        picture.fill(1, 1, 9, 9, WHITE);
        picture.write_png(&path).unwrap();
        let mut reader =
            png::Decoder::new(std::io::BufReader::new(File::open(&path).unwrap())).read_info().unwrap();
        let mut pixels = vec![0; 18];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, picture.pixels);
        let error = picture.write_png(&folder.path().join("no/out.png")).unwrap_err();
        assert!(error.to_string().contains("out.png"), "{error}");
    }

    proptest! {
        #[test]
        fn nothing_panics_or_takes_long_wherever_it_is(
            a in any::<[f32; 2]>(),
            b in any::<[f32; 2]>(),
            near in prop::array::uniform4(-40.0_f32..60.0),
            thickness in 0.0_f32..9.0,
        ) {
            let mut picture = black();
            let (near_from, near_to) = (Vector2::new(near[0], near[1]), Vector2::new(near[2], near[3]));
            picture.line(a.into(), b.into(), thickness, WHITE);
            picture.line(near_from, near_to, thickness, WHITE);
            picture.line(near_from, b.into(), thickness, WHITE);
            picture.disc(near_to, thickness, WHITE);
        }
    }
}
