//! Lenses as calibration files state them.

use super::file::At;
use super::{Matrix, distortion};
use crate::camera::Distortion;
use crate::error::ConfigError;
use crate::options::{CameraConfig, rows_from_isometry};
use nalgebra::Isometry3;
use serde::Deserialize;

/// Focal lengths and principal point `[fx, fy, cx, cy]`, and the distortion.
pub(super) type Lens = ([f64; 4], Distortion);

/// A camera of a file: its image size, rate, lens and pose.
pub(super) fn camera_of(
    [width_px, height_px]: [usize; 2],
    rate_hz: f64,
    ([fx, fy, cx, cy], distortion): Lens,
    pose_b_c: &Isometry3<f64>,
) -> CameraConfig {
    let pose_b_c = rows_from_isometry(pose_b_c);
    CameraConfig::new(width_px, height_px, rate_hz, [fx, fy], [cx, cy], distortion, pose_b_c)
}

/// A camera in files of Kalibr and OpenVINS, and in the ASL format.
#[derive(Deserialize)]
pub(super) struct Camera {
    #[serde(default = "pinhole")]
    camera_model: String,
    intrinsics: Vec<f64>,
    distortion_model: Option<String>,
    #[serde(default, rename = "distortion_coeffs", alias = "distortion_coefficients")]
    coefficients: Vec<f64>,
    resolution: [usize; 2],
    pub rate_hz: Option<f64>,
    #[serde(rename = "T_cam_imu")]
    pub pose_c_b: Option<Matrix<4>>,
    #[serde(rename = "T_imu_cam")]
    pub pose_b_c: Option<Matrix<4>>,
    #[serde(rename = "T_cn_cnm1")]
    pub pose_c_before: Option<Matrix<4>>,
    #[serde(rename = "T_BS")]
    pub pose_b_s: Option<Matrix<4>>,
    pub timeshift_cam_imu: Option<f64>,
    #[serde(default)]
    pub cam_overlaps: Vec<u32>,
}

fn pinhole() -> String {
    "pinhole".into()
}

/// Projections that files may name, with the parameters before the focal lengths.
const PROJECTIONS: [(&str, &[&str]); 4] =
    [("pinhole", &[]), ("omni", &["xi"]), ("eucm", &["alpha", "beta"]), ("ds", &["xi", "alpha"])];
/// Distortions of each that files may name, with the number of their coefficients, and the model here. With four numbers k3 of
/// plumb_bob is left out.
const DISTORTIONS: [(&str, &[&str], usize, &str); 9] = [
    ("pinhole", &["none"], 0, "radial-tangential"),
    ("pinhole", &["radial-tangential", "radtan", "plumb_bob"], 4, "radial-tangential"),
    ("pinhole", &["plumb_bob"], 5, "rational"),
    ("pinhole", &["rational", "rational_polynomial", "radtan8"], 8, "rational"),
    ("pinhole", &["equidistant", "equi"], 4, "equidistant"),
    ("omni", &["none"], 0, "omni"),
    ("omni", &["radial-tangential", "radtan"], 4, "omni"),
    ("eucm", &["none"], 0, "eucm"),
    ("ds", &["none"], 0, "double-sphere"),
];
const MODELS: &str = "use pinhole with radtan (k1 k2 p1 p2), plumb_bob (k1 k2 p1 p2 k3), rational_polynomial (k1 k2 p1 p2 k3 k4 k5 k6) \
                      or equidistant (k1 k2 k3 k4), omni with none or radtan, or ds or eucm with none; delete no coefficient";

impl Camera {
    /// The camera of a table, at a pose.
    pub fn config(
        &self,
        at: &At<'_>,
        rate_hz: f64,
        pose_b_c: &Isometry3<f64>,
    ) -> Result<CameraConfig, ConfigError> {
        Ok(camera_of(self.resolution, rate_hz, self.lens(at)?, pose_b_c))
    }

    fn lens(&self, at: &At<'_>) -> Result<Lens, ConfigError> {
        let model = self.camera_model.as_str();
        let Some((_, names)) = PROJECTIONS.iter().find(|(name, _)| *name == model) else {
            let cure = "calibrate with one of pinhole, omni, eucm, ds";
            return Err(at.refuse("camera_model", "is no known projection", cure));
        };
        let (own, intrinsics) = match self.intrinsics.split_last_chunk() {
            Some((own, intrinsics)) if own.len() == names.len() => (own, *intrinsics),
            _ => {
                let all = [*names, &["fu", "fv", "pu", "pv"][..]].concat();
                let cure = format!("camera_model {model} has {}: [{}]", all.len(), all.join(", "));
                return Err(at.refuse("intrinsics", format!("has {} numbers", self.intrinsics.len()), cure));
            }
        };
        let name = match self.distortion_model.as_deref() {
            Some(name) => name,
            None if matches!(model, "eucm" | "ds") => "none",
            None => return Err(at.missing("distortion_model")),
        };
        let given = if name == "none" { &[][..] } else { &self.coefficients[..] };
        let known = DISTORTIONS.iter().find(|(projection, names, count, _)| {
            *projection == model && names.contains(&name) && given.len() == *count
        });
        let mut numbers = own.iter().chain(given);
        let of = |_| Ok::<_, ConfigError>(numbers.next().copied().unwrap_or_default());
        let refused = || {
            let count = self.coefficients.len();
            let reason = format!("{name} of {count} coefficients does not go with camera_model {model}");
            at.refuse("distortion_model", reason, MODELS)
        };
        Ok((intrinsics, distortion(known.map_or("", |known| known.3), of)?.ok_or_else(refused)?))
    }
}
