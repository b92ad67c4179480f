//! Kalibr: `camchain-imucam.yaml` and `imu.yaml`.
//!
//! `T_cam_imu` takes coordinates from the IMU to the camera, `T_CB`; the extrinsics here are its inverse.
//! A camera without it hangs on the one before: `T_cn_cnm1` takes coordinates from that to this, so
//! `T_C1B = T_cn_cnm1 T_C0B`. `timeshift_cam_imu` is `t_imu = t_cam + shift`, as [`RigConfig::time_offset_s`].
//!
//! [`RigConfig::time_offset_s`]: crate::options::RigConfig::time_offset_s

use super::yaml::{Document, Node};
use super::{Calibration, agree, distortion, is_identity, pinhole, rigid, size_px};
use crate::error::ConfigError;
use crate::options::{CameraConfig, Config, rows_from_isometry};
use crate::valid::ValidConfig;
use nalgebra::Isometry3;
use std::path::Path;

/// Camera rate of [`kalibr`]: the files do not tell it. A camera may say it by a key `rate_hz` of its own.
pub const DEFAULT_CAMERA_RATE_HZ: f64 = 20.0;
/// Largest difference of the time shifts of two cameras that expose together.
const MAX_SHIFT_DIFFERENCE_S: f64 = 0.001;

/// Calibration by Kalibr: the results of `kalibr_calibrate_imu_camera` and the noise file of the IMU (its
/// input, or the `imu-*.yaml` of its results). Noise densities are those of the file: see the
/// [module](super) on their inflation. The camera rate is [`DEFAULT_CAMERA_RATE_HZ`].
///
/// # Errors
/// When a file is missing, malformed, or its values are refused.
pub fn kalibr(camchain: impl AsRef<Path>, imu: impl AsRef<Path>) -> Result<ValidConfig, ConfigError> {
    let (camchain, imu) = (Document::read(camchain.as_ref())?, Document::read(imu.as_ref())?);
    convert(&camchain, &imu, DEFAULT_CAMERA_RATE_HZ)?.into_config().validated(camchain.origin())
}

/// `base` with the calibration by Kalibr: cameras, IMU rate and time offset are replaced; the camera rate,
/// the noise model and all else are kept.
///
/// # Errors
/// As [`kalibr`].
pub fn kalibr_into(
    base: impl Into<Config>,
    camchain: impl AsRef<Path>,
    imu: impl AsRef<Path>,
) -> Result<ValidConfig, ConfigError> {
    let (camchain, imu) = (Document::read(camchain.as_ref())?, Document::read(imu.as_ref())?);
    let base = base.into();
    let rate_hz = base.camera.first().map_or(DEFAULT_CAMERA_RATE_HZ, |camera| camera.rate_hz);
    convert(&camchain, &imu, rate_hz)?.put_into(base).validated(camchain.origin())
}

fn convert(camchain: &Document, imu: &Document, camera_rate_hz: f64) -> Result<Calibration, ConfigError> {
    let chain = camchain.root();
    check_exchanged(&chain, &imu.root())?;
    if let Some(third) = chain.optional("cam2") {
        return Err(third.refuse("is a third camera", "remove it: one camera or a stereo pair is used"));
    }
    let first = chain.get("cam0")?;
    check_overlaps(&chain, ["cam0", "cam1"])?;
    let pose_c0_b = transform(&first.get("T_cam_imu")?)?;
    let mut cameras = vec![camera(&first, &pose_c0_b, camera_rate_hz)?];
    let time_offset_s = shift(&first)?;
    if let Some(second) = chain.optional("cam1") {
        cameras.push(camera(&second, &chained(&second, &pose_c0_b)?, camera_rate_hz)?);
        check_shifts(&second, time_offset_s)?;
    }
    let (imu_rate_hz, noise) = inertial(&imu.root())?;
    Ok(Calibration { cameras, imu_rate_hz, noise, time_offset_s: Some(time_offset_s), mounting: None })
}

/// Refuses files that were given for each other.
fn check_exchanged(chain: &Node<'_>, imu: &Node<'_>) -> Result<(), ConfigError> {
    const CURE: &str = "are --camchain and --imu exchanged?";
    let is_imu = |root: &Node<'_>| root.optional("imu0").is_some() || root.optional("update_rate").is_some();
    if chain.optional("cam0").is_none() && is_imu(chain) {
        return Err(chain.refuse("is an imu.yaml, a camchain is expected", CURE));
    }
    if imu.optional("cam0").is_some() && !is_imu(imu) {
        return Err(imu.refuse("is a camchain, an imu.yaml is expected", CURE));
    }
    Ok(())
}

