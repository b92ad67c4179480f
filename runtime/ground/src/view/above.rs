//! Paths, loops and landmarks from above, in dots of a terminal: x to the right, y up, both to the same scale.

use super::super::corrected::in_odometry;
use super::super::fleet::Fleet;
use super::super::vehicle::VehicleState;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};
use ratatui::symbols::Marker;
use ratatui::text::Span;
use ratatui::widgets::Block;
use ratatui::widgets::canvas::{Canvas, Line, Points};

/// Dots in a cell of Braille.
const DOTS: (f64, f64) = (2.0, 4.0);
/// Less than this is not shown larger, m.
const MIN_WIDTH_M: f64 = 2.0;
/// Free room around what is shown, as a share of it.
const MARGIN: f64 = 0.05;
/// Colours of the vehicles, in turn.
const COLOURS: [Color; 6] =
    [Color::Cyan, Color::Yellow, Color::Magenta, Color::Green, Color::LightBlue, Color::LightRed];

/// Colour of loops.
const LOOP_COLOUR: Color = Color::White;

/// Draws every vehicle's path, where its place in the map is known the corrected one with the loops too, the points in
/// its window, and its name where it is: all in the odometry frame.
pub fn draw(frame: &mut Frame<'_>, fleet: &Fleet, area: Rect) {
    let inner = Block::bordered().inner(area);
    let paths: Vec<Vec<(f64, f64)>> = fleet
        .vehicles
        .values()
        .map(|v| v.track.points.iter().map(|[_, x, y, _]| (*x, *y)).collect())
        .collect();
    let Some(view) = View::of(paths.iter().flatten(), inner) else {
        return;
    };
    let title = format!(" from above: {:.1} m wide ", view.x[1] - view.x[0]);
    let canvas = Canvas::default()
        .block(Block::bordered().title(title))
        .marker(Marker::Braille)
        .x_bounds(view.x)
        .y_bounds(view.y)
        .paint(|context| {
            for vehicle in fleet.vehicles.values() {
                let points = vehicle.map.scene.points_o.chunks_exact(3);
                let coords: Vec<_> = points.map(|p| (f64::from(p[0]), f64::from(p[1]))).collect();
                context.draw(&Points { coords: &coords, color: Color::DarkGray });
            }
            context.layer();
            for ends in fleet.vehicles.values().flat_map(loops) {
                let [(x1, y1), (x2, y2)] = ends;
                context.draw(&Line { x1, y1, x2, y2, color: LOOP_COLOUR });
            }
            for vehicle in fleet.vehicles.values() {
                context.draw(&Points { coords: &corrected_path(vehicle), color: LOOP_COLOUR });
            }
            for (path, color) in paths.iter().zip(COLOURS.into_iter().cycle()) {
                context.draw(&Points { coords: path, color });
            }
            for ((name, path), color) in fleet.vehicles.keys().zip(&paths).zip(COLOURS.into_iter().cycle()) {
                if let Some((x, y)) = path.last() {
                    context.print(*x, *y, Span::styled(format!("● {name}"), Style::new().fg(color)));
                }
            }
        });
    frame.render_widget(canvas, area);
}

/// Both ends of every loop, from above.
fn loops(vehicle: &VehicleState) -> Vec<[(f64, f64); 2]> {
    let Some(pose_m_o) = vehicle.pose_m_o() else { return Vec::new() };
    let place = |p: [f32; 3]| in_odometry(&pose_m_o, p);
    let both = |ends: &[[f32; 3]; 2]| ends.map(place).map(|p| (p.x, p.y));
    vehicle.corrected.loops().iter().map(both).collect()
}

/// The keyframes of the corrected path, from above.
fn corrected_path(vehicle: &VehicleState) -> Vec<(f64, f64)> {
    let Some(pose_m_o) = vehicle.pose_m_o() else { return Vec::new() };
    let places = vehicle.corrected.pieces().iter().flatten().map(|p| in_odometry(&pose_m_o, *p));
    places.map(|p| (p.x, p.y)).collect()
}

/// Part of the plane in view, m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct View {
    x: [f64; 2],
    y: [f64; 2],
}

impl View {
    /// All points in the middle of the area, at one scale for both axes; `None` without points or room.
    fn of<'a>(points: impl Iterator<Item = &'a (f64, f64)>, area: Rect) -> Option<Self> {
        let (columns, rows) = (f64::from(area.width) * DOTS.0, f64::from(area.height) * DOTS.1);
        let finite = points.filter(|(x, y)| x.is_finite() && y.is_finite());
        let bounds = finite.fold(None, |bounds: Option<[f64; 4]>, (x, y)| {
            let [x0, x1, y0, y1] = bounds.unwrap_or([*x, *x, *y, *y]);
            Some([x0.min(*x), x1.max(*x), y0.min(*y), y1.max(*y)])
        });
        let [x0, x1, y0, y1] = bounds.filter(|_| columns > 0.0 && rows > 0.0)?;
        let m_per_dot = f64::max((x1 - x0) / columns, (y1 - y0) / rows).max(MIN_WIDTH_M / columns);
        let range = |low: f64, high: f64, dots: f64| {
            let half = 0.5 * (1.0 + 2.0 * MARGIN) * m_per_dot * dots;
            [0.5 * (low + high) - half, 0.5 * (low + high) + half]
        };
        Some(Self { x: range(x0, x1, columns), y: range(y0, y1, rows) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_is_in_view_at_one_scale() {
        let area = Rect::new(0, 0, 40, 10);
        let view = View::of([(0.0, 0.0), (8.0, 20.0), (f64::NAN, 1.0)].iter(), area).unwrap();
        assert!(view.y[0] < 0.0 && view.y[1] > 20.0 && view.x[0] < 0.0 && view.x[1] > 8.0, "{view:?}");
        let scale = |range: [f64; 2], dots: f64| (range[1] - range[0]) / dots;
        assert!((scale(view.x, 80.0) - scale(view.y, 40.0)).abs() < 1e-12);
    }

    #[test]
    fn one_point_is_in_the_middle_and_none_is_no_view() {
        let area = Rect::new(0, 0, 40, 10);
        let view = View::of([(3.0, 4.0)].iter(), area).unwrap();
        assert!((view.x[0] + view.x[1] - 6.0).abs() < 1e-12 && view.x[1] > 3.5);
        assert_eq!(View::of([].iter(), area), None);
        assert_eq!(View::of([(0.0, 0.0)].iter(), Rect::ZERO), None);
    }
}
