//! The configuration as plain typed data: what one TOML file says.
//!
//! Units stand in the names; every field is required unless it has a default written here. Loading,
//! validation and importers are in their own modules. The presets document the same fields for users;
//! tests hold both together.
//!
//! [`EstimatorSetup`] is what the estimator alone needs, [`Config`] what a whole vehicle needs. Both are raw: what
//! is flown with is a [`ValidSetup`](crate::ValidSetup) or a [`ValidConfig`](crate::ValidConfig).

mod autopilot;
mod estimator;
mod frames;
mod imu_driver;
mod lines;
mod local;
mod mask;
mod network;
mod places;
mod recorder;
mod ros;
mod runtime;
mod sensors;
mod serial_line;
mod setup;
mod v4l2;
mod vehicle;

pub use autopilot::{AutopilotClock, AutopilotConfig, AutopilotEndpoint, FlowMessages, LostPose};
pub use estimator::{EstimatorConfig, HealthConfig, InitialConfig, PointsConfig, WindowConfig};
pub use frames::FramesConfig;
pub use imu_driver::{ImuDriverConfig, ImuEndpoint, ImuProtocol, MavlinkImu, TriggerExposure};
pub use lines::LinesConfig;
pub use local::LocalConfig;
pub use mask::{MAX_MASK_RUNS, Mask, PixelMask};
pub use network::{Commands, Link, LoginConfig, NetworkConfig, TlsConfig, is_certificate_name};
pub use places::PlacesConfig;
pub use recorder::{ImageRecording, KeepPolicy, RecorderConfig};
pub use ros::{RosConfig, RosDistribution, RosPictures, RosStamp};
pub use runtime::RuntimeConfig;
pub use sensors::{CameraConfig, ImuConfig, RigConfig, image_sizes, isometry_from_rows, rows_from_isometry};
pub use serial_line::SerialLine;
pub use setup::EstimatorSetup;
pub use v4l2::{ControlTarget, PairBy, V4l2Config, V4l2Control, V4l2Format};
pub use vehicle::{Mounting, VehicleConfig};

use serde::{Deserialize, Serialize};

/// Everything Plumbline needs to know before the first sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// One or two cameras: `camera[0]` is left (`C0`), `camera[1]` right (`C1`).
    pub camera: Vec<CameraConfig>,
    /// The inertial sensor.
    pub imu: ImuConfig,
    /// How well the extrinsics of the sensors are known.
    #[serde(default)]
    pub rig: RigConfig,
    /// Capacities and thresholds of the estimator.
    #[serde(default)]
    pub estimator: EstimatorConfig,
    /// Sources of frames and samples.
    #[serde(default)]
    pub driver: DriverConfig,
    /// Socket for programs of this computer.
    #[serde(default)]
    pub local: LocalConfig,
    /// Publication over Zenoh.
    #[serde(default)]
    pub network: NetworkConfig,
    /// Publication to ROS 2.
    #[serde(default)]
    pub ros: RosConfig,
    /// Requests of a live run to the host.
    #[serde(default)]
    pub runtime: RuntimeConfig,
    /// Contents and limits of the flight recording.
    #[serde(default)]
    pub recorder: RecorderConfig,
    /// How the IMU is mounted in the vehicle.
    #[serde(default)]
    pub vehicle: VehicleConfig,
    /// Odometry for the vehicle's autopilot.
    #[serde(default)]
    pub autopilot: AutopilotConfig,
}

impl Config {
    /// These sensors, and the defaults for all else.
    #[must_use]
    pub fn with_defaults(camera: Vec<CameraConfig>, imu: ImuConfig) -> Self {
        Self {
            camera,
            imu,
            rig: RigConfig::default(),
            estimator: EstimatorConfig::default(),
            driver: DriverConfig::default(),
            local: LocalConfig::default(),
            network: NetworkConfig::default(),
            ros: RosConfig::default(),
            runtime: RuntimeConfig::default(),
            recorder: RecorderConfig::default(),
            vehicle: VehicleConfig::default(),
            autopilot: AutopilotConfig::default(),
        }
    }

    /// The part that concerns the estimator: cameras, IMU, rig, capacities and thresholds.
    #[must_use]
    pub fn setup(&self) -> EstimatorSetup {
        EstimatorSetup {
            camera: self.camera.clone(),
            imu: self.imu.clone(),
            rig: self.rig.clone(),
            estimator: self.estimator.clone(),
        }
    }
}

/// Where samples come from when none is named on the command line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DriverConfig {
    /// Stereo pairs decoded or rendered ahead of need.
    pub image_queue: usize,
    /// Largest difference of stamps within a stereo pair, s.
    pub pair_tolerance_s: f64,
    /// The inertial sensor.
    pub imu: ImuDriverConfig,
    /// Cameras of the Linux kernel.
    pub v4l2: V4l2Config,
    /// Frames of a program of the user's own.
    pub frames: FramesConfig,
}

impl Default for DriverConfig {
    fn default() -> Self {
        Self {
            image_queue: 4,
            pair_tolerance_s: 0.002,
            imu: ImuDriverConfig::default(),
            v4l2: V4l2Config::default(),
            frames: FramesConfig::default(),
        }
    }
}
