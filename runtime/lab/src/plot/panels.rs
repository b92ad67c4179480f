//! The curves of a flight over time, as panels to be drawn one above the other.

use super::subject::{PlotSubject, Sample};
use nalgebra::Vector3;
use plotters::style::RGBColor;
use plumbline_estimator::Estimate;
use plumbline_record::columns::heading_variance;

/// Vermilion, green and blue of Okabe and Ito for x, y and z: told apart by everybody, also in print.
pub(super) const AXES: [RGBColor; 3] = [RGBColor(213, 94, 0), RGBColor(0, 145, 105), RGBColor(0, 114, 178)];
/// The estimate.
pub(super) const ESTIMATE: RGBColor = RGBColor(0, 114, 178);
/// The truth.
pub(super) const TRUTH: RGBColor = RGBColor(160, 160, 160);
/// Three standard deviations.
pub(super) const BAND: RGBColor = RGBColor(214, 230, 241);
const SECOND: RGBColor = RGBColor(213, 94, 0);
/// More points than this are not to be seen beside each other: of each stretch the extremes are kept.
const MAX_STRETCHES: usize = 700;
/// Bands count for the range of a panel up to this share of their values: they begin and end wide.
const BAND_QUANTILE: f64 = 0.95;
const NAMES: [&str; 3] = ["x", "y", "z"];

/// A curve in pieces: time in s, value.
pub(super) type Pieces = Vec<Vec<(f64, f64)>>;

/// One quantity over time.
pub(super) struct Curve {
    pub name: String,
    pub colour: RGBColor,
    pub pieces: Pieces,
}

/// Curves of one unit on one pair of axes.
pub(super) struct Panel {
    /// Quantity and unit.
    pub title: &'static str,
    pub curves: Vec<Curve>,
    /// Three standard deviations about zero.
    pub band: Pieces,
    /// Name of the band.
    pub band_name: &'static str,
    /// True if zero is in the middle.
    pub is_error: bool,
}

impl Panel {
    fn new(title: &'static str, curves: Vec<Curve>) -> Self {
        Self { title, curves, band: Vec::new(), band_name: "", is_error: false }
    }

    fn error(title: &'static str, curves: Vec<Curve>, (band_name, band): (&'static str, Pieces)) -> Self {
        Self { title, curves, band, band_name, is_error: true }
    }

    /// The lowest and highest value to be seen.
    pub(super) fn range(&self) -> (f64, f64) {
        let values = || self.curves.iter().flat_map(|c| &c.pieces).flatten().map(|(_, value)| *value);
        let (mut low, mut high) =
            values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if low > high {
            (low, high) = (-1.0, 1.0);
        }
        if self.is_error {
            let mut widths: Vec<f64> = self.band.iter().flatten().map(|(_, width)| *width).collect();
            widths.sort_by(f64::total_cmp);
            let wide = widths.get((widths.len() as f64 * BAND_QUANTILE) as usize).copied().unwrap_or(0.0);
            high = high.abs().max(low.abs()).max(wide);
            low = -high;
        }
        let smallest = 1e-9 * high.abs().max(low.abs()) + 1e-12;
        let margin = (0.08 * (high - low)).max(smallest);
        (low - margin, high + margin)
    }
}

/// The panels of a flight, the most telling first.
pub(super) fn panels(subject: &PlotSubject) -> Vec<Panel> {
    let mut panels = Vec::new();
    if subject.alignment.is_some() {
        panels.extend(error_panels(subject));
    } else {
        panels.extend(path_panels(subject));
    }
    if subject.has_states() {
        panels.extend(state_panels(subject));
    }
    panels
}

fn error_panels(subject: &PlotSubject) -> Vec<Panel> {
    const TITLES: [&str; 3] = ["Position error x [m]", "Position error y [m]", "Position error z [m]"];
    let mut panels: Vec<Panel> = (0..3)
        .map(|axis| {
            let error = pieces(subject, &|s| Some(s.error()?.0[axis]));
            let curve = Curve { name: "estimate - truth".into(), colour: AXES[axis], pieces: error };
            Panel::error(TITLES[axis], vec![curve], ("three sigma", position_band(subject, axis)))
        })
        .collect();
    let degrees =
        |of: &dyn Fn(Vector3<f64>) -> f64| pieces(subject, &|s| Some(of(s.error()?.1).to_degrees()));
    let heading = Curve { name: "heading".into(), colour: ESTIMATE, pieces: degrees(&|e| e.z) };
    let tilt = Curve { name: "tilt".into(), colour: SECOND, pieces: degrees(&|e| e.xy().norm()) };
    panels.push(Panel::error(
        "Attitude error [deg]",
        vec![heading, tilt],
        ("three sigma of the heading", heading_band(subject)),
    ));
    panels
}

