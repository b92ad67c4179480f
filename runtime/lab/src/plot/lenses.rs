//! Where a calibration has seen corners, and how far they lie from where they are projected to: three panels a camera.

use super::axes::{
    BELOW_PX, CAPTION_PX, Drawn, GREY_INK, INK, LEFT_PX, LETTERS_PX, Rect, Sign, area_between, axes, caption,
    fine, letters, stroke,
};
use super::raster::FINENESS;
use nalgebra::Vector2;
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::element::{Circle, PathElement};
use plotters::prelude::DrawingBackend;
use plotters::style::text_anchor::HPos;
use plotters::style::{Color, FontStyle, RGBColor, WHITE};

const MARGIN_PX: i32 = 16;
const HEAD_PX: i32 = 58;
/// The sides of a panel of residuals over the width of an image's panel.
const SCATTER_SHARE: f64 = 0.62;
/// Residuals are drawn this many times as long in the image.
const LENGTHENED: f64 = 50.0;
/// The smallest half side of a panel of residuals, px.
const SMALLEST_SCATTER_PX: f64 = 0.5;
const CORNER: RGBColor = RGBColor(0, 114, 178);
const ERROR: RGBColor = RGBColor(213, 94, 0);
/// Cells without a corner.
const EMPTY: RGBColor = RGBColor(253, 226, 209);
/// Circles of one and of three RMS.
const CIRCLES: [f64; 2] = [1.0, 3.0];
const CIRCLE_SIDES: usize = 72;

/// One camera of a calibration, to be drawn.
#[derive(Clone, Debug)]
pub struct LensFigure {
    /// Its name.
    pub name: String,
    /// Size of its images, px.
    pub size_px: (usize, usize),
    /// Where corners were seen, and how far from where they are projected to, px.
    pub corners: Vec<(Vector2<f64>, Vector2<f64>)>,
    /// Cells across and down in which a corner is wanted.
    pub cells: [usize; 2],
    /// Root of the mean squared distance, px.
    pub rms_px: f64,
}

/// The size of a figure that shows so many cameras as large as their images' shape asks for, px.
#[must_use]
pub(super) fn size_px(cameras: &[LensFigure]) -> (u32, u32) {
    const WIDTH_PX: i32 = 1500;
    let rows: i32 = cameras.iter().map(|camera| row_height_px(WIDTH_PX, camera)).sum();
    (WIDTH_PX as u32, u32::try_from(HEAD_PX + MARGIN_PX + rows).unwrap_or(u32::MAX))
}

/// Width of the panels that show the image, px.
fn panel_width_px(width_px: i32) -> i32 {
    (f64::from(width_px - 4 * MARGIN_PX) / (2.0 + SCATTER_SHARE)) as i32
}

fn row_height_px(width_px: i32, camera: &LensFigure) -> i32 {
    let shape = camera.size_px.1 as f64 / camera.size_px.0.max(1) as f64;
    let inner = f64::from(panel_width_px(width_px) - LEFT_PX) * shape;
    (inner as i32).clamp(120, 1500) + CAPTION_PX + BELOW_PX + MARGIN_PX
}

/// Draws the whole figure.
pub(super) fn draw<B: DrawingBackend>(
    cameras: &[LensFigure],
    words: (&str, &str),
    area: &DrawingArea<B, Shift>,
) -> Drawn<B> {
    area.fill(&WHITE)?;
    let title = letters(19.0, FontStyle::Bold, INK, HPos::Left);
    area.draw_text(words.0, &title, (fine(MARGIN_PX), fine(22)))?;
    let small = letters(LETTERS_PX + 1.0, FontStyle::Normal, GREY_INK, HPos::Left);
    area.draw_text(words.1, &small, (fine(MARGIN_PX), fine(44)))?;
    let width = area.dim_in_pixel().0 as i32 / FINENESS;
    let panel = panel_width_px(width);
    let mut top = HEAD_PX;
    for camera in cameras {
        let height = row_height_px(width, camera) - MARGIN_PX;
        let first = Rect { left: MARGIN_PX, top, width: panel, height };
        coverage(camera, area, first)?;
        errors(camera, area, Rect { left: 2 * MARGIN_PX + panel, ..first })?;
        let left = 3 * MARGIN_PX + 2 * panel;
        scatter(camera, area, Rect { left, width: width - MARGIN_PX - left, ..first })?;
        top += height + MARGIN_PX;
    }
    Ok(())
}

/// The image's sides as ranges, y downwards.
fn image_ranges(camera: &LensFigure) -> (std::ops::Range<f64>, std::ops::Range<f64>) {
    (0.0..camera.size_px.0 as f64, camera.size_px.1 as f64..0.0)
}

