//! The plotting library's drawing surface over a [`RgbImage`]: smooth lines, areas and letters in pixels.
//!
//! The library draws at whole coordinates. Its surface here is finer than the pixels by [`FINENESS`], so that curves
//! do not go in steps; an SVG is drawn on the same surface, and told its size in pixels.

use crate::picture::RgbImage;
use nalgebra::Vector2;
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
};
use std::convert::Infallible;

/// Units of the surface to a pixel.
pub(super) const FINENESS: i32 = 4;
/// Where the base line of letters lies when the library draws them, in their nominal size below the origin.
const BASE_LINE: f64 = 0.5;
/// The size of an em in the nominal size of letters, by the library.
const EM: f64 = 1.0 / 1.24;

/// A picture that the plotting library draws on.
pub(super) struct Raster<'a> {
    picture: &'a mut RgbImage,
}

impl<'a> Raster<'a> {
    /// Draws on `picture`.
    pub(super) fn on(picture: &'a mut RgbImage) -> Self {
        Self { picture }
    }

    fn strokes(&mut self, from: BackendCoord, to: BackendCoord, style: &impl BackendStyle) {
        // Lines are opaque, or not there at all.
        if style.color().alpha == 0.0 {
            return;
        }
        let thickness = style.stroke_width() as f32 / FINENESS as f32;
        self.picture.line(place(from), place(to), thickness, style.color().rgb.into());
    }

    /// Lays colour over a pixel, as opaque as its covered share of `FINENESS` squared parts.
    fn cover(&mut self, x: i32, y: i32, parts: f32, color: BackendColor) {
        let share = parts / (FINENESS * FINENESS) as f32 * color.alpha as f32;
        if let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) {
            self.picture.blend(x, y, color.rgb.into(), share.clamp(0.0, 1.0));
        }
    }
}

/// A point of the surface in the picture, whose pixel centres are at whole numbers.
fn place((x, y): BackendCoord) -> Vector2<f32> {
    Vector2::new(x as f32, y as f32) / FINENESS as f32 - Vector2::repeat(0.5)
}

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

impl DrawingBackend for Raster<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        let size = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX).saturating_mul(FINENESS as u32);
        (size(self.picture.width()), size(self.picture.height()))
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, color: BackendColor) -> Drawn {
        self.cover(x.div_euclid(FINENESS), y.div_euclid(FINENESS), 1.0, color);
        Ok(())
    }

    fn draw_line<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S) -> Drawn {
        self.strokes(from, to, style);
        Ok(())
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        (left, top): BackendCoord,
        (right, bottom): BackendCoord,
        style: &S,
        fill: bool,
    ) -> Drawn {
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
        if fill {
            return self.fill_polygon(corners, style);
        }
        self.draw_path(corners.into_iter().chain([corners[0]]), style)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        let mut last = None;
        for point in path {
            if let Some(last) = last {
                self.strokes(last, point, style);
            }
            last = Some(point);
        }
        Ok(())
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        centre: BackendCoord,
        radius: u32,
        style: &S,
        _fill: bool,
    ) -> Drawn {
        self.picture.disc(place(centre), radius as f32 / FINENESS as f32, style.color().rgb.into());
        Ok(())
    }

    /// Fills by the even-odd rule, each row of the surface by itself.
    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Drawn {
        let corners: Vec<BackendCoord> = corners.into_iter().collect();
        let (width, height) = (self.picture.width(), self.picture.height() as i32);
        let rows = || corners.iter().map(|(_, y)| y.div_euclid(FINENESS));
        let (Some(first), Some(last)) = (rows().min(), rows().max()) else { return Ok(()) };
        let mut covered = vec![0.0_f32; width];
        for row in first.max(0)..=last.min(height - 1) {
            covered.fill(0.0);
            for line in 0..FINENESS {
                let y = f64::from(row * FINENESS + line) + 0.5;
                for span in crossings(&corners, y).chunks_exact(2) {
                    add_span(&mut covered, span[0], span[1]);
                }
            }
            for (x, &parts) in covered.iter().enumerate().filter(|(_, parts)| **parts > 0.0) {
                self.cover(x as i32, row, parts, style.color());
            }
        }
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Drawn {
        let font_error = |e: S::FontError| DrawingErrorKind::FontError(Box::new(e));
        let ((left, _), (right, _)) = style.layout_box(text).map_err(font_error)?;
        let shift_x = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Center => (left - right) / 2,
            HPos::Right => left - right,
        };
        // Where SVG has the base line: 0.76 em below the top, half an x-height below the middle.
        let base_line = match style.anchor().v_pos {
            VPos::Top => 0.76,
            VPos::Center => 0.26,
            VPos::Bottom => -0.26,
        };
        let shift_y = (style.size() * (base_line * EM - BASE_LINE)).round() as i32;
        let mut covered = std::collections::BTreeMap::new();
        let collect = |x: i32, y: i32, color: BackendColor| -> Result<(), Infallible> {
            let moved = |to: i32, shift: i32, by: i32| to.saturating_add(shift).saturating_add(by);
            let (x, y) = (moved(at.0, shift_x, x), moved(at.1, shift_y, y));
            *covered.entry((y.div_euclid(FINENESS), x.div_euclid(FINENESS))).or_insert(0.0) +=
                color.alpha as f32;
            Ok(())
        };
        match style.draw(text, (0, 0), collect).map_err(font_error)? {
            Ok(()) => {}
            Err(never) => match never {},
        }
        for ((y, x), parts) in covered {
            // Letters that touch may both cover a part.
            self.cover(x, y, parts, BackendColor { alpha: 1.0, rgb: style.color().rgb });
        }
        Ok(())
    }
}

