//! Panels of curves on logarithmic axes, beside each other under one title: Allan deviations.

use super::axes::{
    BELOW_PX, CAPTION_PX, Drawn, GREY_INK, INK, LEFT_PX, LETTERS_PX, Rect, Sign, caption, fine, letters,
    stroke,
};
use super::panels::AXES;
use plotters::chart::ChartBuilder;
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::element::{Circle, PathElement};
use plotters::prelude::DrawingBackend;
use plotters::style::text_anchor::HPos;
use plotters::style::{Color, FontStyle, RGBColor, WHITE};
use std::ops::Range;

const MARGIN_PX: i32 = 16;
const HEAD_PX: i32 = 62;
const GRID: RGBColor = RGBColor(228, 228, 228);
const FAINT_GRID: RGBColor = RGBColor(244, 244, 244);
const FRAME: RGBColor = RGBColor(120, 120, 120);

/// Panels beside each other.
#[derive(Clone, Debug)]
pub struct LogFigure {
    /// Title.
    pub title: String,
    /// A line of figures below it.
    pub facts: String,
    /// Quantity along the horizontal axes, with its unit.
    pub horizontal: String,
    /// Panels, from the left.
    pub panels: Vec<LogPanel>,
}

/// Curves on one pair of axes.
#[derive(Clone, Debug)]
pub struct LogPanel {
    /// Quantity and unit.
    pub title: String,
    /// Up to three curves, in the colours of x, y and z.
    pub curves: Vec<LogCurve>,
}

/// One quantity: measured points with their standard deviations, and a line through what was fitted to them.
#[derive(Clone, Debug)]
pub struct LogCurve {
    /// Name in the legend.
    pub name: &'static str,
    /// Where, value, and standard deviation of the value; those that are not above zero are left out.
    pub points: Vec<(f64, f64, f64)>,
    /// The line.
    pub line: Vec<(f64, f64)>,
}

impl LogFigure {
    /// Draws the whole figure.
    pub(super) fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        area.fill(&WHITE)?;
        let (width, height) = area.dim_in_pixel();
        let (width, height) = (width as i32 / fine(1), height as i32 / fine(1));
        let title = letters(19.0, FontStyle::Bold, INK, HPos::Left);
        area.draw_text(&self.title, &title, (fine(MARGIN_PX), fine(22)))?;
        let small = letters(LETTERS_PX + 1.0, FontStyle::Normal, GREY_INK, HPos::Left);
        area.draw_text(&self.facts, &small, (fine(MARGIN_PX), fine(45)))?;
        let count = self.panels.len().max(1) as i32;
        let each_px = (width - (count + 1) * MARGIN_PX) / count;
        for (k, panel) in (0..).zip(&self.panels) {
            let left = MARGIN_PX + k * (each_px + MARGIN_PX);
            let rect = Rect { left, top: HEAD_PX, width: each_px, height: height - HEAD_PX - 2 * MARGIN_PX };
            panel.draw(area, rect)?;
            let middle = left + LEFT_PX + (each_px - LEFT_PX) / 2;
            let words = letters(LETTERS_PX, FontStyle::Bold, INK, HPos::Center);
            area.draw_text(&self.horizontal, &words, (fine(middle), fine(height - MARGIN_PX)))?;
        }
        Ok(())
    }
}

impl LogPanel {
    /// Whole decades around all points, as powers of ten.
    fn decades(&self) -> [Range<f64>; 2] {
        let points = || self.curves.iter().flat_map(|curve| &curve.points).filter(|p| p.0 > 0.0 && p.1 > 0.0);
        let range = |of: &dyn Fn(&(f64, f64, f64)) -> f64| {
            let logs = points().map(|p| of(p).log10());
            let (low, high) = logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            if low > high { -1.0..1.0 } else { low.floor()..high.ceil().max(low.floor() + 1.0) }
        };
        [range(&|p| p.0), range(&|p| p.1)]
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, rect: Rect) -> Drawn<B> {
        let signs = self.curves.iter().zip(AXES).map(|(curve, colour)| (Sign::Line(colour), curve.name));
        caption(area, rect, &self.title, &signs.collect::<Vec<_>>())?;
        let [x, y] = self.decades();
        let size = (fine(rect.width), fine(rect.height - CAPTION_PX));
        let part = area.clone().shrink((fine(rect.left), fine(rect.top + CAPTION_PX)), size);
        let mut chart = ChartBuilder::on(&part)
            .margin_left(fine(LEFT_PX))
            .margin_bottom(fine(BELOW_PX))
            .build_cartesian_2d(x.clone(), y.clone())?;
        for (from, to, is_whole) in grid(&x, &y) {
            let colour = if is_whole { GRID } else { FAINT_GRID };
            chart.draw_series([PathElement::new(vec![from, to], stroke(colour, 10))])?;
        }
        let corners =
            [(x.start, y.start), (x.end, y.start), (x.end, y.end), (x.start, y.end), (x.start, y.start)];
        chart.draw_series([PathElement::new(corners.to_vec(), stroke(FRAME, 10))])?;
        for (curve, colour) in self.curves.iter().zip(AXES) {
            let clipped = curve.line.iter().map(|(x, y)| (x.log10(), y.log10()));
            let line: Vec<_> = clipped.filter(|p| x.contains(&p.0) && y.contains(&p.1)).collect();
            chart.draw_series([PathElement::new(line, stroke(colour, 10))])?;
            for &(at, value, sigma) in curve.points.iter().filter(|p| p.0 > 0.0 && p.1 > 0.0) {
                let (at, low) = (at.log10(), (value - sigma).max(0.05 * value).log10().max(y.start));
                let bar = vec![(at, low), (at, (value + sigma).log10().min(y.end))];
                chart.draw_series([PathElement::new(bar, stroke(colour, 10))])?;
                chart.draw_series([Circle::new((at, value.log10()), fine(3), colour.filled())])?;
            }
        }
        numbers(area, rect, [&x, &y])
    }
}

