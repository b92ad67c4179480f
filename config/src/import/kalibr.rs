//! Kalibr: `camchain-imucam.yaml` and `imu.yaml`.
//!
//! `T_cam_imu` takes coordinates from the IMU to the camera, `T_CB`; the extrinsics here are its inverse.
//! A camera without it hangs on the one before: `T_cn_cnm1` takes coordinates from that to this, so
//! `T_C1B = T_cn_cnm1 T_C0B`. OpenVINS writes `T_imu_cam`, the inverse of `T_cam_imu`, and intrinsics of the IMU that are
//! neutral where it does not apply them; both are taken. `timeshift_cam_imu` is `t_imu = t_cam + shift`, as [`RigConfig::time_offset_s`].
//!
//! [`RigConfig::time_offset_s`]: crate::options::RigConfig::time_offset_s

use super::file::{At, File};
use super::lens::Camera;
use super::{Calibration, Import, Matrix, agree, is_identity, rate_of};
use crate::error::ConfigError;
use crate::options::Config;
use nalgebra::Isometry3;
use serde::Deserialize;
use std::path::Path;

/// Largest difference of the time shifts of two cameras that expose together.
const MAX_SHIFT_DIFFERENCE_S: f64 = 0.001;
/// Names of the two files in messages.
const CAMCHAIN: &str = "Kalibr's camchain-imucam.yaml";
const IMU: &str = "Kalibr's imu.yaml";

/// Keys by which a file of Kalibr is known, cut off or not.
const KEYS: [&str; 7] = ["cam0", "cam1", "imu0", "update_rate", "accelerometer_*", "gyroscope_*", "rostopic"];

#[derive(Deserialize)]
struct Chain {
    cam0: Camera,
    cam1: Option<Camera>,
}

#[derive(Deserialize)]
struct ImuResult {
    imu0: Imu,
}

#[derive(Deserialize)]
struct Imu {
    update_rate: f64,
    gyroscope_noise_density: f64,
    gyroscope_random_walk: f64,
    accelerometer_noise_density: f64,
    accelerometer_random_walk: f64,
    model: Option<String>,
    #[serde(rename = "T_i_b")]
    pose_i_b: Option<Matrix<4>>,
    #[serde(rename = "Tw")]
    gyro: Option<Matrix<3>>,
    #[serde(rename = "Ta")]
    accel: Option<Matrix<3>>,
    #[serde(rename = "R_IMUtoGYRO")]
    to_gyro: Option<Matrix<3>>,
    #[serde(rename = "R_IMUtoACC")]
    to_accel: Option<Matrix<3>>,
    #[serde(rename = "Tg")]
    by_gravity: Option<Matrix<3>>,
    #[serde(default)]
    gyroscopes: Intrinsics,
    #[serde(default)]
    accelerometers: Intrinsics,
}

/// Intrinsics that Kalibr writes.
#[derive(Default, Deserialize)]
struct Intrinsics {
    #[serde(rename = "M")]
    scale: Option<Matrix<3>>,
    #[serde(rename = "C_gyro_i")]
    to_gyro: Option<Matrix<3>>,
    #[serde(rename = "A")]
    by_gravity: Option<Matrix<3>>,
}

pub(super) fn read(base: Config, camchain: &Path, imu: &Path) -> Result<Import, ConfigError> {
    convert(base, &File::read(camchain)?, &File::read(imu)?)
}

