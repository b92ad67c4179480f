//! Cameras of the Linux kernel (Video4Linux): which devices, what is asked of them, how images become pairs.

use plumbline_keys::keys;

/// Cameras behind Video4Linux: two devices, or one that gives both images.
///
/// Sizes and rate are those of `[[camera]]`. With two cameras and no `right`, the device of `left` gives both images:
/// side by side in an image of twice the width, or interleaved (`Y8I`).
#[keys]
pub struct V4l2Config {
    /// Left camera, such as "/dev/v4l/by-path/platform-...-video-index0"; empty for none. The device may deliver both
    /// images: side by side in an image of twice the width, or interleaved.
    #[key(default)]
    pub left: String,
    /// Right camera; empty for one camera, or if `left` delivers both images.
    #[key(default)]
    pub right: String,
    /// Pixel format: "GREY", "Y8I", "Y10", "Y12", "Y16", "YUYV", "UYVY", "NV12" or "MJPEG"; "auto" takes the first of these
    /// that the device offers in the size of the cameras.
    #[key(default)]
    pub format: V4l2Format,
    /// Pairing of left and right images: "time" (the nearest) or "sequence" (equal frame numbers, for cameras that are
    /// triggered together).
    #[key(default)]
    pub pair_by: PairBy,
    /// Number of buffers that a device fills in turn.
    #[key(default = 6, range = 4..=32)]
    pub buffers: usize,
    /// Exposure, us; 0 leaves it to the camera. Frames are stamped in the middle of the exposure.
    #[key(default = 0.0, range = 0.0..=1e6, unit = MICROSECONDS, cure = "write it in microseconds, 0 to leave it to the camera")]
    pub exposure_us: f64,
    /// Gain in the driver's unit, a whole number; -1 leaves it to the camera.
    #[key(default = -1.0, range = -1.0..=1e6, cure = "write it in the driver's own unit, -1 to leave it to the camera")]
    pub gain: f64,
    /// Time from row to row, for drivers that count the exposure in rows; 0 for others.
    #[key(default = 0.0, range = 0.0..=1000.0, unit = MICROSECONDS,
        cure = "write it in microseconds, 0 where the exposure is not counted in rows")]
    pub row_us: f64,
    /// Time from the end of the exposure to the stamp, for drivers that stamp the end of a frame.
    #[key(default = 0.0, range = 0.0..=1e5, unit = MICROSECONDS)]
    pub readout_us: f64,
    /// Further controls, such as "power_line_frequency=1", or xu:UNIT:SELECTOR:BYTES=VALUE of an extension unit.
    /// Examples are a driver's trigger mode, "trigger_mode=1", and "xu:3:2:1=0", the emitter of a RealSense.
    #[key(default)]
    pub controls: Vec<String>,
}

/// Encoding of a device's images; luma of all of them becomes 8-bit grey.
#[keys("UPPERCASE")]
pub enum V4l2Format {
    /// The first of the others, in their order, that the device offers in the size of the camera.
    #[default]
    #[serde(rename = "auto")]
    Auto,
    /// 8-bit grey.
    Grey,
    /// 8-bit grey of two sensors, pixel by pixel.
    Y8i,
    /// 10-bit grey in 16 bits.
    Y10,
    /// 12-bit grey in 16 bits.
    Y12,
    /// 16-bit grey.
    Y16,
    /// Luma of 8 bits, with chroma between.
    Yuyv,
    /// Luma of 8 bits, with chroma between; the chroma comes first.
    Uyvy,
    /// Luma of 8 bits, chroma after all of it.
    Nv12,
    /// An image of JPEG for each frame.
    Mjpeg,
}

/// Rule by which left and right images find each other.
#[keys("lowercase")]
pub enum PairBy {
    /// The nearest in time.
    #[default]
    Time,
    /// Equal number of frames since the first pair: for cameras that are triggered together.
    Sequence,
}

/// A control of a device and the value that it is given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct V4l2Control {
    /// Control that is set.
    pub target: ControlTarget,
    /// The value; entries of menus count from 0, switches are 0 or 1.
    pub value: i32,
}

/// Control of a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ControlTarget {
    /// Control of the driver by its name in small letters, all else an underscore: `v4l2-ctl` and `plumbline devices` list
    /// it so.
    Name(String),
    /// Control of an extension unit of a USB camera, which only its manufacturer explains.
    Extension {
        /// Number of the unit.
        unit: u8,
        /// Number of the control in the unit.
        selector: u8,
        /// Bytes of the value: 1, 2 or 4, least significant first.
        bytes: u8,
    },
}

/// Beginning of a control of an extension unit.
const EXTENSION: &str = "xu:";

/// The longest control that is looked at, bytes; the kernel's names have 31 at most.
const MAX_CONTROL_BYTES: usize = 64;

impl V4l2Control {
    /// Reads `NAME=VALUE`, such as `power_line_frequency=1`, or `xu:UNIT:SELECTOR:BYTES=VALUE`, such as `xu:3:2:1=0`.
    ///
    /// # Errors
    /// Fault of the text, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        if text.len() > MAX_CONTROL_BYTES {
            return Err(format!("is longer than {MAX_CONTROL_BYTES} bytes"));
        }
        let Some((name, value)) = text.split_once('=') else {
            return Err(format!("{text:?} has no `=` between name and value"));
        };
        let value = value.trim();
        let value = value.parse().map_err(|_| format!("{value:?} is not a whole number of 32 bits"))?;
        if let Some(place) = name.trim().strip_prefix(EXTENSION) {
            let target = extension(place).ok_or_else(|| {
                format!("{text:?} is not a control of an extension unit: xu:UNIT:SELECTOR:BYTES=VALUE, 1, 2 or 4 bytes")
            })?;
            return Ok(Self { target, value });
        }
        let name = Self::plain_name(name);
        if name.is_empty() {
            return Err(format!("{text:?} has no name before the `=`"));
        }
        Ok(Self { target: ControlTarget::Name(name), value })
    }

    /// A control's name as drivers spell it ("Power Line Frequency") in the spelling that is compared
    /// (`power_line_frequency`).
    pub fn plain_name(name: &str) -> String {
        let words = name.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
        words.collect::<Vec<_>>().join("_").to_ascii_lowercase()
    }
}

/// Reads `UNIT:SELECTOR:BYTES`.
fn extension(text: &str) -> Option<ControlTarget> {
    let numbers: Option<Vec<u8>> = text.split(':').map(|number| number.parse().ok()).collect();
    match numbers?[..] {
        [unit, selector, bytes] if unit > 0 && selector > 0 && matches!(bytes, 1 | 2 | 4) => {
            Some(ControlTarget::Extension { unit, selector, bytes })
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn controls_of_extension_units_are_read_or_refused() {
        let control = V4l2Control::parse("xu:3:2:1=0").unwrap();
        assert_eq!(control.target, ControlTarget::Extension { unit: 3, selector: 2, bytes: 1 });
        for wrong in
            ["xu:=0", "xu:3:2=0", "xu:3:2:3=0", "xu:0:2:1=0", "xu:3:2:1:1=0", "xu:300:2:1=0", "xu:3:2:1"]
        {
            assert!(V4l2Control::parse(wrong).is_err(), "{wrong}");
        }
        let named = V4l2Control::parse("Power Line Frequency=1").unwrap();
        assert_eq!(named.target, ControlTarget::Name("power_line_frequency".into()));
    }
}