/// Panels where the truth is not known: the path, and what the estimate says of its own errors.
fn path_panels(subject: &PlotSubject) -> Vec<Panel> {
    let position = three(subject, &|s| Some(s.pose_o_b.translation.vector));
    let mut panels = vec![Panel::new("Position in O [m]", position)];
    let heading = pieces(subject, &|s| Some(s.pose_o_b.rotation.euler_angles().2.to_degrees()));
    let curve = Curve { name: "about z of O".into(), colour: ESTIMATE, pieces: unwrapped_deg(heading) };
    panels.push(Panel::new("Heading [deg]", vec![curve]));
    if subject.has_states() {
        let sigmas = three(subject, &|s| {
            s.nav.as_ref().map(|n| n.covariance.diagonal().fixed_rows::<3>(0).map(three_sigma))
        });
        panels.push(Panel::new("Three sigma of the position [m]", sigmas));
        let heading = Curve { name: "heading".into(), colour: ESTIMATE, pieces: heading_band(subject) };
        panels.push(Panel::new("Three sigma of the heading [deg]", vec![heading]));
    }
    panels
}

fn state_panels(subject: &PlotSubject) -> Vec<Panel> {
    let state = |of: fn(&Estimate) -> Vector3<f64>| three(subject, &move |s| s.nav.as_ref().map(of));
    let mut panels = vec![
        Panel::new("Velocity in O [m/s]", state(|n| n.v_o_b)),
        Panel::new("Gyroscope bias [mrad/s]", state(|n| n.bias_gyro * 1e3)),
        Panel::new("Accelerometer bias [m/s\u{b2}]", state(|n| n.bias_accel)),
    ];
    let points = pieces(subject, &|s| s.features.map(|(points, _)| f64::from(points)));
    let lines = pieces(subject, &|s| s.features.map(|(_, lines)| f64::from(lines)));
    panels.push(Panel::new(
        "Features [count]",
        vec![
            Curve { name: "points tracked".into(), colour: ESTIMATE, pieces: points },
            Curve { name: "lines matched".into(), colour: SECOND, pieces: lines },
        ],
    ));
    panels
}

fn three_sigma(variance: f64) -> f64 {
    3.0 * variance.max(0.0).sqrt()
}

fn position_band(subject: &PlotSubject, axis: usize) -> Pieces {
    pieces(subject, &|s| s.nav.as_ref().map(|nav| three_sigma(nav.covariance[(axis, axis)])))
}

/// Three sigma of the heading, degrees.
fn heading_band(subject: &PlotSubject) -> Pieces {
    pieces(subject, &|s| s.nav.as_ref().map(|nav| three_sigma(heading_variance(nav)).to_degrees()))
}

/// The components of a vector as three curves.
fn three(subject: &PlotSubject, of: &dyn Fn(&Sample) -> Option<Vector3<f64>>) -> Vec<Curve> {
    let component = |axis: usize| Curve {
        name: NAMES[axis].into(),
        colour: AXES[axis],
        pieces: pieces(subject, &|s| Some(of(s)?[axis])),
    };
    (0..3).map(component).collect()
}

/// A quantity over time, broken where the estimate is.
fn pieces(subject: &PlotSubject, of: &dyn Fn(&Sample) -> Option<f64>) -> Pieces {
    let (mut found, mut last_piece): (Pieces, _) = (Vec::new(), None);
    for sample in &subject.samples {
        let value = of(sample).filter(|value| value.is_finite());
        let Some(value) = value else {
            last_piece = None;
            continue;
        };
        if last_piece != Some(sample.piece) {
            found.push(Vec::new());
        }
        last_piece = Some(sample.piece);
        if let Some(piece) = found.last_mut() {
            piece.push((subject.time_s(sample.stamp), value));
        }
    }
    let total = found.iter().map(Vec::len).sum();
    found.into_iter().map(|piece| thinned(piece, total)).collect()
}

