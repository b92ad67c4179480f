//! A pair of axes and what stands above it: a title, and the legend beside it, where it covers no data.

use super::FONT;
use super::raster::FINENESS;
use plotters::chart::{ChartBuilder, ChartContext, LabelAreaPosition};
use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::element::{Circle, PathElement, Polygon, Rectangle};
use plotters::prelude::DrawingBackend;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontDesc, FontFamily, FontStyle, RGBColor, ShapeStyle, TextStyle};
use std::ops::Range;

/// What the plotting library says when it cannot draw.
pub(super) type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;
type Surface<B> = DrawingArea<B, Shift>;
type Chart<'a, B> = ChartContext<'a, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Words.
pub(super) const INK: RGBColor = RGBColor(30, 30, 30);
/// Words of less weight.
pub(super) const GREY_INK: RGBColor = RGBColor(95, 95, 95);
const AXIS: RGBColor = RGBColor(120, 120, 120);
const GRID: RGBColor = RGBColor(228, 228, 228);
/// Room for the numbers at the left of the axes, px.
pub(super) const LEFT_PX: i32 = 54;
/// Room for the numbers below them, px.
pub(super) const BELOW_PX: i32 = 20;
/// Height of the line of the title, px.
pub(super) const CAPTION_PX: i32 = 19;
/// Size of the letters of titles, legends and numbers, px.
pub(super) const LETTERS_PX: f64 = 12.0;
/// Size of letters by the library's measure.
const NOMINAL: f64 = 1.24;

/// Pixels in units of the surface.
pub(super) fn fine(pixels: i32) -> i32 {
    pixels * FINENESS
}

/// Letters of a size in pixels.
pub(super) fn letters(size_px: f64, weight: FontStyle, colour: RGBColor, at: HPos) -> TextStyle<'static> {
    let font = FontDesc::new(FontFamily::Name(FONT), size_px * NOMINAL * f64::from(FINENESS), weight);
    TextStyle { font, color: colour.to_backend_color(), pos: Pos::new(at, VPos::Center) }
}

/// A line of so many tenths of a pixel.
pub(super) fn stroke(colour: RGBColor, tenths_px: u32) -> ShapeStyle {
    colour.stroke_width((tenths_px * FINENESS as u32).div_ceil(10).max(1))
}

/// A rectangle in pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rect {
    pub left: i32,
    pub top: i32,
    pub width: i32,
    pub height: i32,
}

/// What a legend shows before a word.
#[derive(Clone, Copy)]
pub(super) enum Sign {
    Line(RGBColor),
    Band(RGBColor),
    Disc(RGBColor),
    Square(RGBColor),
}

/// Writes the title of a panel and its legend into the line at the top of `rect`.
pub(super) fn caption<B: DrawingBackend>(
    area: &Surface<B>,
    rect: Rect,
    title: &str,
    legend: &[(Sign, &str)],
) -> Drawn<B> {
    let middle = fine(rect.top) + fine(CAPTION_PX) / 2;
    let bold = letters(LETTERS_PX, FontStyle::Bold, INK, HPos::Left);
    area.draw_text(title, &bold, (fine(rect.left + LEFT_PX), middle))?;
    let plain = letters(LETTERS_PX, FontStyle::Normal, INK, HPos::Left);
    // From the right edge to the left.
    let mut x = fine(rect.left + rect.width);
    for (sign, words) in legend.iter().rev() {
        let (width, _) = area.estimate_text_size(words, &plain)?;
        x -= width as i32;
        area.draw_text(words, &plain, (x, middle))?;
        x -= fine(5);
        draw_sign(area, *sign, (x, middle))?;
        x -= fine(38);
    }
    Ok(())
}

/// Draws the sign of a legend, whose right end is at `at`.
fn draw_sign<B: DrawingBackend>(area: &Surface<B>, sign: Sign, (x, y): (i32, i32)) -> Drawn<B> {
    match sign {
        Sign::Line(colour) => {
            area.draw(&PathElement::new(vec![(x - fine(20), y), (x, y)], stroke(colour, 20)))
        }
        Sign::Band(colour) => {
            let corners = [(x - fine(20), y - fine(5)), (x, y + fine(5))];
            area.draw(&Rectangle::new(corners, colour.filled()))
        }
        Sign::Disc(colour) => area.draw(&Circle::new((x - fine(5), y), fine(4), colour.filled())),
        Sign::Square(colour) => {
            let corners = [(x - fine(8), y - fine(4)), (x, y + fine(4))];
            area.draw(&Rectangle::new(corners, colour.filled()))
        }
    }
}

/// The part of `rect` that the data get, below the caption and beside the numbers.
pub(super) fn inner_size_px(rect: Rect) -> (i32, i32) {
    ((rect.width - LEFT_PX).max(1), (rect.height - CAPTION_PX - BELOW_PX).max(1))
}

