//! RealSense cameras of the D400 family: their calibration, emitter and exposure, over the extension unit of the stereo
//! module. Images and inertial samples come by the kernel's drivers ([`crate::v4l2`], [`crate::iio`]).
//!
//! Sources: librealsense (`src/ds/ds-private.h`, `src/ds/d400`), whose layouts are those of the firmware. Not tried on a
//! device: tests run on tables and responses made by these layouts.

mod monitor;
mod table;

pub use monitor::{CONTROL_BYTES, GET_CALIBRATION, MonitorError, request, response};
pub use table::{MAX_TABLE_BYTES, RectifiedSize, StereoTable, TABLE_ID, TableError};

use crate::DriverError;
use crate::v4l2::ExtensionUnit;
use std::path::Path;
use std::time::Duration;

/// Identifier of the manufacturer on USB.
pub const VENDOR: u16 = 0x8086;
/// Extension unit of the stereo module.
pub const UNIT: u8 = 3;
/// Controls of the unit: commands, emitter, exposure (us), automatic exposure.
const COMMANDS: u8 = 1;
/// Control of the emitter: 0 is off, 1 on; one byte.
pub const EMITTER: u8 = 2;
/// Control of the exposure, us; four bytes.
pub const EXPOSURE: u8 = 3;
/// Control of the automatic exposure: 0 is off, 1 on; one byte.
pub const AUTO_EXPOSURE: u8 = 11;
/// Pause between request and response, as librealsense makes it.
const PAUSE: Duration = Duration::from_millis(20);

/// Model of the family with an infrared pair and an inertial sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// D435i.
    D435i,
    /// D455.
    D455,
}

impl Model {
    /// Model by the identifier of the product.
    #[must_use]
    pub fn of_product(product: u16) -> Option<Self> {
        match product {
            0x0b3a => Some(Self::D435i),
            0x0b5c => Some(Self::D455),
            _ => None,
        }
    }

    /// Name of its preset.
    #[must_use]
    pub fn preset(self) -> &'static str {
        match self {
            Self::D435i => "realsense-d435i",
            Self::D455 => "realsense-d455",
        }
    }
}

/// Reads the calibration table of a camera from one of its stereo module's nodes: the bytes as the firmware has them.
///
/// # Errors
/// When the node cannot be opened, or the firmware does not answer.
pub fn read_table(node: &Path) -> Result<Vec<u8>, DriverError> {
    let unit = ExtensionUnit::open(node, UNIT)?;
    unit.set(COMMANDS, &request(GET_CALIBRATION, TABLE_ID))?;
    std::thread::sleep(PAUSE);
    let mut bytes = [0; CONTROL_BYTES];
    unit.get(COMMANDS, &mut bytes)?;
    let table = response(&bytes, GET_CALIBRATION);
    let table =
        table.map_err(|error| DriverError::device(node, format!("{error}; plug the camera in again")))?;
    Ok(table.to_vec())
}
