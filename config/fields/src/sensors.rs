//! Samples and stamps of sensors, as drivers hand them out and flights record them.

use crate::Record;
use plumbline_config::ImuSample;

/// An inertial sample with its place in the sensor's stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Record)]
#[record("Imu")]
pub struct ImuReading {
    /// Counts samples of the sensor from 0; a jump says how many were lost.
    #[field(1)]
    pub sequence: u64,
    /// The sample.
    #[field(2, path = stamp, wire = "stamp_ns")]
    #[field(3, path = gyro, about = "Angular rate x y z in B, rad/s.")]
    #[field(4, path = accel, about = "Specific force x y z in B, m/s^2.")]
    pub sample: ImuSample,
}

/// Stamps of a source: how many were used, and how many were of no use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Record)]
#[record("Stamps")]
pub struct StampFigures {
    /// Frames or samples that were handed out.
    #[field(1)]
    pub used: u64,
    /// Frames stamped by their arrival instead, since their stamp was of no clock of this computer.
    #[field(2)]
    pub restamped: u64,
    /// Frames or samples that were dropped, since their stamp was repeated, went back, or was of no use.
    #[field(3)]
    pub refused: u64,
}

impl StampFigures {
    /// Frames or samples whose stamps were of no use.
    pub fn bad(&self) -> u64 {
        self.restamped + self.refused
    }
}
