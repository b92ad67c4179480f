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

/// Outcome of drawing, with the error of the plotting library.
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

/// Mark of a legend before a word.
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
    let (x_numbers, y_numbers) = (Numbers::of(&x, x_marks), Numbers::of(&y, y_marks));
    chart
        .configure_mesh()
        .x_labels(x_marks)
        .y_labels(y_marks)
        .x_label_formatter(&|value| x_numbers.text(*value))
        .y_label_formatter(&|value| y_numbers.text(*value))
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

/// Numbers of an axis: as decimals, or with a power of ten where these would be long.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Numbers {
    /// Power of ten that is written behind; 0 for none.
    exponent: i32,
    /// Decimals that tell the marks apart.
    decimals: usize,
}

impl Numbers {
    /// Decimals from which on a power of ten is shorter.
    const MOST_DECIMALS: i32 = 5;
    /// Digits before the point from which on it is.
    const MOST_DIGITS: i32 = 7;
    /// Digits that an `f64` has.
    const DIGITS: i32 = 16;

    /// Numbers that tell so many marks of a range apart: with the decimals of the step between them, which is 1, 2 or 5 times a power of
    /// ten.
    fn of(range: &Range<f64>, marks: usize) -> Self {
        let largest = range.start.abs().max(range.end.abs());
        // So many marks lie in a range of at most one step more than they have between them.
        let least = ((range.end - range.start) / (marks + 1) as f64).abs();
        if !(least.is_finite() && least > 0.0 && largest.is_finite()) {
            return Self { exponent: 0, decimals: 0 };
        }
        // The step that is drawn is at least so large: 1, 2 and 5 have no decimals, and 2.5 is not drawn.
        let power = least.log10().floor() as i32;
        let is_next = 5.0 * 10_f64.powi(power) < least * (1.0 - 1e-9);
        let decimals = -(power + i32::from(is_next));
        let digits = largest.log10().floor() as i32;
        let exponent = if decimals > Self::MOST_DECIMALS || digits >= Self::MOST_DIGITS { digits } else { 0 };
        let decimals = (decimals + exponent).clamp(0, Self::DIGITS);
        Self { exponent, decimals: decimals as usize }
    }

    /// A number with a true minus sign, and without one before zero.
    fn text(self, value: f64) -> String {
        let text = format!("{:.*}", self.decimals, value.abs() / 10_f64.powi(self.exponent));
        if text.bytes().all(|b| matches!(b, b'0' | b'.')) {
            return if self.exponent == 0 { text } else { "0".into() };
        }
        let sign = if value < 0.0 { "\u{2212}" } else { "" };
        match self.exponent {
            0 => format!("{sign}{text}"),
            exponent => format!("{sign}{text}e{exponent}"),
        }
    }
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
        let decimals = |range: Range<f64>, marks| Numbers::of(&range, marks).decimals;
        assert_eq!(decimals(0.0..20.0, 5), 0);
        assert_eq!(decimals(-0.3..0.3, 5), 1);
        assert_eq!(decimals(0.0..0.02, 5), 3);
        // Marks every 0.05, as the mesh draws them, and every 25.
        assert_eq!(decimals(-0.3..0.2, 10), 2);
        assert_eq!(decimals(0.0..250.0, 10), 0);
        let text = |decimals, value| Numbers { exponent: 0, decimals }.text(value);
        assert_eq!((text(2, -0.25), text(1, -0.001)), ("\u{2212}0.25".into(), "0.0".into()));
    }

    /// The marks that the mesh draws.
    fn marks(range: &Range<f64>, most: usize) -> Vec<f64> {
        use plotters::coord::ranged1d::{BoldPoints, Ranged};
        let axis: plotters::coord::types::RangedCoordf64 = range.clone().into();
        axis.key_points(BoldPoints(most))
    }

    #[test]
    fn no_two_marks_of_an_axis_have_the_same_number() {
        let mut ranges =
            vec![-1e-9..2e-9, 0.0..3e-7, 5.0..5.0 + 1e-6, 1e9..1e9 + 3.0, -2e12..7e12, 4e5..4.000_01e5];
        ranges.extend(
            (-12..13).flat_map(|k| {
                [1.0, 1.7, 2.4, 4.9, 9.9].map(|m| -0.3 * m * 10_f64.powi(k)..m * 10_f64.powi(k))
            }),
        );
        for range in ranges {
            let range = drawable(&range);
            for most in [2, 3, 5, 10, 12] {
                let numbers = Numbers::of(&range, most);
                let texts: Vec<String> =
                    marks(&range, most).into_iter().map(|value| numbers.text(value)).collect();
                let distinct: std::collections::BTreeSet<&String> = texts.iter().collect();
                assert_eq!(distinct.len(), texts.len(), "{range:?}, {most}: {texts:?}");
                let is_short = |text: &String| text.chars().count() <= 9;
                assert!(
                    range.start > 1e5 || range.start == 5.0 || texts.iter().all(is_short),
                    "{range:?}: {texts:?}"
                );
            }
        }
    }
}
