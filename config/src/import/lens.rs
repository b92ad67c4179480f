//! Lenses as calibration files state them.

use super::file::At;
use super::{Matrix, camera_of};
use crate::camera::Distortion;
use crate::error::ConfigError;
use crate::options::CameraConfig;
use nalgebra::Isometry3;
use serde::Deserialize;

/// A lens without distortion.
pub(super) const STRAIGHT: Distortion = Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 };

/// Intrinsics and distortion of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lens {
    pub focal_px: [f64; 2],
    pub centre_px: [f64; 2],
    pub distortion: Distortion,
}

impl Lens {
    pub fn new([fx, fy, cx, cy]: [f64; 4], distortion: Distortion) -> Self {
        Self { focal_px: [fx, fy], centre_px: [cx, cy], distortion }
    }
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
    resolution: [f64; 2],
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

/// Distortion models that files may name.
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
        let size = at.whole_size("resolution", self.resolution)?;
        Ok(camera_of(self.lens(at)?, size, rate_hz, pose_b_c))
    }

    fn lens(&self, at: &At<'_>) -> Result<Lens, ConfigError> {
        let model = self.camera_model.as_str();
        let (own, names) = match model {
            "pinhole" => (0, ""),
            "omni" => (1, "xi, "),
            "eucm" => (2, "alpha, beta, "),
            "ds" => (2, "xi, alpha, "),
            _ => {
                let cure = "calibrate with one of pinhole, omni, eucm, ds";
                return Err(at.refuse("camera_model", "is no known projection", cure));
            }
        };
        let intrinsics = match self.intrinsics.split_last_chunk() {
            Some((parameters, intrinsics)) if parameters.len() == own => *intrinsics,
            _ => {
                let cure = format!("camera_model {model} has {}: [{names}fu, fv, pu, pv]", own + 4);
                return Err(at.refuse("intrinsics", format!("has {} numbers", self.intrinsics.len()), cure));
            }
        };
        let distortion = self.distortion().ok_or_else(|| self.refuse_distortion(at))?;
        Ok(Lens::new(intrinsics, distortion))
    }

    fn distortion(&self) -> Option<Distortion> {
        let model = self.distortion_model.as_deref();
        Some(match (self.camera_model.as_str(), model, &self.intrinsics[..], &self.coefficients[..]) {
            ("eucm", None | Some("none"), &[alpha, beta, ..], _) => Distortion::Eucm { alpha, beta },
            ("ds", None | Some("none"), &[xi, alpha, ..], _) => Distortion::DoubleSphere { xi, alpha },
            ("omni", Some("none"), &[xi, ..], _) => {
                Distortion::Omni { xi, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 }
            }
            ("omni", Some("radial-tangential" | "radtan"), &[xi, ..], &[k1, k2, p1, p2]) => {
                Distortion::Omni { xi, k1, k2, p1, p2 }
            }
            ("pinhole", Some("none"), ..) => STRAIGHT,
            // With four numbers k3 of plumb_bob is left out.
            ("pinhole", Some("radial-tangential" | "radtan" | "plumb_bob"), _, &[k1, k2, p1, p2]) => {
                Distortion::RadialTangential { k1, k2, p1, p2 }
            }
            ("pinhole", Some("plumb_bob"), _, &[k1, k2, p1, p2, k3]) => brown(k1, k2, p1, p2, k3),
            ("pinhole", Some("equidistant" | "equi"), _, &[k1, k2, k3, k4]) => {
                Distortion::Equidistant { k1, k2, k3, k4 }
            }
            (
                "pinhole",
                Some("rational" | "rational_polynomial" | "radtan8"),
                _,
                &[k1, k2, p1, p2, k3, k4, k5, k6],
            ) => Distortion::Rational { k1, k2, p1, p2, k3, k4, k5, k6 },
            _ => return None,
        })
    }

    fn refuse_distortion(&self, at: &At<'_>) -> ConfigError {
        const KEY: &str = "distortion_model";
        let Some(name) = &self.distortion_model else {
            return at.missing(KEY);
        };
        let (count, projection) = (self.coefficients.len(), &self.camera_model);
        at.refuse(
            KEY,
            format!("{name} of {count} coefficients does not go with camera_model {projection}"),
            MODELS,
        )
    }
}

/// Radial and tangential distortion with a third radial coefficient, which only the rational model has room for.
pub(super) fn brown(k1: f64, k2: f64, p1: f64, p2: f64, k3: f64) -> Distortion {
    match k3 == 0.0 {
        true => Distortion::RadialTangential { k1, k2, p1, p2 },
        false => Distortion::Rational { k1, k2, p1, p2, k3, k4: 0.0, k5: 0.0, k6: 0.0 },
    }
}
