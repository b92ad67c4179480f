//! Facts about a vehicle from which queries are answered.

use super::commands::CommandRelay;
use nalgebra::UnitQuaternion;
use plumbline_record::messages::Configuration;
use std::sync::Arc;

/// Facts about a vehicle from which queries are answered.
#[derive(Debug)]
pub struct VehicleFacts {
    /// Name in the keys.
    pub name: String,
    /// The configuration in force.
    pub configuration: Configuration,
    /// True if camera images are offered.
    pub offers_camera: bool,
    /// Takes coordinates from the IMU `B` to the vehicle `V` (x forward, y left, z up), where the mounting is known.
    pub rot_v_b: Option<UnitQuaternion<f64>>,
    /// Reason why commands are refused, if they are.
    pub refusal: Option<String>,
    /// Way of commands to the flight.
    pub commands: Arc<CommandRelay>,
}