/// Where the sides of a polygon cross a row, in order.
fn crossings(corners: &[BackendCoord], y: f64) -> Vec<f64> {
    let point = |index: usize| {
        let (x, y) = corners[index % corners.len()];
        (f64::from(x), f64::from(y))
    };
    let sides = (0..corners.len()).map(|i| (point(i), point(i + 1)));
    let mut found: Vec<f64> = sides
        .filter(|((_, y0), (_, y1))| (*y0 <= y) != (*y1 <= y))
        .map(|((x0, y0), (x1, y1))| x0 + (y - y0) / (y1 - y0) * (x1 - x0))
        .collect();
    found.sort_by(f64::total_cmp);
    found
}

/// Adds a stretch of one row of the surface to the pixels that it covers.
fn add_span(covered: &mut [f32], from: f64, to: f64) {
    let fineness = f64::from(FINENESS);
    let (from, to) = (from.max(0.0), to.min(covered.len() as f64 * fineness));
    if from >= to {
        return;
    }
    let (first, last) = ((from / fineness) as usize, ((to / fineness) as usize).min(covered.len() - 1));
    for (pixel, parts) in (first..).zip(&mut covered[first..=last]) {
        let left = pixel as f64 * fineness;
        *parts += (to.min(left + fineness) - from.max(left)).max(0.0) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLACK: BackendColor = BackendColor { alpha: 1.0, rgb: (0, 0, 0) };

    fn white(width: usize, height: usize) -> RgbImage {
        RgbImage::new(width, height, [255; 3])
    }

    fn grey(raster: &Raster<'_>, x: usize, y: usize) -> u8 {
        raster.picture.pixel(x, y).unwrap()[0]
    }

    #[test]
    fn areas_cover_pixels_by_their_share() {
        let mut picture = white(8, 8);
        let mut raster = Raster::on(&mut picture);
        // Two and a half pixels wide, one high, from pixel 1.
        raster.draw_rect((4, 8), (14, 12), &BLACK, true).unwrap();
        let row: Vec<u8> = (0..5).map(|x| grey(&raster, x, 2)).collect();
        assert_eq!(row, [255, 0, 0, 128, 255]);
        assert_eq!((grey(&raster, 2, 1), grey(&raster, 2, 3)), (255, 255));
        // What lies outside is left out.
        raster.draw_rect((-100, -100), (1000, 1000), &BLACK, true).unwrap();
        assert!((0..64).all(|i| grey(&raster, i % 8, i / 8) == 0));
    }

    #[test]
    fn a_polygon_with_a_notch_leaves_the_notch_empty() {
        let mut picture = white(12, 8);
        let mut raster = Raster::on(&mut picture);
        raster
            .fill_polygon([(0, 0), (12, 0), (12, 24), (32, 24), (32, 0), (44, 0), (44, 32), (0, 32)], &BLACK)
            .unwrap();
        assert_eq!(
            [grey(&raster, 1, 2), grey(&raster, 5, 2), grey(&raster, 9, 2), grey(&raster, 5, 7)],
            [0, 255, 0, 0]
        );
    }

    #[test]
    fn a_line_lies_between_the_pixels_where_it_is_told_to() {
        let mut picture = white(8, 8);
        let mut raster = Raster::on(&mut picture);
        raster.draw_path([(0, 16), (32, 16)], &Thick(4)).unwrap();
        assert_eq!(grey(&raster, 4, 3), grey(&raster, 4, 4));
        assert!(grey(&raster, 4, 3) < 200 && grey(&raster, 4, 2) == 255);
    }

    struct Thick(u32);

    impl BackendStyle for Thick {
        fn color(&self) -> BackendColor {
            BLACK
        }

        fn stroke_width(&self) -> u32 {
            self.0
        }
    }
}
