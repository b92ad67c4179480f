//! Identity of the vehicle in ROS 2.

use nalgebra::UnitQuaternion;
use plumbline_config::options::RosConfig;
use plumbline_flight::pipeline::Stamps;

/// Vehicle as ROS 2 sees it.
#[derive(Clone, Debug)]
pub struct Identity {
    /// Options of the configuration.
    pub options: RosConfig,
    /// Name of the vehicle.
    pub vehicle: String,
    /// Takes coordinates from the IMU to the vehicle.
    pub rot_v_b: UnitQuaternion<f64>,
    /// Clock domain of the stamps.
    pub stamps: Stamps,
}
