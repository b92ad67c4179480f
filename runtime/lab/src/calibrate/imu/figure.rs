//! The Allan deviations as a picture: gyroscope at the left, accelerometer at the right, points with the line that was
//! fitted to them.

use super::{Found, SensorNoise};
use crate::plot::{self, LogCurve, LogFigure, LogPanel, PlotError};
use std::path::Path;

/// Draws what was found into `path` (.svg or .png); `name` is what was looked at.
///
/// # Errors
/// When the ending is unknown, or the file cannot be written.
pub fn write_figure(found: &Found, name: &str, path: &Path) -> Result<(), PlotError> {
    let rest = &found.rest;
    let panels = [("Gyroscope", "rad/s"), ("Accelerometer", "m/s\u{b2}")];
    let panels = found.sensors.iter().zip(panels).map(|(sensor, (name, unit))| LogPanel {
        title: format!("{name}: Allan deviation [{unit}]"),
        curves: curves(sensor),
    });
    let figure = LogFigure {
        title: format!("Noise of the IMU: {name}"),
        facts: format!(
            "{:.1} s at rest, {:.1} Hz; line: white noise and bias walk as fitted, bars: one sigma",
            rest.length_s,
            1.0 / rest.dt_s
        ),
        horizontal: "Averaging time [s]".into(),
        panels: panels.collect(),
    };
    plot::write_log_log(&figure, path)
}

fn curves(sensor: &SensorNoise) -> Vec<LogCurve> {
    let axes = sensor.axes.iter().zip(["x", "y", "z"]);
    let curve = |(axis, name): (&Option<super::AxisNoise>, _)| {
        let Some(axis) = axis else { return LogCurve { name, points: Vec::new(), line: Vec::new() } };
        let points = axis.points.iter().map(|point| {
            let freedom = point.freedom_white.min(point.freedom_walk);
            (point.tau_s, point.deviation(), point.deviation() / (2.0 * freedom).sqrt())
        });
        let line = axis.points.iter().map(|point| (point.tau_s, axis.model(point.tau_s).sqrt()));
        LogCurve { name, line: line.collect(), points: points.collect() }
    };
    axes.map(curve).collect()
}
