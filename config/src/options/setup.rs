//! Setup of the estimator alone, without anything of drivers, network, autopilot or recorder.

use super::{CameraConfig, EstimatorConfig, ImuConfig, RigConfig};
use serde::{Deserialize, Serialize};

/// Everything that an estimate depends on but the samples: the tables `[[camera]]`, `[imu]`, `[rig]` and
/// `[estimator...]` of a configuration file. Raw: [`Self::validate`] makes the
/// [`ValidSetup`](crate::ValidSetup) that an estimator is built from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EstimatorSetup {
    /// One or two cameras: `camera[0]` is left (`C0`), `camera[1]` right (`C1`).
    pub camera: Vec<CameraConfig>,
    /// The inertial sensor, whose frame is the body frame `B`.
    pub imu: ImuConfig,
    /// Uncertainty of the extrinsics of the sensors.
    #[serde(default)]
    pub rig: RigConfig,
    /// Capacities and thresholds.
    #[serde(default)]
    pub estimator: EstimatorConfig,
}

impl EstimatorSetup {
    /// These sensors, and the defaults for all else.
    pub fn new(camera: Vec<CameraConfig>, imu: ImuConfig) -> Self {
        Self { camera, imu, rig: RigConfig::default(), estimator: EstimatorConfig::default() }
    }
}
