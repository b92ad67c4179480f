//! Mistakes in the calibration that an estimator is given.

use super::kinds::Mistake;
use crate::calibration::place;
use plumbline_config::Config;
use plumbline_config::camera::Distortion;

/// Makes the mistake in `config`.
pub(super) fn mistake(mistake: Mistake, dose: f64, config: &mut Config) {
    match mistake {
        Mistake::Baseline => scale_baseline(config, dose),
        Mistake::Lens => {
            config.camera.iter_mut().for_each(|camera| camera.distortion = renamed(camera.distortion))
        }
    }
}

/// Mounts the right camera `factor` times as far from the left one.
fn scale_baseline(config: &mut Config, factor: f64) {
    let [left, right] = &mut config.camera[..] else { return };
    let origin = left.pose_b_c().translation.vector;
    let mut pose = right.pose_b_c();
    pose.translation.vector = origin + (pose.translation.vector - origin) * factor;
    place(right, &pose);
}

/// Coefficients of the other model, given the same four numbers; of a lens that has others, a fisheye without any.
fn renamed(lens: Distortion) -> Distortion {
    match lens {
        Distortion::Rational { .. }
        | Distortion::Omni { .. }
        | Distortion::Eucm { .. }
        | Distortion::DoubleSphere { .. } => Distortion::Equidistant { k1: 0.0, k2: 0.0, k3: 0.0, k4: 0.0 },
        Distortion::RadialTangential { k1, k2, p1, p2 } => Distortion::Equidistant { k1, k2, k3: p1, k4: p2 },
        Distortion::Equidistant { k1, k2, k3, k4 } => Distortion::RadialTangential { k1, k2, p1: k3, p2: k4 },
    }
}
