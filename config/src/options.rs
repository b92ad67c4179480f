//! The configuration as plain typed data: what one TOML file says.
//!
//! Units stand in the names. A key is declared at its field, once: `#[key(...)]` has its default (without one it is required),
//! range and unit, and the comment is what users read ([`plumbline_keys::keys`]). Loading, rules for several keys, and importers are
//! in their own modules.
//!
//! [`EstimatorSetup`] is what the estimator alone needs, [`Config`] what a whole vehicle needs. Both are raw: what
//! is flown with is a [`ValidSetup`](crate::ValidSetup) or a [`ValidConfig`](crate::ValidConfig).

mod autopilot;
mod estimator;
mod imu_driver;
mod mask;
mod network;
mod recorder;
mod ros;
mod runtime;
mod sensors;
mod serial_line;
mod sockets;
mod v4l2;
mod vehicle;

pub use autopilot::{AutopilotClock, AutopilotConfig, AutopilotEndpoint, FlowMessages, LostPose};
pub use estimator::{EstimatorConfig, HealthConfig, LinesConfig, PlacesConfig, PointsConfig, WindowConfig};
pub use imu_driver::{ImuDriverConfig, ImuEndpoint, ImuProtocol, MavlinkImu};
pub use mask::{MAX_MASK_RUNS, Mask, PixelMask};
pub use network::{CommandAccess, Link, NetworkConfig, TlsConfig, is_certificate_name};
pub use recorder::{ImageRecording, KeepPolicy, RecorderConfig};
pub use ros::{RosConfig, RosDistribution, RosStamp};
pub use runtime::RuntimeConfig;
pub use sensors::{CameraConfig, ImuConfig, RigConfig, image_sizes, isometry_from_rows, rows_from_isometry};
pub use serial_line::SerialLine;
pub use sockets::{FramesConfig, LocalConfig};
pub use v4l2::{ControlTarget, PairBy, V4l2Config, V4l2Control, V4l2Format};
pub use vehicle::{Mounting, UnknownMounting, VehicleConfig};

use plumbline_keys::keys;

/// Everything Plumbline needs to know before the first sample.
#[keys]
pub struct Config {
    /// The cameras: one `[[camera]]` (monocular) or two (stereo, left first).
    #[key]
    pub camera: Vec<CameraConfig>,
    /// The inertial sensor, whose frame is the body frame B. Noise densities of a data sheet hold for a sensor at rest: for
    /// flight, white noise is inflated by about ten, because vibration, scale errors and sampling increase it.
    #[key]
    pub imu: ImuConfig,
    /// Uncertainty of the calibration, one standard deviation for each quantity: the priors of the online refinement. Zero
    /// disables the refinement of that quantity. The defaults
    /// are loose: they fit a calibration that comes from a data sheet. If the priors are too loose, the refinement attributes
    /// errors of the inertial sensor to the calibration.
    #[key(default)]
    pub rig: RigConfig,
    /// Capacities and thresholds of the estimator.
    #[key(default)]
    pub estimator: EstimatorConfig,
    /// The sources of frames and samples.
    #[key(default)]
    pub driver: DriverConfig,
    /// Socket for programs of this computer: odometry, estimates and more (docs/local-socket.md).
    #[key(default)]
    pub local: LocalConfig,
    /// Publication over Zenoh. By default there is no listener.
    #[key(default)]
    pub network: NetworkConfig,
    /// Publication to ROS 2, compatible with rmw_zenoh: `odom` (nav_msgs/Odometry), `pose` (geometry_msgs/PoseStamped) and /tf.
    #[key(default)]
    pub ros: RosConfig,
    /// Requests of a live run to the host. If the host refuses one, this is logged and the run continues without it.
    #[key(default)]
    pub runtime: RuntimeConfig,
    /// Contents and limits of the flight recording.
    #[key(default)]
    pub recorder: RecorderConfig,
    /// Mounting of the IMU in the vehicle. It determines the attitude that ground station, autopilot and ROS 2 receive. The
    /// estimate does not depend on it.
    #[key(default)]
    pub vehicle: VehicleConfig,
    /// Odometry for the vehicle's autopilot (PX4, ArduPilot), by MAVLink.
    #[key(default)]
    pub autopilot: AutopilotConfig,
}

impl Config {
    /// Mounting for ROS 2, where that is served.
    ///
    /// # Errors
    /// When it is, and the mounting is unknown.
    pub fn ros_rot_v_b(&self) -> Result<Option<nalgebra::UnitQuaternion<f64>>, UnknownMounting> {
        let rot_v_b = || self.vehicle.rot_v_b().ok_or(UnknownMounting("ROS 2 (ros.enabled)"));
        self.ros.enabled.then(rot_v_b).transpose()
    }

    /// The part that concerns the estimator: cameras, IMU, rig, capacities and thresholds.
    pub fn setup(&self) -> EstimatorSetup {
        EstimatorSetup {
            camera: self.camera.clone(),
            imu: self.imu.clone(),
            rig: self.rig.clone(),
            estimator: self.estimator.clone(),
        }
    }
}

/// Everything that an estimate depends on but the samples: the tables `[[camera]]`, `[imu]`, `[rig]` and
/// `[estimator...]` of a configuration file. Raw: [`Self::validate`] makes the
/// [`ValidSetup`](crate::ValidSetup) that an estimator is built from.
#[keys]
pub struct EstimatorSetup {
    /// One or two cameras: `camera[0]` is left (`C0`), `camera[1]` right (`C1`).
    #[key]
    pub camera: Vec<CameraConfig>,
    /// The inertial sensor, whose frame is the body frame `B`.
    #[key]
    pub imu: ImuConfig,
    /// Uncertainty of the extrinsics of the sensors.
    #[key(default)]
    pub rig: RigConfig,
    /// Capacities and thresholds.
    #[key(default)]
    pub estimator: EstimatorConfig,
}

/// Source of the samples if none is named on the command line.
#[keys]
pub struct DriverConfig {
    /// Number of stereo pairs decoded or rendered ahead.
    #[key(default = 4, range = 1..=64)]
    pub image_queue: usize,
    /// Largest difference of the stamps within a stereo pair. In data sets and bags, images that are farther apart
    /// are not paired. Live pairs that are farther apart are used and counted.
    #[key(default = 0.002, range = 0.0..=0.1, unit = SECONDS)]
    pub pair_tolerance_s: f64,
    /// The inertial sensor of a live flight. `[imu]` states its rate and its ranges.
    #[key(default)]
    pub imu: ImuDriverConfig,
    /// Cameras of the Linux kernel (Video4Linux). `plumbline devices` lists devices, formats, rates and controls.
    #[key(default)]
    pub v4l2: V4l2Config,
    /// Frames sent by a program of your own, for example one with a vendor's SDK (docs/own-sensors.md).
    #[key(default)]
    pub frames: FramesConfig,
}
