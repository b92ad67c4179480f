//! A calibration as text: a row for each view, and the figures of each camera.

use super::lens::names;
use super::result::{Calibration, CameraResult, PairResult, ViewResult};
use std::fmt::Write as _;

/// Decimals of a value so that its standard deviation has two digits.
fn decimals(sigma: f64) -> usize {
    if sigma.is_finite() && sigma > 0.0 { (1.0 - sigma.log10().floor()).clamp(0.0, 8.0) as usize } else { 3 }
}

/// A value with its standard deviation.
pub(super) fn with_sigma(value: f64, sigma: f64) -> String {
    let decimals = decimals(sigma);
    format!("{value:.decimals$} +- {sigma:.decimals$}")
}

/// A row for each view.
pub fn views(calibration: &Calibration) -> String {
    let is_stereo = calibration.pair.is_some();
    let width = calibration.views.iter().map(|view| view.name.chars().count()).max().unwrap_or(0).max(5);
    let mut text = format!("{:width$}  cam0 corners  rms [px]", "image");
    if is_stereo {
        text.push_str("  cam1 corners  rms [px]");
    }
    text.push_str("  distance [m]  tilt [deg]\n");
    for view in &calibration.views {
        let _ = writeln!(text, "{:width$}{}", view.name, row(view, is_stereo));
    }
    if !calibration.unused.is_empty() {
        let _ = writeln!(
            text,
            "not used, since they show too little of the board: {}",
            calibration.unused.join(", ")
        );
    }
    text
}

fn row(view: &ViewResult, is_stereo: bool) -> String {
    let mut text = String::new();
    for camera in 0..if is_stereo { 2 } else { 1 } {
        let rms = view.rms_px[camera].map_or_else(|| "-".to_owned(), |rms| format!("{rms:.2}"));
        let _ = write!(text, "{:>14}{rms:>10}", view.corners[camera]);
    }
    let _ = write!(text, "{:>14.2}{:>12.0}", view.distance_m, view.tilt_deg);
    text
}

/// The figures, a line each.
pub fn figures(calibration: &Calibration) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for (index, camera) in calibration.cameras.iter().enumerate() {
        lines.extend(camera_lines(index, camera));
    }
    lines.extend(calibration.pair.iter().flat_map(pair_lines));
    lines.push(format!(
        "all        {} corners in {} views of {}, {:.3} px RMS",
        calibration.corners,
        calibration.views.len(),
        calibration.target,
        calibration.rms_px
    ));
    lines
}

fn camera_lines(index: usize, camera: &CameraResult) -> [String; 3] {
    let values = super::lens::unknowns(&camera.model);
    let names = names(&camera.model);
    let part = |range: std::ops::Range<usize>| {
        let words = range.map(|k| format!("{} {}", names[k], with_sigma(values[k], camera.sigmas[k])));
        words.collect::<Vec<_>>().join("   ")
    };
    [
        format!("camera[{index}]  {} px", part(0..4)),
        format!("           {}", part(4..names.len())),
        format!(
            "           {} corners in {} views, {:.3} px RMS, covering {:.0} % of the image",
            camera.residuals.len(),
            camera.views,
            camera.rms_px,
            100.0 * camera.coverage
        ),
    ]
}

fn pair_lines(pair: &PairResult) -> [String; 3] {
    let place = pair.pose_c0_c1.translation.vector * 1e3;
    let turn = pair.pose_c0_c1.rotation.scaled_axis().map(f64::to_degrees);
    let three = |values: &dyn Fn(usize) -> (f64, f64)| {
        (0..3).map(|k| with_sigma(values(k).0, values(k).1)).collect::<Vec<_>>().join("   ")
    };
    [
        format!("baseline   {} mm", with_sigma(pair.baseline_m * 1e3, pair.baseline_sigma_m * 1e3)),
        format!("cam1 at    {} mm from cam0", three(&|k| (place[k], pair.translation_sigma_m[k] * 1e3))),
        format!(
            "turned by  {} degrees about x, y, z",
            three(&|k| (turn[k], pair.rotation_sigma_rad[k].to_degrees()))
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_has_as_many_decimals_as_its_deviation_bears() {
        assert_eq!(with_sigma(458.654_321, 0.1234), "458.65 +- 0.12");
        assert_eq!(with_sigma(-0.283_408, 0.000_31), "-0.28341 +- 0.00031");
        assert_eq!(with_sigma(458.6, 21.0), "459 +- 21");
        assert_eq!(with_sigma(1.0, f64::INFINITY), "1.000 +- inf");
    }
}