/// Where corners were seen; cells without one are coloured.
fn coverage<B: DrawingBackend>(camera: &LensFigure, area: &DrawingArea<B, Shift>, rect: Rect) -> Drawn<B> {
    let title = format!("{}: where corners were seen", camera.name);
    caption(area, rect, &title, &[(Sign::Disc(CORNER), "corner"), (Sign::Band(EMPTY), "none here")])?;
    let mut chart = axes(area, rect, image_ranges(camera), true)?;
    chart.draw_series(empty_cells(camera).into_iter().map(|corners| area_between(corners, EMPTY)))?;
    let dot = |(px, _): &(Vector2<f64>, _)| Circle::new((px.x, px.y), (3 * FINENESS) / 2, CORNER.filled());
    chart.draw_series(camera.corners.iter().map(dot))?;
    Ok(())
}

/// The corners of the cells in which nothing was seen.
fn empty_cells(camera: &LensFigure) -> Vec<Vec<(f64, f64)>> {
    let [across, down] = camera.cells;
    let (width, height) = (camera.size_px.0 as f64 / across as f64, camera.size_px.1 as f64 / down as f64);
    let mut empty = Vec::new();
    for (x, y) in (0..down).flat_map(|y| (0..across).map(move |x| (x, y))) {
        let (left, top) = (x as f64 * width, y as f64 * height);
        let is_inside = |px: &Vector2<f64>| {
            (left..left + width).contains(&(px.x + 0.5)) && (top..top + height).contains(&(px.y + 0.5))
        };
        if !camera.corners.iter().any(|(px, _)| is_inside(px)) {
            let (right, bottom) = (left + width, top + height);
            empty.push(vec![(left, top), (right, top), (right, bottom), (left, bottom)]);
        }
    }
    empty
}

/// Distance of each corner from its projection, lengthened, where it was seen: a pattern is an error of the lens model.
fn errors<B: DrawingBackend>(camera: &LensFigure, area: &DrawingArea<B, Shift>, rect: Rect) -> Drawn<B> {
    let title = format!("residuals, {LENGTHENED} times as long");
    caption(area, rect, &title, &[(Sign::Line(ERROR), "seen to projected")])?;
    let mut chart = axes(area, rect, image_ranges(camera), true)?;
    let line = |(px, error): &(Vector2<f64>, Vector2<f64>)| {
        let end = px + error * LENGTHENED;
        let within = |at: f64, side: usize| at.clamp(0.0, side as f64);
        let end = (within(end.x, camera.size_px.0), within(end.y, camera.size_px.1));
        PathElement::new(vec![(px.x, px.y), end], stroke(ERROR, 8))
    };
    chart.draw_series(camera.corners.iter().map(line))?;
    Ok(())
}

/// The residuals about zero: a round cloud is noise.
fn scatter<B: DrawingBackend>(camera: &LensFigure, area: &DrawingArea<B, Shift>, rect: Rect) -> Drawn<B> {
    let legend = format!("1 and 3 RMS of {:.2} px", camera.rms_px);
    caption(area, rect, "residuals [px]", &[(Sign::Line(INK), &legend)])?;
    let half = (1.15 * CIRCLES[1] * camera.rms_px).max(SMALLEST_SCATTER_PX);
    let shape = f64::from(rect.height - CAPTION_PX - BELOW_PX) / f64::from((rect.width - LEFT_PX).max(1));
    // A pixel is equally long on both axes.
    let (x, y) = if shape < 1.0 { (half / shape, half) } else { (half, half * shape) };
    let mut chart = axes(area, rect, (-x..x, y..-y), true)?;
    let inside = camera.corners.iter().filter(|(_, e)| e.x.abs() < x && e.y.abs() < y);
    chart.draw_series(inside.map(|(_, e)| Circle::new((e.x, e.y), FINENESS, ERROR.filled())))?;
    for times in CIRCLES {
        let at = |k: usize| {
            let angle = std::f64::consts::TAU * k as f64 / CIRCLE_SIDES as f64;
            (times * camera.rms_px * angle.cos(), times * camera.rms_px * angle.sin())
        };
        chart.draw_series([PathElement::new(
            (0..=CIRCLE_SIDES).map(at).collect::<Vec<_>>(),
            stroke(INK, 10),
        )])?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_without_a_corner_are_told() {
        let camera = LensFigure {
            name: "cam0".into(),
            size_px: (100, 50),
            corners: vec![
                (Vector2::new(10.0, 10.0), Vector2::zeros()),
                (Vector2::new(99.4, 49.4), Vector2::zeros()),
            ],
            cells: [2, 2],
            rms_px: 0.2,
        };
        let empty = empty_cells(&camera);
        assert_eq!(empty.iter().map(|cell| cell[0]).collect::<Vec<_>>(), [(50.0, 0.0), (0.0, 25.0)]);
        let (width, height) = size_px(&[camera.clone(), camera]);
        assert!(width == 1500 && (500..900).contains(&height), "{height}");
    }
}