/// The extremes of each stretch of a piece, of a curve of `total` points.
fn thinned(piece: Vec<(f64, f64)>, total: usize) -> Vec<(f64, f64)> {
    let stretch = total.div_ceil(MAX_STRETCHES);
    if stretch <= 2 {
        return piece;
    }
    let mut kept = Vec::new();
    for part in piece.chunks(stretch) {
        let at = |best: fn(std::cmp::Ordering) -> bool| {
            (1..part.len()).fold(0, |k, i| if best(part[i].1.total_cmp(&part[k].1)) { i } else { k })
        };
        let (low, high) = (at(std::cmp::Ordering::is_lt), at(std::cmp::Ordering::is_gt));
        kept.extend([low.min(high), low.max(high)].map(|index| part[index]));
    }
    kept
}

/// Angles without the jumps of a whole turn.
fn unwrapped_deg(mut pieces: Pieces) -> Pieces {
    let mut last: Option<f64> = None;
    for (_, angle) in pieces.iter_mut().flatten() {
        if let Some(last) = last {
            *angle -= 360.0 * ((*angle - last) / 360.0).round();
        }
        last = Some(*angle);
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};
    use plumbline_config::Timestamp;
    use plumbline_estimator::{NavCovariance, TrackingState};

    /// A row whose numbers depend on `seed`.
    fn row(seed: f64) -> Estimate {
        let vector = |k: f64| Vector3::new(seed + k, seed * 1e-7 - k, (seed + k).sin());
        Estimate {
            stamp: Timestamp::from_nanos((seed * 1e6) as i64),
            state: TrackingState::Tracking,
            pose_o_b: Isometry3::new(vector(1.0), vector(1.0) * 0.01),
            v_o_b: vector(2.0),
            bias_gyro: vector(3.0) * 1e-3,
            bias_accel: vector(4.0) * 1e-2,
            covariance: NavCovariance::identity() * 1e-4,
            ..Estimate::default()
        }
    }

    /// Subject with ten rows; the fourth and fifth have no pose.
    fn subject() -> PlotSubject {
        let state = |k| if k == 3 || k == 4 { TrackingState::Failed } else { TrackingState::Tracking };
        let rows: Vec<Estimate> =
            (0..10).map(|k| Estimate { state: state(k), ..row(f64::from(k)) }).collect();
        PlotSubject::of_states("rows", &rows).unwrap()
    }

    #[test]
    fn curves_break_where_there_is_no_pose() {
        let subject = subject();
        let panels = panels(&subject);
        let titles: Vec<&str> = panels.iter().map(|p| p.title).collect();
        assert_eq!(titles[0], "Position in O [m]");
        assert!(titles.contains(&"Gyroscope bias [mrad/s]"), "{titles:?}");
        let lengths: Vec<usize> = panels[0].curves[0].pieces.iter().map(Vec::len).collect();
        assert_eq!(lengths, [3, 5]);
    }

    #[test]
    fn thinning_keeps_the_extremes() {
        let mut curve: Vec<(f64, f64)> = (0..10_000).map(|k| (f64::from(k), 0.0)).collect();
        (curve[4321].1, curve[8765].1) = (7.0, -5.0);
        let total = curve.len();
        let thin = thinned(curve, total);
        assert!(thin.len() <= 2 * MAX_STRETCHES && thin.is_sorted_by_key(|p| p.0));
        assert!(thin.contains(&(4321.0, 7.0)) && thin.contains(&(8765.0, -5.0)));
    }

    #[test]
    fn an_error_has_zero_in_the_middle_and_its_band_in_sight() {
        let curve =
            Curve { name: String::new(), colour: ESTIMATE, pieces: vec![vec![(0.0, 0.1), (1.0, -0.2)]] };
        let panel = Panel::error("error", vec![curve], ("three sigma", vec![vec![(0.0, 0.3), (1.0, 0.3)]]));
        let (low, high) = panel.range();
        assert!((low + high).abs() < 1e-12 && high > 0.3 && high < 0.4, "{low} {high}");
        let flat = Panel::new(
            "flat",
            vec![Curve { name: String::new(), colour: ESTIMATE, pieces: vec![vec![(0.0, 2.0)]] }],
        );
        assert!(flat.range().0 < 2.0 && flat.range().1 > 2.0);
    }

    #[test]
    fn a_heading_goes_on_beyond_half_a_turn() {
        let turns = vec![vec![(0.0, 170.0), (1.0, -175.0), (2.0, -160.0)]];
        assert_eq!(unwrapped_deg(turns), [[(0.0, 170.0), (1.0, 185.0), (2.0, 200.0)]]);
    }
}