/// Refuses a file that names a camera which it lacks.
fn check_overlaps(chain: &Node<'_>, names: [&str; 2]) -> Result<(), ConfigError> {
    let overlaps = names.iter().filter_map(|name| chain.optional(name)?.optional("cam_overlaps"));
    for node in overlaps {
        for other in node.elements()? {
            let name = format!("cam{}", other.number()?);
            if chain.optional(&name).is_none() {
                let cure =
                    "is the file cut off? copy it again; for one camera alone, write `cam_overlaps: []`";
                return Err(node.refuse(format!("names {name}, which is missing"), cure));
            }
        }
    }
    Ok(())
}

fn transform(node: &Node<'_>) -> Result<Isometry3<f64>, ConfigError> {
    rigid(node, node.matrix()?)
}

/// `T_CB` of a camera that has one before it.
fn chained(camera: &Node<'_>, pose_before_b: &Isometry3<f64>) -> Result<Isometry3<f64>, ConfigError> {
    let own = camera.optional("T_cam_imu");
    let Some(link) = camera.optional("T_cn_cnm1") else {
        return transform(&camera.get("T_cam_imu")?);
    };
    let linked = transform(&link)? * pose_before_b;
    let Some(own) = own else { return Ok(linked) };
    let pose_c_b = transform(&own)?;
    if !agree(&pose_c_b, &linked) {
        let link = transform(&link)?;
        let is_inverted = agree(&pose_c_b.inverse(), &(link * pose_before_b.inverse()));
        let cure = if is_inverted || agree(&pose_c_b, &(link * pose_before_b.inverse())) {
            "probably T_cam_imu is inverted (T_imu_cam): inverting it makes the chain agree; T_cam_imu takes coordinates from \
             the IMU to the camera"
        } else {
            "export the calibration again"
        };
        return Err(own.refuse("contradicts T_cn_cnm1 and cam0.T_cam_imu", cure));
    }
    Ok(pose_c_b)
}

fn shift(camera: &Node<'_>) -> Result<f64, ConfigError> {
    camera.optional("timeshift_cam_imu").map_or(Ok(0.0), |node| node.number())
}

fn check_shifts(second: &Node<'_>, first_shift_s: f64) -> Result<(), ConfigError> {
    let Some(node) = second.optional("timeshift_cam_imu") else { return Ok(()) };
    if (node.number()? - first_shift_s).abs() > MAX_SHIFT_DIFFERENCE_S {
        let reason = format!("differs from cam0's by more than {MAX_SHIFT_DIFFERENCE_S} s");
        return Err(node.refuse(reason, "trigger both cameras together and calibrate again"));
    }
    Ok(())
}

fn camera(node: &Node<'_>, pose_c_b: &Isometry3<f64>, rate_hz: f64) -> Result<CameraConfig, ConfigError> {
    let [width_px, height_px] = size_px(node)?;
    let (focal_px, centre_px) = pinhole(node)?;
    Ok(CameraConfig {
        width_px,
        height_px,
        rate_hz: node.optional("rate_hz").map_or(Ok(rate_hz), |own| own.number())?,
        readout_s: 0.0,
        exposure_s: 0.0,
        mask: None,
        focal_px,
        centre_px,
        distortion: distortion(node, "distortion_coeffs")?,
        pose_b_c: rows_from_isometry(&pose_c_b.inverse()),
    })
}

fn inertial(root: &Node<'_>) -> Result<(f64, [f64; 4]), ConfigError> {
    // The input file is flat, the result has the same under `imu0`.
    let imu0 = root.optional("imu0");
    let imu = imu0.as_ref().unwrap_or(root);
    if let Some(model) = imu.optional("model")
        && model.text()? != "calibrated"
    {
        let cure = "calibrate with `--imu-models calibrated`: intrinsics of the IMU are not applied here";
        return Err(model.refuse("is another model than `calibrated`", cure));
    }
    if let Some(pose) = imu.optional("T_i_b")
        && !is_identity(&transform(&pose)?)
    {
        return Err(pose.refuse("is not the identity", "use the file of imu0, the reference"));
    }
    let number = |key| imu.get(key)?.number();
    let positive = |key| {
        let node = imu.get(key)?;
        let value = node.number()?;
        if value > 0.0 {
            return Ok(value);
        }
        Err(node.refuse(
            format!("is {value}"),
            "give the value of the IMU's data sheet or of an Allan plot; none is 0",
        ))
    };
    let noise = [
        positive("gyroscope_noise_density")?,
        positive("gyroscope_random_walk")?,
        positive("accelerometer_noise_density")?,
        positive("accelerometer_random_walk")?,
    ];
    Ok((number("update_rate")?, noise))
}

/// Reads texts instead of files; for tests that never touch the disk.
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) fn from_texts(camchain: &str, imu: &str) -> Result<ValidConfig, ConfigError> {
    let (camchain, imu) = (Document::parse(camchain, "camchain.yaml")?, Document::parse(imu, "imu.yaml")?);
    convert(&camchain, &imu, DEFAULT_CAMERA_RATE_HZ)?.into_config().validated("camchain.yaml")
}
