//! Camera pictures with what is tracked drawn into them: points, which turn from red to green within a second, and lines.

use super::interface::Bytes;
use super::messages::{CompressedImage, Header, Image};
use crate::net::picture::{place, reduced};
use jpeg_encoder::{ColorType, Encoder, EncodingError};
use plumbline_record::local::picture::Shot;

/// Red, green and blue.
type Rgb = [u8; 3];

const LINE: Rgb = [40, 180, 245];
/// Half the side of a drawn point, px.
const POINT_PX: i32 = 1;
/// Frames after which a point counts as old.
const OLD_FRAMES: f32 = 20.0;
/// Largest distance from the picture at which the end of a line is drawn towards, px.
const FAR_PX: f32 = 4_096.0;

/// Colour picture, by rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drawing {
    width: usize,
    height: usize,
    rgb: Vec<u8>,
}

impl Drawing {
    /// Left image of `shot` with its tracks, at most `max_width_px` wide. `None` without an image.
    #[must_use]
    pub fn new(shot: &Shot, max_width_px: usize) -> Option<Self> {
        let factor = shot.image.width().div_ceil(max_width_px.max(1)).max(1);
        let (width, height) = (shot.image.width() / factor, shot.image.height() / factor);
        if !shot.has_image || width == 0 || height == 0 {
            return None;
        }
        let rgb = reduced(&shot.image, factor).into_iter().flat_map(|grey| [grey; 3]).collect();
        let mut drawing = Self { width, height, rgb };
        let scaled = |x: f32| place(x, factor);
        for line in &shot.lines {
            drawing.line(line.map(scaled));
        }
        for [x, y, age] in &shot.points {
            drawing.point([scaled(*x), scaled(*y)], *age);
        }
        Some(drawing)
    }

    /// Colours a pixel; one outside is ignored.
    fn dot(&mut self, x: i32, y: i32, colour: Rgb) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x < self.width && y < self.height {
            let at = 3 * (y * self.width + x);
            self.rgb[at..at + 3].copy_from_slice(&colour);
        }
    }

    fn point(&mut self, [x, y]: [f32; 2], age: f32) {
        if !(x.abs() < FAR_PX && y.abs() < FAR_PX) {
            return;
        }
        let share = (age / OLD_FRAMES).clamp(0.0, 1.0);
        let colour = [(255.0 * (1.0 - share)) as u8, (255.0 * share) as u8, 60];
        let (x, y) = (x.round() as i32, y.round() as i32);
        for dy in -POINT_PX..=POINT_PX {
            for dx in -POINT_PX..=POINT_PX {
                self.dot(x + dx, y + dy, colour);
            }
        }
    }

    /// Draws a line, a pixel a step along its longer side.
    fn line(&mut self, [x0, y0, x1, y1]: [f32; 4]) {
        if ![x0, y0, x1, y1].iter().all(|number| number.abs() < FAR_PX) {
            return;
        }
        let (dx, dy) = (x1 - x0, y1 - y0);
        let steps = dx.abs().max(dy.abs()).ceil().max(1.0);
        for k in 0..=steps as i32 {
            let share = k as f32 / steps;
            self.dot((x0 + share * dx).round() as i32, (y0 + share * dy).round() as i32, LINE);
        }
    }

    /// Message of the picture as it is.
    #[must_use]
    pub fn raw<'a>(self, header: Header<'a>) -> Image<'a> {
        let side = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
        Image {
            header,
            height: side(self.height),
            width: side(self.width),
            encoding: "rgb8",
            is_bigendian: 0,
            step: side(3 * self.width),
            data: Bytes(self.rgb),
        }
    }

    /// Message of the picture as JPEG of `quality` (1 to 100).
    ///
    /// # Errors
    /// When JPEG cannot hold a picture of this size.
    pub fn compressed<'a>(
        &self,
        header: Header<'a>,
        quality: u8,
    ) -> Result<CompressedImage<'a>, EncodingError> {
        let side = |length: usize| u16::try_from(length).unwrap_or(u16::MAX);
        let mut jpeg = Vec::new();
        let encoder = Encoder::new(&mut jpeg, quality.clamp(1, 100));
        encoder.encode(&self.rgb, side(self.width), side(self.height), ColorType::Rgb)?;
        Ok(CompressedImage { header, format: "rgb8; jpeg compressed bgr8", data: Bytes(jpeg) })
    }
}

#[cfg(test)]
mod tests {
    use super::super::messages::Time;
    use super::*;
    use crate::net::picture::jpeg_size;
    use plumbline_config::{GrayImage, Timestamp};

    fn shot() -> Shot {
        Shot {
            frame: 1,
            stamp: Timestamp::default(),
            image: GrayImage::from_pixels(8, 6, vec![100; 48]).unwrap(),
            has_image: true,
            points: vec![[4.0, 4.0, 100.0]],
            lines: vec![[0.0, 0.0, 7.0, 0.0]],
        }
    }

    fn header() -> Header<'static> {
        Header { stamp: Time::from_nanos(0), frame_id: "camera" }
    }

    #[test]
    fn tracks_are_drawn_where_they_were_seen() {
        let image = Drawing::new(&shot(), 8).unwrap().raw(header());
        assert_eq!((image.width, image.height, image.step), (8, 6, 24));
        let pixel = |x: usize, y: usize| &image.data.0[3 * (8 * y + x)..][..3];
        assert!((0..8).all(|x| pixel(x, 0) == LINE));
        assert_eq!(pixel(4, 4), [0, 255, 60]);
        assert_eq!(pixel(1, 3), [100, 100, 100]);
    }

    #[test]
    fn nothing_outside_the_picture_is_drawn() {
        let lines = vec![[-50.0, 3.0, 60.0, 3.0], [f32::NAN, 0.0, 1.0, 1.0], [0.0, 0.0, f32::INFINITY, 1.0]];
        let shot = Shot { points: vec![[1e9, 0.0, 1.0], [-3.0, f32::NAN, 1.0]], lines, ..shot() };
        let image = Drawing::new(&shot, 8).unwrap().raw(header());
        let coloured = image.data.0.chunks_exact(3).filter(|pixel| **pixel != [100; 3]).count();
        assert_eq!(coloured, 8);
    }

    #[test]
    fn a_jpeg_has_the_reduced_size() {
        let message = Drawing::new(&shot(), 4).unwrap().compressed(header(), 70).unwrap();
        assert_eq!(jpeg_size(&message.data.0), Some((4, 3)));
        assert!(Drawing::new(&Shot { has_image: false, ..shot() }, 8).is_none());
    }
}
