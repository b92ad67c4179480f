//! Calibrations of other programs, told apart by their keys.

use super::file::File;
use super::{Import, basalt, kalibr, orb_slam, rate_of, vins};
use crate::error::ConfigError;
use crate::options::Config;
use serde::Deserialize;
use std::path::Path;

/// Files in a folder of TUM-VI.
const TUM_VI: [&str; 2] = ["dso/camchain.yaml", "dso/imu_config.yaml"];
const EXPECTED: &str = "a calibration of Basalt (JSON), a configuration of VINS-Fusion, VINS-Mono or OpenVINS \
                        (estimator_config.yaml), settings of ORB-SLAM3, or a folder of TUM-VI (dso/camchain.yaml and \
                        dso/imu_config.yaml in it)";

/// Cameras and IMU that a configuration of OpenVINS names.
#[derive(Deserialize)]
struct OpenVins {
    relative_config_imucam: String,
    relative_config_imu: String,
}

pub(super) fn read(base: Config, path: &Path) -> Result<Import, ConfigError> {
    let open_vins = path.join("estimator_config.yaml");
    if open_vins.is_file() {
        return read(base, &open_vins);
    }
    if path.is_dir() {
        let [chain, imu] = TUM_VI.map(|name| path.join(name));
        if !chain.is_file() {
            return Err(super::no_calibration(path, EXPECTED));
        }
        return kalibr::read(base, &chain, &imu);
    }
    let file = File::read(path)?;
    let beside = |name: &Path| path.parent().unwrap_or(Path::new("")).join(name);
    if file.has("relative_config_imu") {
        let named: OpenVins = file.get()?;
        let [chain, imu] = [named.relative_config_imucam, named.relative_config_imu];
        return kalibr::read(base, &beside(chain.as_ref()), &beside(imu.as_ref()));
    }
    convert(base, &file, |name| File::read(&beside(name)))
}

pub(super) fn convert(
    base: Config,
    file: &File,
    read: impl Fn(&Path) -> Result<File, ConfigError>,
) -> Result<Import, ConfigError> {
    let calibration = if file.has("value0") {
        basalt::convert(file, rate_of(&base))?
    } else if ["cam0_calib", "body_T_cam0", "extrinsicRotation"].iter().any(|key| file.has(key)) {
        vins::convert(file, &base, read)?
    } else if file.has("Camera.type") {
        orb_slam::convert(file)?
    } else if file.has("cam0") || file.has("imu0") {
        return Err(file.refuse("(file)", "is Kalibr's", "give its two files with --camchain and --imu"));
    } else {
        return Err(file.other(EXPECTED));
    };
    calibration.put_into(base, &file.origin)
}
