//! Kalibr: `camchain-imucam.yaml` and `imu.yaml`.
//!
//! `T_cam_imu` takes coordinates from the IMU to the camera, `T_CB`; the extrinsics here are its inverse.
//! A camera without it hangs on the one before: `T_cn_cnm1` takes coordinates from that to this, so
//! `T_C1B = T_cn_cnm1 T_C0B`. OpenVINS writes `T_imu_cam`, the inverse of `T_cam_imu`, and intrinsics of the IMU that are
//! neutral where it does not apply them; both are taken. `timeshift_cam_imu` is `t_imu = t_cam + shift`, as [`RigConfig::time_offset_s`].
//!
//! [`RigConfig::time_offset_s`]: crate::options::RigConfig::time_offset_s

use super::whose;
use super::yaml::{Document, Node};
use super::{Calibration, agree, camera_of, is_identity, lens, rigid, size_px};
use crate::error::ConfigError;
use crate::options::{CameraConfig, Config};
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
    let (camchain, imu) = (whose::read(camchain.as_ref(), CAMCHAIN)?, whose::read(imu.as_ref(), IMU)?);
    let config = convert(&camchain, &imu, DEFAULT_CAMERA_RATE_HZ)?.into_config();
    config.validated(camchain.origin()).map_err(|error| by_file(error, &camchain, &imu))
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
    let (camchain, imu) = (whose::read(camchain.as_ref(), CAMCHAIN)?, whose::read(imu.as_ref(), IMU)?);
    let base = base.into();
    let rate_hz = base.camera.first().map_or(DEFAULT_CAMERA_RATE_HZ, |camera| camera.rate_hz);
    let config = convert(&camchain, &imu, rate_hz)?.put_into(base);
    config.validated(camchain.origin()).map_err(|error| by_file(error, &camchain, &imu))
}

/// Calibration of both files.
pub(super) fn read(camchain: &Path, imu: &Path, camera_rate_hz: f64) -> Result<Calibration, ConfigError> {
    let (camchain, imu) = (whose::read(camchain, CAMCHAIN)?, whose::read(imu, IMU)?);
    convert(&camchain, &imu, camera_rate_hz)
}

/// Names of values in the files, by their keys in the configuration.
const IN_IMU: [(&str, &str); 5] = [
    ("imu.rate_hz", "update_rate"),
    ("imu.gyro_noise_density", "gyroscope_noise_density"),
    ("imu.gyro_bias_walk", "gyroscope_random_walk"),
    ("imu.accel_noise_density", "accelerometer_noise_density"),
    ("imu.accel_bias_walk", "accelerometer_random_walk"),
];
const IN_CAMERA: [(&str, &str); 9] = [
    ("distortion.xi", "intrinsics"),
    ("distortion.alpha", "intrinsics"),
    ("distortion.beta", "intrinsics"),
    ("width_px", "resolution"),
    ("height_px", "resolution"),
    ("focal_px", "intrinsics"),
    ("centre_px", "intrinsics"),
    ("distortion", "distortion_coeffs"),
    ("pose_b_c", "T_cam_imu"),
];

/// `error` of the configuration that was made of both files, said of the file and key that each value is from.
fn by_file(error: ConfigError, camchain: &Document, imu: &Document) -> ConfigError {
    let ConfigError::Invalid { origin, mut violations } = error else { return error };
    let mut is_of_imu = Vec::new();
    for violation in &mut violations {
        let key = violation.key.clone();
        if let Some((_, name)) = IN_IMU.iter().find(|(ours, _)| *ours == key) {
            violation.key = (*name).to_owned();
            is_of_imu.push(true);
            continue;
        }
        is_of_imu.push(false);
        let of_camera = key.strip_prefix("camera[").and_then(|rest| rest.split_once("]."));
        let theirs = of_camera.and_then(|(index, rest)| {
            let (_, name) = IN_CAMERA.iter().find(|(ours, _)| rest.starts_with(ours))?;
            Some(format!("cam{index}.{name}"))
        });
        violation.key = theirs.unwrap_or(key);
    }
    let origin = match (is_of_imu.contains(&true), is_of_imu.contains(&false)) {
        (true, false) => imu.origin().to_owned(),
        (true, true) => format!("{}, {}", camchain.origin(), imu.origin()),
        _ => origin,
    };
    ConfigError::Invalid { origin, violations }
}

/// Names of the two files in messages.
const CAMCHAIN: &str = "Kalibr's camchain-imucam.yaml";
const IMU: &str = "Kalibr's imu.yaml";

