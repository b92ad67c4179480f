//! Where everything stands in the figure: the path at the left, the curves over time at the right.

use super::axes::{
    BELOW_PX, CAPTION_PX, Drawn, GREY_INK, INK, LEFT_PX, LETTERS_PX, Rect, Sign, area_between, axes, caption,
    fine, inner_size_px, letters, stroke,
};
use super::panels::{BAND, ESTIMATE, Panel, Pieces, TRUTH, panels};
use super::raster::FINENESS;
use super::subject::PlotSubject;
use nalgebra::Vector3;
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::element::{Circle, EmptyElement, PathElement, Rectangle};
use plotters::prelude::DrawingBackend;
use plotters::style::text_anchor::HPos;
use plotters::style::{Color, FontStyle, RGBColor, WHITE};
use std::ops::Range;

const MARGIN_PX: i32 = 16;
/// Room for the title and the line of figures under it, px.
const HEAD_PX: i32 = 62;
/// The part of the width that the path gets, and of its height the view from above, percent.
const PATH_PERCENT: i32 = 46;
const ABOVE_PERCENT: i32 = 64;
const START: RGBColor = RGBColor(0, 145, 105);
const END: RGBColor = RGBColor(213, 94, 0);
const RESET: RGBColor = RGBColor(204, 51, 17);
/// Part of a view that stays free around the path.
const PATH_MARGIN: f64 = 0.06;
/// The smallest stretch of space that a view shows, m: a vehicle at rest.
const SMALLEST_VIEW_M: f64 = 0.01;
/// The truth is drawn without a break over gaps up to this, s.
const TRUTH_GAP_S: f64 = 0.25;

/// Draws the whole figure.
pub(super) fn draw<B: DrawingBackend>(subject: &PlotSubject, area: &DrawingArea<B, Shift>) -> Drawn<B> {
    area.fill(&WHITE)?;
    let (width, height) = area.dim_in_pixel();
    let (width, height) = (width as i32 / FINENESS, height as i32 / FINENESS);
    head(subject, area)?;
    let body_px = height - HEAD_PX - MARGIN_PX;
    let path_px = (width - 3 * MARGIN_PX) * PATH_PERCENT / 100;
    let above_px = body_px * ABOVE_PERCENT / 100;
    let above = Rect { left: MARGIN_PX, top: HEAD_PX, width: path_px, height: above_px };
    let side_top = HEAD_PX + above_px + MARGIN_PX;
    let side = Rect { top: side_top, height: body_px - above_px - MARGIN_PX, ..above };
    view(subject, area, above, [0, 1])?;
    let wide = if extent(subject, 0) >= extent(subject, 1) { 0 } else { 1 };
    view(subject, area, side, [wide, 2])?;
    let left = 2 * MARGIN_PX + path_px;
    let over_time = Rect { left, top: HEAD_PX, width: width - MARGIN_PX - left, height: body_px };
    time_panels(subject, area, over_time)
}

/// The title, and the figures of the flight in a line below it.
fn head<B: DrawingBackend>(subject: &PlotSubject, area: &DrawingArea<B, Shift>) -> Drawn<B> {
    let title = letters(19.0, FontStyle::Bold, INK, HPos::Left);
    area.draw_text(&shortened(&subject.name), &title, (fine(MARGIN_PX), fine(22)))?;
    let small = letters(LETTERS_PX + 1.0, FontStyle::Normal, GREY_INK, HPos::Left);
    area.draw_text(&facts(subject), &small, (fine(MARGIN_PX), fine(45)))
}

/// The end of a long name says more than its beginning.
fn shortened(name: &str) -> String {
    const LONGEST: usize = 90;
    let count = name.chars().count();
    if count <= LONGEST {
        return name.to_owned();
    }
    format!("\u{2026}{}", name.chars().skip(count - LONGEST).collect::<String>())
}

fn facts(subject: &PlotSubject) -> String {
    let last = subject.samples[subject.samples.len() - 1].stamp;
    let mut parts = vec![format!("{} poses in {:.1} s", subject.samples.len(), subject.time_s(last))];
    if let Some((rmse_m, length_m)) = subject.ate_rmse_m {
        let percent = 100.0 * rmse_m / length_m.max(1e-9);
        parts.insert(0, format!("ATE RMSE {rmse_m:.3} m (SE(3)), {percent:.2} % of {length_m:.1} m"));
    }
    if subject.has_states() {
        parts.push(match subject.resets.len() {
            0 => "no reset".into(),
            1 => "1 reset (red line)".into(),
            count => format!("{count} resets (red lines)"),
        });
    }
    parts.extend(subject.alignment.map(|alignment| alignment.words().to_owned()));
    parts.join("  \u{b7}  ")
}

