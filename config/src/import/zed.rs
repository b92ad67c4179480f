//! Stereolabs' factory calibration (`SN12345.conf`): sections in the manner of INI files, one for each camera and size, and
//! `STEREO` with the baseline in millimetres.
//!
//! Intrinsics and baseline are taken over. The small rotation between the cameras is not: the manufacturer does not document its
//! direction, and the flight refines it.

use super::distortion;
use crate::error::{ConfigError, Violation};
use crate::options::{CameraConfig, Config, rows_from_isometry};
use crate::text::read_bounded;
use nalgebra::{Isometry3, Translation3};
use std::collections::BTreeMap;
use std::path::Path;

/// Suffixes of the sections, by the width and height of one image.
const SIZES: [((usize, usize), &str); 4] =
    [((672, 376), "vga"), ((1280, 720), "hd"), ((1920, 1080), "fhd"), ((2208, 1242), "2k")];
/// Baselines of the manufacturer's cameras, mm.
const BASELINE_MM: std::ops::RangeInclusive<f64> = 20.0..=300.0;

/// `base`, whose cameras have the calibration of the file in their size.
///
/// # Errors
/// When the file cannot be read, lacks a key, or the lens cannot be described.
pub fn zed_into(base: Config, file: impl AsRef<Path>) -> Result<Config, ConfigError> {
    let file = file.as_ref();
    zed_text_into(base, &read_bounded(file)?, &file.display().to_string())
}

/// [`zed_into`] of a text; `origin` names it in messages.
pub(crate) fn zed_text_into(mut base: Config, text: &str, origin: &str) -> Result<Config, ConfigError> {
    let file = Sections::of(text);
    let refused = |violation| ConfigError::one(origin, violation);
    let baseline_mm = file.required("stereo", "baseline").map_err(refused)?;
    if !BASELINE_MM.contains(&baseline_mm) {
        let reason = format!("{baseline_mm} mm is no baseline of such a camera");
        let cure = "it is in millimetres, such as 63.0";
        return Err(refused(Violation::new("stereo.baseline", reason, cure)));
    }
    for (camera, side) in base.camera.iter_mut().zip(["left", "right"]) {
        file.put_camera(side, camera).map_err(refused)?;
    }
    if let [left, right] = &mut base.camera[..] {
        let to_right = Translation3::new(baseline_mm * 1e-3, 0.0, 0.0);
        right.pose_b_c = rows_from_isometry(&(left.pose_b_c() * Isometry3::from(to_right)));
    }
    Ok(base)
}

/// Values of `key = value` lines with their lines, by `section.key` in small letters.
struct Sections<'a>(BTreeMap<String, (usize, &'a str)>);

impl<'a> Sections<'a> {
    fn of(text: &'a str) -> Self {
        let (mut section, mut values) = ("", BTreeMap::new());
        for (index, line) in text.lines().enumerate() {
            let line = line.split(['#', ';']).next().unwrap_or_default().trim();
            if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
                section = name.trim();
            } else if let Some((key, value)) = line.split_once('=') {
                let key = format!("{section}.{}", key.trim()).to_ascii_lowercase();
                values.entry(key).or_insert((index + 1, value.trim()));
            }
        }
        Self(values)
    }

    /// Puts the intrinsics of a side into its camera.
    fn put_camera(&self, side: &str, camera: &mut CameraConfig) -> Result<(), Violation> {
        let (width, height) = (camera.width_px, camera.height_px);
        let Some((_, suffix)) = SIZES.iter().find(|(size, _)| *size == (width, height)) else {
            let cure = "take a size of the camera: 672 x 376, 1280 x 720, 1920 x 1080, 2208 x 1242";
            let reason = format!("{width} x {height} is in no such file");
            return Err(Violation::new("camera[0].width_px", reason, cure));
        };
        let section = format!("{side}_cam_{suffix}");
        let required = |key| self.required(&section, key);
        camera.focal_px = [required("fx")?, required("fy")?];
        camera.centre_px = [required("cx")?, required("cy")?];
        let lens = distortion("rational", |key| match key {
            "k1" | "k2" => required(key),
            _ => self.number(&section, key).map(Option::unwrap_or_default),
        });
        camera.distortion = lens?.unwrap_or(camera.distortion);
        Ok(())
    }

    fn required(&self, section: &str, key: &str) -> Result<f64, Violation> {
        let cure = "take the file of your serial number from calib.stereolabs.com";
        let missing = || Violation::new(format!("{section}.{key}"), "is missing", cure);
        self.number(section, key)?.ok_or_else(missing)
    }

    /// Number of a key in a section; `None` where it is not there.
    fn number(&self, section: &str, key: &str) -> Result<Option<f64>, Violation> {
        let key = format!("{section}.{key}");
        let Some((line, value)) = self.0.get(&key) else { return Ok(None) };
        let number = value.parse().ok().filter(|number: &f64| number.is_finite());
        let refused = || Violation::new(key, "is no number", "correct it in the file").at_line(Some(*line));
        number.map(Some).ok_or_else(refused)
    }
}

