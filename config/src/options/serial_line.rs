//! A serial device and its speed, as addresses name them.

/// Slowest and fastest serial lines that are accepted, baud.
const BAUD: std::ops::RangeInclusive<u32> = 9_600..=12_000_000;
/// Bits on a serial line for one byte: start, eight bits, stop.
const BAUD_PER_BYTE: f64 = 10.0;
/// The longest text that is looked at, bytes.
const MAX_BYTES: usize = 256;

/// A serial device and its speed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialLine {
    /// Path of the device.
    pub device: String,
    /// Symbols a second; ten carry a byte.
    pub baud: u32,
}

impl SerialLine {
    /// Reads `DEVICE:BAUD`.
    ///
    /// # Errors
    /// Fault of the text, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let Some((device, number)) = text.rsplit_once(':').filter(|(device, _)| !device.is_empty()) else {
            return Err(format!("{text:?} lacks its device, or its speed after the last colon"));
        };
        let baud =
            number.parse().ok().filter(|baud| BAUD.contains(baud)).ok_or_else(|| {
                format!("{number:?} is no speed from {} to {} baud", BAUD.start(), BAUD.end())
            })?;
        if !device.starts_with('/') {
            return Err(format!("{device:?} is not an absolute path of a device"));
        }
        Ok(Self { device: device.to_owned(), baud })
    }

    /// Reason why the line is too slow for bytes a second, which `rate` makes; `None` where it is not.
    pub(crate) fn too_slow(&self, bytes_s: f64, rate: &str) -> Option<String> {
        let (baud, needed) = (self.baud, bytes_s * BAUD_PER_BYTE);
        let is_slow = f64::from(baud) < needed;
        is_slow.then(|| format!("{baud} baud are too slow for {rate}: {needed:.0} are needed"))
    }
}

/// Takes `kind://rest` apart.
pub(super) fn split_address(text: &str, kinds: &str) -> Result<(String, String), String> {
    if text.len() > MAX_BYTES || !text.chars().all(|c| c.is_ascii_graphic()) {
        return Err(format!("is longer than {MAX_BYTES} bytes, or holds spaces or special characters"));
    }
    match text.split_once("://") {
        Some((kind, rest)) => Ok((kind.to_owned(), rest.to_owned())),
        None => Err(format!("{text:?} does not begin with {kinds}")),
    }
}
