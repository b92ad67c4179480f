//! Words on a picture, in the letters of the figures.

use super::axes::letters;
use super::raster::{FINENESS, Raster};
use super::register_letters;
use crate::picture::{Rgb, RgbImage};
use plotters::prelude::DrawingBackend as _;
use plotters::style::text_anchor::HPos;
use plotters::style::{FontStyle, RGBColor, TextStyle};

/// Words of one size and colour.
pub struct Caption<'a> {
    words: &'a str,
    style: TextStyle<'static>,
}

impl<'a> Caption<'a> {
    /// Words in letters of a size (of an em), px.
    #[must_use]
    pub fn new(words: &'a str, size_px: usize, [red, green, blue]: Rgb) -> Self {
        // Without letters a caption is as wide as nothing, and draws it.
        let _ = register_letters();
        let colour = RGBColor(red, green, blue);
        Self { words, style: letters(size_px as f64, FontStyle::Normal, colour, HPos::Left) }
    }

    /// Width of the words, px; 0 of letters that there are not.
    #[must_use]
    pub fn width(&self) -> usize {
        self.style.font.box_size(self.words).map_or(0, |(width, _)| width.div_ceil(FINENESS as u32) as usize)
    }

    /// Writes the words from `left` on, with the middle of the line at `middle`, px. Words without letters are left out.
    pub fn draw(&self, picture: &mut RgbImage, left: usize, middle: usize) {
        let [x, y] = [left, middle].map(|px| i32::try_from(px).unwrap_or(i32::MAX / FINENESS) * FINENESS);
        let _ = Raster::on(picture).draw_text(self.words, &self.style, (x, y));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHITE: Rgb = [255; 3];

    /// Columns and rows of the pixels that are no longer black.
    fn lit(picture: &RgbImage) -> Vec<(usize, usize)> {
        let all = (0..picture.height()).flat_map(|y| (0..picture.width()).map(move |x| (x, y)));
        all.filter(|(x, y)| picture.pixel(*x, *y).is_some_and(|pixel| pixel[0] > 0)).collect()
    }

    #[test]
    fn words_are_as_wide_as_they_say_around_their_middle() {
        let mut picture = RgbImage::new(200, 40, [0; 3]);
        let caption = Caption::new("merged 120", 20, WHITE);
        caption.draw(&mut picture, 30, 20);
        let lit = lit(&picture);
        let span = |of: fn(&(usize, usize)) -> usize| {
            (lit.iter().map(of).min().unwrap(), lit.iter().map(of).max().unwrap())
        };
        let ((left, right), (top, bottom)) = (span(|p| p.0), span(|p| p.1));
        let end = 30 + caption.width();
        assert!((30..34).contains(&left) && (end - 6..end).contains(&right), "{left} {right}, not {end}");
        // Of letters of 20 px the highest rise 16 px above the base line, which is 5 px below the middle; some hang below it.
        assert!((8..12).contains(&top) && (26..31).contains(&bottom), "{top} {bottom}");
    }

    #[test]
    fn words_are_cut_at_the_rim() {
        let mut picture = RgbImage::new(24, 16, [0; 3]);
        for (left, middle) in [(3, 8), (20, 14), (500, 8), (3, usize::MAX)] {
            Caption::new("raw 8", 14, WHITE).draw(&mut picture, left, middle);
        }
        assert!(!lit(&picture).is_empty());
    }
}