#[cfg(all(test, feature = "toml"))]
mod tests {
    use super::*;
    use crate::camera::Distortion;

    const FILE: &str = "[LEFT_CAM_VGA]\nfx=350.494\nfy=350.5\ncx=331.039\ncy=189.714\nk1=-0.174488\nk2=0.027323\n\n\
        [RIGHT_CAM_VGA]\nfx = 349.663\nfy = 349.6\ncx = 335.323 ; a remark\ncy = 189.551\nk1 = -0.175561\nk2 = 0.0269139\n\
        p1=0.0001\np2=-0.0002\nk3=0\n\n[STEREO]\nBaseline=62.981\nCV_VGA=0.00281173\nRX_VGA=0.0031709\n";

    fn base() -> Config {
        Config::preset("zed-mini").unwrap().into_inner()
    }

    #[test]
    fn intrinsics_and_baseline_are_those_of_the_file() {
        let config = zed_text_into(base(), FILE, "SN1.conf").unwrap().validated("SN1.conf").unwrap();
        let [left, right] = &config.camera[..] else { panic!("two cameras") };
        assert_eq!((left.focal_px, left.centre_px), ([350.494, 350.5], [331.039, 189.714]));
        let distortion =
            Distortion::RadialTangential { k1: -0.175_561, k2: 0.026_913_9, p1: 0.0001, p2: -0.0002 };
        assert_eq!((right.centre_px, right.distortion), ([335.323, 189.551], distortion));
        let between = left.pose_b_c().inverse() * right.pose_b_c();
        assert!((between.translation.vector - nalgebra::Vector3::new(0.062_981, 0.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn more_radial_coefficients_make_a_rational_lens() {
        let lens = |k: &str| {
            let config = zed_text_into(base(), &FILE.replace("k3=0", k), "SN1.conf").unwrap();
            config.validated("SN1.conf").unwrap().camera[1].distortion
        };
        assert!(matches!(lens("k3=0.02"), Distortion::Rational { k3: 0.02, k4: 0.0, .. }));
        let wide = lens("k3=0.02\nk4=0.1\nk5=-0.02\nk6=0.003");
        assert!(matches!(wide, Distortion::Rational { k3: 0.02, k4: 0.1, k5: -0.02, k6: 0.003, .. }));
    }

    #[test]
    fn missing_and_wrong_keys_are_named() {
        let refused = |text: &str| zed_text_into(base(), text, "SN1.conf").unwrap_err().to_string();
        let missing = refused(&FILE.replace("cx=331.039\n", ""));
        assert!(missing.contains("SN1.conf") && missing.contains("left_cam_vga.cx"), "{missing}");
        let wrong = refused(&FILE.replace("62.981", "sixty"));
        assert!(wrong.contains("stereo.baseline") && wrong.contains("line 21"), "{wrong}");
        assert!(refused(&FILE.replace("62.981", "0.0629")).contains("millimetres"));
        assert!(refused(&FILE.replace("k3=0", "k3=no")).contains("right_cam_vga.k3"));
        assert!(refused("").contains("stereo.baseline"));
        let mut other = base();
        other.camera[0].width_px = 640;
        assert!(zed_text_into(other, FILE, "SN1.conf").unwrap_err().to_string().contains("640"));
    }
}
