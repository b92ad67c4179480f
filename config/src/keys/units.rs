//! Units of keys, and what a value in another one is told.

/// Unit of a number.
#[derive(Clone, Copy)]
pub(crate) struct Unit {
    /// Symbol, as tables show it; empty for a share.
    pub symbol: &'static str,
    /// Cure of a value out of range.
    pub cure: &'static str,
}

const fn unit(symbol: &'static str, cure: &'static str) -> Unit {
    Unit { symbol, cure }
}

const DENSITY: &str =
    "write it per sqrt(Hz) and in radians and metres (1 deg = 0.01745 rad, 1 mg = 0.00981 m/s²)";

pub(crate) const GYRO_DENSITY: Unit = unit("rad/s/√Hz", DENSITY);
pub(crate) const GYRO_WALK: Unit = unit("rad/s²/√Hz", DENSITY);
pub(crate) const ACCEL_DENSITY: Unit = unit("m/s²/√Hz", DENSITY);
pub(crate) const ACCEL_WALK: Unit = unit("m/s³/√Hz", DENSITY);
pub(crate) const RADIANS: Unit = unit("rad", "write it in radians (1 deg = 0.01745 rad)");
pub(crate) const RADIANS_PER_SECOND: Unit = unit("rad/s", "write it in rad/s (1 deg/s = 0.01745 rad/s)");
pub(crate) const DEGREES: Unit = unit("°", "write it in degrees");
pub(crate) const METRES: Unit = unit("m", "write it in metres (is this in mm?)");
pub(crate) const METRES_PER_SECOND: Unit = unit("m/s", "write it in m/s");
pub(crate) const METRES_PER_SECOND_2: Unit = unit("m/s²", "write it in m/s² (1 mg = 0.00981 m/s²)");
pub(crate) const SECONDS: Unit = unit("s", "write it in seconds (is this in ms?)");
pub(crate) const MICROSECONDS: Unit = unit("us", "write it in microseconds");
pub(crate) const HZ: Unit = unit("Hz", "write it in Hz (is this a period?)");
pub(crate) const PIXELS: Unit = unit("px", "write it in pixels");
pub(crate) const MEGABYTES: Unit = unit("MB", "write it in MB (10^6 bytes)");
pub(crate) const SHARE: Unit = unit("", "write it as a share (0.5 % = 0.005)");
