//! Cameras of the Linux kernel (Video4Linux): which devices, what is asked of them, how images become pairs.

use serde::{Deserialize, Serialize};

/// Cameras behind Video4Linux: two devices, or one that gives both images.
///
/// Sizes and rate are those of `[[camera]]`. With two cameras and no `right`, the device of `left` gives both images:
/// side by side in an image of twice the width, or interleaved (`Y8I`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct V4l2Config {
    /// Path of the left camera's device; empty for no camera of this kind.
    pub left: String,
    /// Path of the right camera's device; empty for one camera, or if `left` delivers both images.
    pub right: String,
    /// Pixel format of the images.
    pub format: V4l2Format,
    /// Pairing of left and right images.
    pub pair_by: PairBy,
    /// Number of buffers that a device fills in turn.
    pub buffers: usize,
    /// Exposure, us; 0 leaves it to the camera.
    pub exposure_us: f64,
    /// Gain in the driver's own unit; -1 leaves it to the camera.
    pub gain: f64,
    /// Time from one row of the sensor to the next, us, for drivers that count the exposure in rows; 0 for others.
    pub row_us: f64,
    /// Time from the end of the exposure to the stamp, us, for drivers that stamp the end of a frame.
    pub readout_us: f64,
    /// Further controls of the driver, each as [`V4l2Control::parse`] reads it.
    pub controls: Vec<String>,
}

/// What the images of a device are encoded as; luma of all of them becomes 8-bit grey.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum V4l2Format {
    /// The first of the others, in their order, that the device offers in the size of the camera.
    #[default]
    #[serde(rename = "auto")]
    Auto,
    /// 8-bit grey.
    #[serde(rename = "GREY")]
    Grey,
    /// 8-bit grey of two sensors, pixel by pixel.
    #[serde(rename = "Y8I")]
    Y8i,
    /// 10-bit grey in 16 bits.
    #[serde(rename = "Y10")]
    Y10,
    /// 12-bit grey in 16 bits.
    #[serde(rename = "Y12")]
    Y12,
    /// 16-bit grey.
    #[serde(rename = "Y16")]
    Y16,
    /// Luma of 8 bits, with chroma between.
    #[serde(rename = "YUYV")]
    Yuyv,
    /// Luma of 8 bits, with chroma between; the chroma comes first.
    #[serde(rename = "UYVY")]
    Uyvy,
    /// Luma of 8 bits, chroma after all of it.
    #[serde(rename = "NV12")]
    Nv12,
    /// An image of JPEG for each frame.
    #[serde(rename = "MJPEG")]
    Mjpeg,
}

/// How left and right images find each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PairBy {
    /// The nearest in time.
    #[default]
    Time,
    /// Equal number of frames since the first pair: for cameras that are triggered together.
    Sequence,
}

impl Default for V4l2Config {
    fn default() -> Self {
        Self {
            left: String::new(),
            right: String::new(),
            format: V4l2Format::default(),
            pair_by: PairBy::default(),
            buffers: 6,
            exposure_us: 0.0,
            gain: -1.0,
            row_us: 0.0,
            readout_us: 0.0,
            controls: Vec::new(),
        }
    }
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
    /// What is wrong with the text, in words.
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
    #[must_use]
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