pub(super) fn convert(base: Config, camchain: &File, imu: &File) -> Result<Import, ConfigError> {
    let is_imu = |file: &File| file.has("imu0") || file.has("update_rate");
    let is_exchanged = [!camchain.has("cam0") && is_imu(camchain), imu.has("cam0") && !is_imu(imu)];
    for (i, (file, expected)) in [(camchain, CAMCHAIN), (imu, IMU)].into_iter().enumerate() {
        if is_exchanged[i] {
            let reason = format!("is the other file, {expected} is expected");
            return Err(file.refuse("(file)", reason, "are --camchain and --imu exchanged?"));
        }
        // A file of Kalibr with more in it is still one.
        if !KEYS.iter().any(|key| file.has(key)) {
            return Err(file.other(expected));
        }
    }
    let (imu_rate_hz, noise) = inertial(imu)?;
    let (cameras, shift_s) = cameras(camchain, rate_of(&base))?;
    let calibration =
        Calibration { cameras, imu_rate_hz, noise, time_offset_s: Some(shift_s), mounting: None };
    calibration.put_into(base, &format!("{}, {}", camchain.origin, imu.origin))
}

/// Cameras of a chain, and their time shift, s.
fn cameras(file: &File, rate_hz: f64) -> Result<(Vec<crate::options::CameraConfig>, f64), ConfigError> {
    if file.has("cam2") {
        return Err(file.refuse(
            "cam2",
            "is a third camera",
            "remove it: one camera or a stereo pair is used",
        ));
    }
    let Chain { cam0, cam1 } = file.get()?;
    let [first, second] = ["cam0.", "cam1."].map(|path| At { file, path });
    for (at, camera) in [(first, Some(&cam0)), (second, cam1.as_ref())] {
        let overlaps = camera.map_or(&[][..], |camera| &camera.cam_overlaps);
        if let Some(missing) = overlaps.iter().find(|index| !file.has(&format!("cam{index}"))) {
            let cure = "is the file cut off? copy it again; for one camera alone, write `cam_overlaps: []`";
            return Err(at.refuse("cam_overlaps", format!("names cam{missing}, which is missing"), cure));
        }
    }
    let pose_c0_b = own_pose(&first, &cam0)?.ok_or_else(|| {
        let cure = "if this is camchain.yaml of kalibr_calibrate_cameras, give camchain-imucam.yaml of kalibr_calibrate_imu_camera; \
                    otherwise add it";
        first.refuse("T_cam_imu", "missing", cure)
    })?;
    let rate = |camera: &Camera| camera.rate_hz.unwrap_or(rate_hz);
    let mut cameras = vec![cam0.config(&first, rate(&cam0), &pose_c0_b.inverse())?];
    let shift_s = cam0.timeshift_cam_imu.unwrap_or(0.0);
    if let Some(cam1) = cam1 {
        let pose_c1_b = chained(&second, &cam1, &pose_c0_b)?;
        cameras.push(cam1.config(&second, rate(&cam1), &pose_c1_b.inverse())?);
        if cam1.timeshift_cam_imu.is_some_and(|shift| (shift - shift_s).abs() > MAX_SHIFT_DIFFERENCE_S) {
            let reason = format!("differs from cam0's by more than {MAX_SHIFT_DIFFERENCE_S} s");
            let cure = "trigger both cameras together and calibrate again";
            return Err(second.refuse("timeshift_cam_imu", reason, cure));
        }
    }
    Ok((cameras, shift_s))
}

/// `T_CB` of a camera as it states it: `T_cam_imu`, or its inverse `T_imu_cam`, as in files of OpenVINS.
fn own_pose(at: &At<'_>, camera: &Camera) -> Result<Option<Isometry3<f64>>, ConfigError> {
    let forward = camera.pose_c_b.as_ref().map(|rows| at.rigid("T_cam_imu", rows)).transpose()?;
    let backward = camera.pose_b_c.as_ref().map(|rows| at.rigid("T_imu_cam", rows)).transpose()?;
    match (forward, backward.map(|pose| pose.inverse())) {
        (Some(forward), Some(backward)) if !agree(&forward, &backward) => {
            Err(at.refuse("T_imu_cam", "is not the inverse of T_cam_imu", "leave one of them out"))
        }
        (forward, backward) => Ok(forward.or(backward)),
    }
}