/// Positions of estimate and truth.
fn positions(subject: &PlotSubject) -> impl Iterator<Item = Vector3<f64>> {
    let truth = subject.truth.iter().map(|p| p.pose.translation.vector);
    subject.samples.iter().map(|s| s.pose_o_b.translation.vector).chain(truth)
}

/// Lowest and highest coordinate along an axis, m.
fn bounds(subject: &PlotSubject, axis: usize) -> (f64, f64) {
    let coordinates = positions(subject).map(|p| p[axis]);
    coordinates.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

fn extent(subject: &PlotSubject, axis: usize) -> f64 {
    let (low, high) = bounds(subject, axis);
    high - low
}

/// The ranges of two axes that show the whole path with one metre equally long on both, and m a pixel.
fn equal_ranges(subject: &PlotSubject, plane: [usize; 2], rect: Rect) -> ([Range<f64>; 2], f64) {
    let (width_px, height_px) = inner_size_px(rect);
    let sizes_px = [f64::from(width_px), f64::from(height_px)];
    let need = |k: usize| extent(subject, plane[k]) * (1.0 + 2.0 * PATH_MARGIN) / sizes_px[k];
    let scale = need(0).max(need(1)).max(SMALLEST_VIEW_M / sizes_px[0].min(sizes_px[1]));
    let range = |k: usize| {
        let (low, high) = bounds(subject, plane[k]);
        let (middle, half) = (0.5 * (low + high), 0.5 * scale * sizes_px[k]);
        middle - half..middle + half
    };
    ([range(0), range(1)], scale)
}

/// The path from above or from the side.
fn view<B: DrawingBackend>(
    subject: &PlotSubject,
    area: &DrawingArea<B, Shift>,
    rect: Rect,
    plane: [usize; 2],
) -> Drawn<B> {
    const NAMES: [&str; 3] = ["x", "y", "z"];
    let from = if plane[1] == 2 { "From the side" } else { "From above" };
    let title = format!("{from}: {} over {} [m]", NAMES[plane[1]], NAMES[plane[0]]);
    let mut legend = vec![(Sign::Line(ESTIMATE), "estimate")];
    if !subject.truth.is_empty() {
        legend.insert(0, (Sign::Line(TRUTH), "truth"));
    }
    legend.extend([(Sign::Disc(START), "start"), (Sign::Square(END), "end")]);
    caption(area, rect, &title, &legend)?;
    let ([x, y], scale) = equal_ranges(subject, plane, rect);
    let mut chart = axes(area, rect, (x, y), true)?;
    let point = |p: &Vector3<f64>| (p[plane[0]], p[plane[1]]);
    for piece in truth_pieces(subject) {
        let line = thinned(piece.iter().map(point), 0.25 * scale);
        chart.draw_series([PathElement::new(line, stroke(TRUTH, 34))])?;
    }
    for piece in subject.samples.chunk_by(|a, b| a.piece == b.piece) {
        let line = thinned(piece.iter().map(|s| point(&s.pose_o_b.translation.vector)), 0.25 * scale);
        chart.draw_series([PathElement::new(line, stroke(ESTIMATE, 16))])?;
    }
    let ends = [&subject.samples[0], &subject.samples[subject.samples.len() - 1]];
    let [start, end] = ends.map(|s| point(&s.pose_o_b.translation.vector));
    let (radius, half) = (fine(5), fine(4));
    chart.draw_series([Circle::new(start, radius, START.filled())])?;
    let square = Rectangle::new([(-half, -half), (half, half)], END.filled());
    chart.draw_series([EmptyElement::at(end) + square])?;
    Ok(())
}

/// The true positions, broken where the truth is not known.
fn truth_pieces(subject: &PlotSubject) -> Vec<Vec<Vector3<f64>>> {
    let is_near =
        |pair: [plumbline_config::Timestamp; 2]| pair[1].nanos_since(pair[0]) as f64 * 1e-9 <= TRUTH_GAP_S;
    let pieces = subject.truth.chunk_by(|a, b| is_near([a.stamp, b.stamp]));
    pieces.map(|piece| piece.iter().map(|p| p.pose.translation.vector).collect()).collect()
}

/// A line without the points that lie within `distance` of the one before.
fn thinned(points: impl Iterator<Item = (f64, f64)>, distance: f64) -> Vec<(f64, f64)> {
    let (mut kept, mut left_out): (Vec<(f64, f64)>, _) = (Vec::new(), None);
    for point in points {
        let is_near = |last: &(f64, f64)| (point.0 - last.0).hypot(point.1 - last.1) < distance;
        left_out = kept.last().is_some_and(is_near).then_some(point);
        if left_out.is_none() {
            kept.push(point);
        }
    }
    kept.extend(left_out);
    kept
}

/// The curves over time, one panel above the other on one axis of time.
fn time_panels<B: DrawingBackend>(
    subject: &PlotSubject,
    area: &DrawingArea<B, Shift>,
    rect: Rect,
) -> Drawn<B> {
    let panels = panels(subject);
    let last_s = subject.time_s(subject.samples[subject.samples.len() - 1].stamp);
    let time = 0.0..last_s.max(1e-3);
    // The lowest has the numbers of time and their name below it.
    let below_px = BELOW_PX + CAPTION_PX;
    let each_px = (rect.height - below_px) / panels.len().max(1) as i32;
    for (index, panel) in panels.iter().enumerate() {
        let is_last = index + 1 == panels.len();
        let top = rect.top + index as i32 * each_px;
        let height = if is_last { each_px + BELOW_PX } else { each_px - 4 };
        time_panel(subject, area, panel, Rect { top, height, ..rect }, time.clone(), is_last)?;
    }
    let middle = rect.left + LEFT_PX + (rect.width - LEFT_PX) / 2;
    let words = letters(LETTERS_PX, FontStyle::Bold, INK, HPos::Center);
    let at = (fine(middle), fine(rect.top + rect.height - CAPTION_PX / 2));
    area.draw_text("Time since the first pose [s]", &words, at)
}

fn time_panel<B: DrawingBackend>(
    subject: &PlotSubject,
    area: &DrawingArea<B, Shift>,
    panel: &Panel,
    rect: Rect,
    time: Range<f64>,
    is_last: bool,
) -> Drawn<B> {
    let mut legend: Vec<(Sign, &str)> =
        panel.curves.iter().map(|curve| (Sign::Line(curve.colour), curve.name.as_str())).collect();
    if !panel.band.is_empty() {
        legend.push((Sign::Band(BAND), panel.band_name));
    }
    caption(area, rect, panel.title, &legend)?;
    let (low, high) = panel.range();
    let mut chart = axes(area, rect, (time, low..high), is_last)?;
    chart.draw_series(bands(&panel.band, high).into_iter().map(|corners| area_between(corners, BAND)))?;
    if panel.is_error {
        let zero = vec![(0.0, 0.0), (subject.time_s(subject.samples[subject.samples.len() - 1].stamp), 0.0)];
        chart.draw_series([PathElement::new(zero, stroke(GREY_INK, 5))])?;
    }
    for stamp in &subject.resets {
        let at = subject.time_s(*stamp);
        if at >= 0.0 {
            chart.draw_series([PathElement::new(vec![(at, low), (at, high)], stroke(RESET, 10))])?;
        }
    }
    for curve in &panel.curves {
        let line = |piece: &Vec<(f64, f64)>| PathElement::new(piece.clone(), stroke(curve.colour, 13));
        chart.draw_series(curve.pieces.iter().map(line))?;
    }
    Ok(())
}

/// The corners of the areas within three sigma, cut off at `limit`.
fn bands(pieces: &Pieces, limit: f64) -> Vec<Vec<(f64, f64)>> {
    let above = |piece: &Vec<(f64, f64)>| piece.iter().map(|(t, w)| (*t, w.min(limit))).collect::<Vec<_>>();
    let area = |piece| {
        let above = above(piece);
        let below: Vec<_> = above.iter().rev().map(|(t, w)| (*t, -w)).collect();
        [above, below].concat()
    };
    pieces.iter().map(area).collect()
}