/// Draws axes with their numbers and a grid into `rect`, below its caption; numbers of time only `with_x_numbers`.
pub(super) fn axes<'a, B: DrawingBackend>(
    area: &Surface<B>,
    rect: Rect,
    (x, y): (Range<f64>, Range<f64>),
    with_x_numbers: bool,
) -> Result<Chart<'a, B>, DrawingAreaErrorKind<B::ErrorType>> {
    let (x, y) = (drawable(&x), drawable(&y));
    let below = if with_x_numbers { BELOW_PX } else { 0 };
    let size = (fine(rect.width), fine(rect.height - CAPTION_PX));
    let part = area.clone().shrink((fine(rect.left), fine(rect.top + CAPTION_PX)), size);
    let mut chart = ChartBuilder::on(&part)
        .set_label_area_size(LabelAreaPosition::Left, fine(LEFT_PX))
        .set_label_area_size(LabelAreaPosition::Bottom, fine(below))
        .build_cartesian_2d(x.clone(), y.clone())?;
    let numbers = letters(LETTERS_PX - 1.0, FontStyle::Normal, GREY_INK, HPos::Right);
    let (width_px, height_px) = (rect.width - LEFT_PX, rect.height - CAPTION_PX - below);
    let (x_marks, y_marks) = ((width_px / 55).clamp(2, 12) as usize, (height_px / 17).clamp(2, 10) as usize);
    let (x_decimals, y_decimals) = (decimals(&x, x_marks), decimals(&y, y_marks));
    chart
        .configure_mesh()
        .x_labels(x_marks)
        .y_labels(y_marks)
        .x_label_formatter(&|value| number(*value, x_decimals))
        .y_label_formatter(&|value| number(*value, y_decimals))
        .axis_style(stroke(AXIS, 10))
        .bold_line_style(stroke(GRID, 10))
        .light_line_style(GRID.mix(0.0))
        .label_style(numbers)
        .set_all_tick_mark_size(fine(3))
        .draw()?;
    Ok(chart)
}

/// The part of a range whose marks can be told apart, so that there is an end to them.
fn drawable(range: &Range<f64>) -> Range<f64> {
    /// Numbers of an axis, at most, and the least part of them that it may span.
    const MOST: f64 = 1e30;
    const LEAST: f64 = 1e-9;
    let (low, high) = (range.start.min(range.end), range.start.max(range.end));
    let (low, high) = (low.clamp(-MOST, MOST), high.clamp(-MOST, MOST));
    if low.is_nan() || high.is_nan() {
        return -1.0..1.0;
    }
    let least = LEAST * low.abs().max(high.abs());
    if high - low < least {
        let middle = 0.5 * (low + high);
        return middle - least..middle + least;
    }
    // Downwards where it was.
    if range.start > range.end { high..low } else { low..high }
}

/// A filled polygon in the coordinates of the data.
pub(super) fn area_between(corners: Vec<(f64, f64)>, colour: RGBColor) -> Polygon<(f64, f64)> {
    Polygon::new(corners, colour.filled())
}

/// Decimals that tell so many marks of an axis apart: those of the step between them, which is 1, 2, 2.5 or 5 times a power of ten.
fn decimals(range: &Range<f64>, marks: usize) -> usize {
    let least = ((range.end - range.start) / marks as f64).abs();
    if !(least.is_finite() && least > 0.0) {
        return 0;
    }
    // The step that is drawn is at least so large.
    let power = 10_f64.powf(least.log10().floor());
    let steps = [1.0, 2.0, 2.5, 5.0, 10.0].map(|factor| factor * power);
    let step = steps.into_iter().find(|step| *step >= least * (1.0 - 1e-9)).unwrap_or(10.0 * power);
    (0..=6).find(|digits| has_digits(step, *digits)).unwrap_or(6)
}

/// Whether a number has no more than so many decimals.
fn has_digits(value: f64, digits: usize) -> bool {
    let scaled = value * 10_f64.powi(digits as i32);
    (scaled - scaled.round()).abs() < 1e-6 * scaled.abs().max(1e-9) && scaled.round() >= 1.0
}

/// A number with a true minus sign, and without one before zero.
fn number(value: f64, decimals: usize) -> String {
    let text = format!("{:.decimals$}", value.abs());
    let is_zero = text.bytes().all(|b| matches!(b, b'0' | b'.'));
    if value < 0.0 && !is_zero { format!("\u{2212}{text}") } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_range_can_be_drawn() {
        let image = 480.0..0.0;
        assert_eq!(drawable(&(-2.0..3.0)), -2.0..3.0);
        assert_eq!(drawable(&image), image);
        for range in [
            -1e308..1e308,
            0.0..f64::INFINITY,
            f64::NAN..1.0,
            1e20..1e20,
            1e12..1e12 + 1e-3,
            f64::MIN..f64::MIN,
        ] {
            let drawn = drawable(&range);
            let (size, span) = (drawn.start.abs().max(drawn.end.abs()), drawn.end - drawn.start);
            assert!(span.is_finite() && span > 1e-10 * size, "{range:?}: {drawn:?}");
        }
    }

    #[test]
    fn numbers_have_as_many_decimals_as_they_need() {
        assert_eq!(decimals(&(0.0..20.0), 5), 0);
        assert_eq!(decimals(&(-0.3..0.3), 5), 1);
        assert_eq!(decimals(&(0.0..0.02), 5), 3);
        // Marks every 0.05, as the mesh draws them, and every 25.
        assert_eq!(decimals(&(-0.3..0.2), 10), 2);
        assert_eq!(decimals(&(0.0..250.0), 10), 0);
        assert_eq!(number(-0.25, 2), "\u{2212}0.25");
        assert_eq!(number(-0.001, 1), "0.0");
    }
}