fn convert(camchain: &Document, imu: &Document, camera_rate_hz: f64) -> Result<Calibration, ConfigError> {
    let chain = camchain.root();
    check_exchanged(&chain, &imu.root())?;
    whose::check(camchain, CAMCHAIN)?;
    whose::check(imu, IMU)?;
    if let Some(third) = chain.optional("cam2") {
        return Err(third.refuse("is a third camera", "remove it: one camera or a stereo pair is used"));
    }
    let first = chain.get("cam0")?;
    check_overlaps(&chain, ["cam0", "cam1"])?;
    let Some((_, pose_c0_b)) = own_pose(&first)? else {
        let cure = "if this is camchain.yaml of kalibr_calibrate_cameras, give camchain-imucam.yaml of kalibr_calibrate_imu_camera; \
                    otherwise add it";
        return Err(missing_pose(&first, cure));
    };
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

/// `T_CB` of a camera as it states it, and where: `T_cam_imu`, or its inverse `T_imu_cam`, as in files of OpenVINS.
fn own_pose<'a>(camera: &Node<'a>) -> Result<Option<(Node<'a>, Isometry3<f64>)>, ConfigError> {
    let forward = camera.optional("T_cam_imu").map(|node| transform(&node).map(|pose| (node, pose)));
    let backward =
        camera.optional("T_imu_cam").map(|node| transform(&node).map(|pose| (node, pose.inverse())));
    match (forward.transpose()?, backward.transpose()?) {
        (Some(forward), Some((node, pose))) if !agree(&forward.1, &pose) => {
            Err(node.refuse("is not the inverse of T_cam_imu", "leave one of them out"))
        }
        (forward, backward) => Ok(forward.or(backward)),
    }
}

fn missing_pose(camera: &Node<'_>, cure: &str) -> ConfigError {
    let node = camera.child("T_cam_imu");
    node.refuse("missing", cure)
}

/// `T_CB` of a camera that has one before it.
fn chained(camera: &Node<'_>, pose_before_b: &Isometry3<f64>) -> Result<Isometry3<f64>, ConfigError> {
    let own = own_pose(camera)?;
    let Some(link) = camera.optional("T_cn_cnm1") else {
        let cure = "add it, or T_cn_cnm1, the pose of this camera from the one before";
        return own.map(|(_, pose)| pose).ok_or_else(|| missing_pose(camera, cure));
    };
    let linked = transform(&link)? * pose_before_b;
    let Some((own, pose_c_b)) = own else { return Ok(linked) };
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
    let size = size_px(node)?;
    let rate_hz = node.optional("rate_hz").map_or(Ok(rate_hz), |own| own.number())?;
    let lens = lens::kalibr(node, "distortion_coeffs")?;
    Ok(camera_of(lens, size, rate_hz, &pose_c_b.inverse()))
}

/// Intrinsics of the IMU that OpenVINS and Kalibr write, and whether the neutral value is the identity (else zero). Where an entry
/// is within another table, that comes first.
const INTRINSICS: [(&str, &str, bool); 9] = [
    ("", "Tw", true),
    ("", "Ta", true),
    ("", "R_IMUtoGYRO", true),
    ("", "R_IMUtoACC", true),
    ("", "Tg", false),
    ("gyroscopes", "M", true),
    ("gyroscopes", "C_gyro_i", true),
    ("gyroscopes", "A", false),
    ("accelerometers", "M", true),
];
/// Digits of a matrix that is written by hand or by a program.
const NEUTRAL: f64 = 1e-6;

/// Refuses intrinsics of the IMU, which are not applied here, unless they change nothing: such a file is one of a calibrated IMU,
/// whatever it calls its model.
fn check_model(imu: &Node<'_>) -> Result<(), ConfigError> {
    const CURE: &str = "calibrate with `--imu-models calibrated`: intrinsics of the IMU are not applied here; correct the samples before";
    let mut is_stated = false;
    for (table, name, is_identity) in INTRINSICS {
        let place = if table.is_empty() { None } else { Some(imu.optional(table)) };
        let Some(node) = place.map_or_else(|| imu.optional(name), |table| table?.optional(name)) else {
            continue;
        };
        is_stated = true;
        let rows = node.matrix3()?;
        let neutral = |i: usize, j: usize| if is_identity && i == j { 1.0 } else { 0.0 };
        let is_neutral = (0..9).all(|k| (rows[k / 3][k % 3] - neutral(k / 3, k % 3)).abs() <= NEUTRAL);
        if !is_neutral {
            let what = if is_identity { "identity" } else { "zero matrix" };
            return Err(node.refuse(format!("{name} is not the {what}"), CURE));
        }
    }
    match imu.optional("model") {
        // OpenVINS takes the matrices of its models for neutral where they are left out.
        Some(model) if !is_stated && !["calibrated", "kalibr", "rpng"].contains(&model.text()?) => {
            Err(model.refuse("is another model than `calibrated`", CURE))
        }
        _ => Ok(()),
    }
}

fn inertial(root: &Node<'_>) -> Result<(f64, [f64; 4]), ConfigError> {
    // The input file is flat, the result has the same under `imu0`.
    let imu0 = root.optional("imu0");
    let imu = imu0.as_ref().unwrap_or(root);
    check_model(imu)?;
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
    let (camchain, imu) =
        (whose::parse(camchain, "camchain.yaml", CAMCHAIN)?, whose::parse(imu, "imu.yaml", IMU)?);
    let config = convert(&camchain, &imu, DEFAULT_CAMERA_RATE_HZ)?.into_config();
    config.validated(camchain.origin()).map_err(|error| by_file(error, &camchain, &imu))
}