type Line = ((f64, f64), (f64, f64), bool);

/// Lines at 1 to 9 times the powers of ten; whether they are at one times.
fn grid(x: &Range<f64>, y: &Range<f64>) -> Vec<Line> {
    let marks = |range: &Range<f64>| {
        let (first, last) = (range.start as i32, range.end as i32);
        let decade = |k: i32| (1..10).map(move |m| (f64::from(k) + f64::from(m).log10(), m == 1));
        (first..last).flat_map(decade).collect::<Vec<_>>()
    };
    let upright = marks(x).into_iter().map(|(at, whole)| ((at, y.start), (at, y.end), whole));
    let level = marks(y).into_iter().map(|(at, whole)| ((x.start, at), (x.end, at), whole));
    let mut lines: Vec<Line> = upright.chain(level).collect();
    // The faint ones below.
    lines.sort_by_key(|line| line.2);
    lines
}

/// The powers of ten along both axes.
fn numbers<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    rect: Rect,
    [x, y]: [&Range<f64>; 2],
) -> Drawn<B> {
    let (left, top) = (rect.left + LEFT_PX, rect.top + CAPTION_PX);
    let (width, height) = (rect.width - LEFT_PX, rect.height - CAPTION_PX - BELOW_PX);
    let share = |k: i32, range: &Range<f64>| (f64::from(k) - range.start) / (range.end - range.start);
    let below = letters(LETTERS_PX - 1.0, FontStyle::Normal, GREY_INK, HPos::Center);
    for k in x.start as i32..=x.end as i32 {
        let at = left + (share(k, x) * f64::from(width)) as i32;
        area.draw_text(&power(k), &below, (fine(at), fine(top + height + BELOW_PX / 2)))?;
    }
    let beside = letters(LETTERS_PX - 1.0, FontStyle::Normal, GREY_INK, HPos::Right);
    for k in y.start as i32..=y.end as i32 {
        let at = top + height - (share(k, y) * f64::from(height)) as i32;
        area.draw_text(&power(k), &beside, (fine(left - 6), fine(at)))?;
    }
    Ok(())
}

/// A power of ten as people write it.
fn power(k: i32) -> String {
    match k {
        0..=3 => format!("{}", 10_i64.pow(k as u32)),
        -3..=-1 => format!("{:.*}", -k as usize, 10.0_f64.powi(k)),
        _ => format!("1e{k}"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Drawing, SIZE_PX, png, svg};
    use super::*;

    fn figure(points: Vec<(f64, f64, f64)>) -> LogFigure {
        let line = points.iter().map(|p| (p.0, p.1)).collect();
        let curves = vec![LogCurve { name: "x", points, line }];
        let panel = LogPanel { title: "Allan deviation [rad/s]".into(), curves };
        LogFigure {
            title: "IMU at rest".into(),
            facts: "of 2 h".into(),
            horizontal: "Averaging time [s]".into(),
            panels: vec![panel.clone(), panel],
        }
    }

    #[test]
    fn axes_are_whole_decades_around_what_is_shown() {
        let figure = figure(vec![(0.02, 3e-4, 1e-5), (150.0, 2e-5, 1e-5), (1.0, 0.0, 0.0)]);
        assert_eq!(figure.panels[0].decades(), [-2.0..3.0, -5.0..-3.0]);
        assert_eq!(LogPanel { title: String::new(), curves: vec![] }.decades(), [-1.0..1.0, -1.0..1.0]);
    }

    #[test]
    fn it_is_drawn_as_svg_and_as_pixels_whatever_the_values() {
        for points in [vec![(0.02, 3e-4, 1e-5), (150.0, 2e-5, 9e-5)], vec![], vec![(f64::NAN, 1.0, 0.0)]] {
            let figure = figure(points);
            let text = svg(&Drawing::LogLog(&figure), SIZE_PX).unwrap();
            assert!(text.contains("Averaging time [s]") && text.contains("IMU at rest"));
            assert!(png(&Drawing::LogLog(&figure), (600, 400)).is_ok());
        }
    }

    #[test]
    fn powers_are_written_as_people_do() {
        assert_eq!([-6, -2, 0, 2, 5].map(power), ["1e-6", "0.01", "1", "100", "1e5"]);
    }
}