/// `T_CB` of a camera that has one before it.
fn chained(
    at: &At<'_>,
    camera: &Camera,
    pose_before_b: &Isometry3<f64>,
) -> Result<Isometry3<f64>, ConfigError> {
    let own = own_pose(at, camera)?;
    let link = camera.pose_c_before.as_ref().map(|rows| at.rigid("T_cn_cnm1", rows)).transpose()?;
    match (own, link) {
        (None, None) => {
            let cure = "add it, or T_cn_cnm1, the pose of this camera from the one before";
            Err(at.refuse("T_cam_imu", "missing", cure))
        }
        (None, Some(link)) => Ok(link * pose_before_b),
        (Some(own), Some(link)) if !agree(&own, &(link * pose_before_b)) => {
            let cure = "export the calibration again; T_cam_imu takes coordinates from the IMU to the camera";
            let key = if camera.pose_c_b.is_some() { "T_cam_imu" } else { "T_imu_cam" };
            Err(at.refuse(key, "contradicts T_cn_cnm1 and cam0.T_cam_imu", cure))
        }
        (Some(own), _) => Ok(own),
    }
}

/// Digits of a matrix that is written by hand or by a program.
const NEUTRAL: f64 = 1e-6;

/// Refuses intrinsics of the IMU, which are not applied here, unless they change nothing: such a file is one of a calibrated IMU,
/// whatever it calls its model.
fn check_model(at: &At<'_>, imu: &Imu) -> Result<(), ConfigError> {
    const CURE: &str = "calibrate with `--imu-models calibrated`: intrinsics of the IMU are not applied here; correct the samples before";
    let (gyro, accel) = (&imu.gyroscopes, &imu.accelerometers);
    let stated = [
        ("Tw", &imu.gyro, 1.0),
        ("Ta", &imu.accel, 1.0),
        ("R_IMUtoGYRO", &imu.to_gyro, 1.0),
        ("R_IMUtoACC", &imu.to_accel, 1.0),
        ("Tg", &imu.by_gravity, 0.0),
        ("gyroscopes.M", &gyro.scale, 1.0),
        ("gyroscopes.C_gyro_i", &gyro.to_gyro, 1.0),
        ("gyroscopes.A", &gyro.by_gravity, 0.0),
        ("accelerometers.M", &accel.scale, 1.0),
    ];
    for (key, matrix, diagonal) in stated {
        let Some(Matrix(rows)) = matrix else { continue };
        let neutral = |k: usize| if k.is_multiple_of(4) { diagonal } else { 0.0 };
        if (0..9).any(|k| (rows[k / 3][k % 3] - neutral(k)).abs() > NEUTRAL) {
            let what = if diagonal == 1.0 { "identity" } else { "zero matrix" };
            return Err(at.refuse(key, format!("{key} is not the {what}"), CURE));
        }
    }
    let is_stated = stated.iter().any(|(_, matrix, _)| matrix.is_some());
    match imu.model.as_deref() {
        // OpenVINS takes the matrices of its models for neutral where they are left out.
        None | Some("calibrated" | "kalibr" | "rpng") => Ok(()),
        Some(_) if is_stated => Ok(()),
        Some(_) => Err(at.refuse("model", "is another model than `calibrated`", CURE)),
    }
}

fn inertial(file: &File) -> Result<(f64, [f64; 4]), ConfigError> {
    // The input file is flat, the result has the same under `imu0`.
    let (imu, path): (Imu, _) = match file.has("imu0") {
        true => (file.get::<ImuResult>()?.imu0, "imu0."),
        false => (file.get()?, ""),
    };
    let at = At { file, path };
    check_model(&at, &imu)?;
    if let Some(pose) = &imu.pose_i_b
        && !is_identity(&at.rigid("T_i_b", pose)?)
    {
        return Err(at.refuse("T_i_b", "is not the identity", "use the file of imu0, the reference"));
    }
    let noise = [
        imu.gyroscope_noise_density,
        imu.gyroscope_random_walk,
        imu.accelerometer_noise_density,
        imu.accelerometer_random_walk,
    ];
    Ok((imu.update_rate, noise))
}
