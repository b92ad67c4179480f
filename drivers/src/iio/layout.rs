//! Layout of a sample in the buffer of a device, and the meaning of its numbers.
//!
//! Elements lie in the order of their index, each at a multiple of its own size; a scan is as long as a multiple of its
//! largest. `le:s16/32>>4` is little-endian, signed, 16 bits in 32, shifted left by 4.

use crate::sysfs;
use nalgebra::{Matrix3, Vector3};
use std::path::Path;

/// Longest scan that is taken, bytes.
pub const MAX_SCAN: usize = 256;
/// A mount matrix may be off a rotation by this: it is written with few decimals.
const OFF_ROTATION: f64 = 5e-3;

/// Storage of an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Storage {
    is_big_endian: bool,
    is_signed: bool,
    bits: u32,
    /// Bytes that it takes.
    bytes: usize,
    shift: u32,
}

impl Storage {
    /// Reads `[be|le]:[s|u]bits/storagebits>>shift`. None for anything else, and for elements that repeat.
    pub fn parse(text: &str) -> Option<Self> {
        let (order, rest) = text.trim().split_once(':')?;
        let (rest, shift) = rest.split_once(">>").unwrap_or((rest, "0"));
        let (sign_and_bits, storage) = rest.split_once('/')?;
        let mut characters = sign_and_bits.chars();
        let sign = characters.next()?;
        let (bits, stored): (u32, u32) = (characters.as_str().parse().ok()?, storage.parse().ok()?);
        let shift: u32 = shift.parse().ok()?;
        let is_possible =
            matches!(stored, 8 | 16 | 32 | 64) && bits >= 1 && bits.checked_add(shift)? <= stored;
        let is_known = matches!(order, "be" | "le") && matches!(sign, 's' | 'u');
        (is_possible && is_known).then(|| Self {
            is_big_endian: order == "be",
            is_signed: sign == 's',
            bits,
            bytes: stored as usize / 8,
            shift,
        })
    }

    /// Bits of the number.
    pub fn bits(&self) -> u32 {
        self.bits
    }

    /// The number that is stored; unsigned ones of 64 bits wrap.
    pub fn read(&self, bytes: &[u8]) -> i64 {
        let sum = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        let raw = match self.is_big_endian {
            true => bytes.iter().take(self.bytes).fold(0, sum),
            false => bytes.iter().take(self.bytes).rev().fold(0, sum),
        };
        let unused = 64 - self.bits;
        let at_top = (raw >> self.shift) << unused;
        if self.is_signed { at_top as i64 >> unused } else { (at_top >> unused) as i64 }
    }
}

/// An element and where it lies.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Element {
    storage: Storage,
    place: usize,
    /// `(stored + offset) scale` is in SI.
    offset: f64,
    scale: f64,
}

impl Element {
    fn value(&self, scan: &[u8]) -> f64 {
        let stored = self.storage.read(&scan[self.place..self.place + self.storage.bytes]);
        (stored as f64 + self.offset) * self.scale
    }
}

/// Three axes and how the sensor is mounted.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Axes {
    elements: [Element; 3],
    /// From the sensor's axes to the device's.
    mount: Matrix3<f64>,
}

impl Axes {
    fn value(&self, scan: &[u8]) -> Vector3<f64> {
        self.mount * Vector3::from(self.elements.map(|element| element.value(scan)))
    }
}

/// Measured quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Specific force, m/s².
    Accel,
    /// Angular rate, rad/s.
    Gyro,
}

impl Quantity {
    /// Prefix of its channels.
    #[must_use]
    pub fn channel(self) -> &'static str {
        match self {
            Self::Accel => "in_accel",
            Self::Gyro => "in_anglvel",
        }
    }
}

/// One scan of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScanValues {
    /// The kernel's stamp, ns.
    pub stamp_ns: i64,
    /// rad/s.
    pub gyro: Option<Vector3<f64>>,
    /// m/s².
    pub accel: Option<Vector3<f64>>,
}

/// Layout of the scans of a device.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// Length of a scan, bytes.
    pub bytes: usize,
    stamp: Element,
    gyro: Option<Axes>,
    accel: Option<Axes>,
}

impl Layout {
    /// The layout of the channels of a device that are switched on.
    ///
    /// # Errors
    /// Defect, in words.
    pub fn read(folder: &Path) -> Result<Self, String> {
        let elements = placed(&folder.join("scan_elements"))?;
        let bytes = elements.1;
        let find = |name: &str| {
            elements.0.iter().find(|(other, ..)| other == name).map(|(_, s, place)| (*s, *place))
        };
        let axes = |quantity: Quantity| axes_of(folder, quantity, &find);
        let (storage, place) = find("in_timestamp").ok_or("it has no timestamps")?;
        Ok(Self {
            bytes,
            stamp: Element { storage, place, offset: 0.0, scale: 1.0 },
            gyro: axes(Quantity::Gyro)?,
            accel: axes(Quantity::Accel)?,
        })
    }

    /// Values of a scan, which is [`Self::bytes`] long.
    pub fn values(&self, scan: &[u8]) -> ScanValues {
        let Element { storage, place, .. } = self.stamp;
        ScanValues {
            stamp_ns: storage.read(&scan[place..place + storage.bytes]),
            gyro: self.gyro.map(|axes| axes.value(scan)),
            accel: self.accel.map(|axes| axes.value(scan)),
        }
    }
}

/// Name, storage and place of every channel that is switched on, and the length of a scan.
type Placed = (Vec<(String, Storage, usize)>, usize);

fn placed(folder: &Path) -> Result<Placed, String> {
    let mut channels = Vec::new();
    for name in enabled(folder) {
        let of = |what: &str| sysfs::text(&folder.join(format!("{name}_{what}")));
        let index: u32 = of("index")
            .and_then(|text| text.parse().ok())
            .ok_or_else(|| format!("{name}_index is not a number"))?;
        let kind = of("type").unwrap_or_default();
        let storage = Storage::parse(&kind)
            .ok_or_else(|| format!("{name}_type is {kind:?}, which is not understood"))?;
        channels.push((index, name, storage));
    }
    channels.sort_by(|a: &(u32, String, Storage), b| (a.0, &a.1).cmp(&(b.0, &b.1)));
    let (mut end, mut largest, mut all) = (0_usize, 1, Vec::new());
    for (_, name, storage) in channels {
        let place = end.next_multiple_of(storage.bytes);
        (end, largest) = (place + storage.bytes, largest.max(storage.bytes));
        all.push((name, storage, place));
    }
    let bytes = end.next_multiple_of(largest);
    if bytes > MAX_SCAN {
        return Err(format!("a scan has {bytes} bytes, more than {MAX_SCAN}"));
    }
    Ok((all, bytes))
}

/// Channels that are switched on.
fn enabled(folder: &Path) -> Vec<String> {
    let Ok(listed) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut names: Vec<String> = listed
        .flatten()
        .filter_map(|entry| entry.file_name().to_str()?.strip_suffix("_en").map(str::to_owned))
        .filter(|name| sysfs::text(&folder.join(format!("{name}_en"))).as_deref() == Some("1"))
        .collect();
    names.sort();
    names
}

/// The axes of a quantity, where all three are switched on.
fn axes_of(
    folder: &Path,
    quantity: Quantity,
    find: &impl Fn(&str) -> Option<(Storage, usize)>,
) -> Result<Option<Axes>, String> {
    let channel = quantity.channel();
    let found = ["x", "y", "z"].map(|axis| Some((axis, find(&format!("{channel}_{axis}"))?)));
    let [Some(x), Some(y), Some(z)] = found else { return Ok(None) };
    let number = |axis: &str, what: &str| {
        sysfs::number(&folder.join(format!("{channel}_{axis}_{what}")))
            .or_else(|| sysfs::number(&folder.join(format!("{channel}_{what}"))))
    };
    let element = |(axis, (storage, place)): (&str, (Storage, usize))| {
        let scale = number(axis, "scale").filter(|scale| *scale != 0.0);
        let scale = scale.ok_or_else(|| format!("{channel}_scale is not there or no number"))?;
        Ok::<_, String>(Element { storage, place, offset: number(axis, "offset").unwrap_or(0.0), scale })
    };
    let elements = [element(x)?, element(y)?, element(z)?];
    Ok(Some(Axes { elements, mount: mount_of(folder, channel)? }))
}

/// Rotation of the sensor's mount in its device; the identity by default.
fn mount_of(folder: &Path, channel: &str) -> Result<Matrix3<f64>, String> {
    let own = format!("{channel}_mount_matrix");
    let names = [own.as_str(), "in_mount_matrix", "mount_matrix"];
    let Some((name, text)) = names.iter().find_map(|name| Some((name, sysfs::text(&folder.join(name))?)))
    else {
        return Ok(Matrix3::identity());
    };
    let matrix =
        parse_matrix(&text).ok_or_else(|| format!("{name} is {text:?}, not three rows of three numbers"))?;
    let off = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    if off > OFF_ROTATION || matrix.determinant() < 0.0 {
        return Err(format!("{name} is {text:?}, which is not a rotation: correct it in the device tree"));
    }
    Ok(matrix)
}

/// Reads `a, b, c; d, e, f; g, h, i`, row by row.
pub(crate) fn parse_matrix(text: &str) -> Option<Matrix3<f64>> {
    let numbers: Vec<f64> =
        text.split([';', ',']).map(|number| number.trim().parse().ok()).collect::<Option<_>>()?;
    let is_whole = numbers.len() == 9 && numbers.iter().all(|number| number.is_finite());
    is_whole.then(|| Matrix3::from_row_slice(&numbers))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, bytes: &[u8]) -> i64 {
        Storage::parse(text).unwrap().read(bytes)
    }

    #[test]
    fn numbers_are_read_as_their_type_says() {
        assert_eq!(read("le:s16/16>>0", &[0xFE, 0xFF]), -2);
        assert_eq!(read("be:s16/16>>0", &[0xFF, 0xFE]), -2);
        assert_eq!(read("be:u16/16>>0", &[0xFF, 0xFE]), 65_534);
        assert_eq!(read("le:s12/16>>4", &[0xF0, 0x7F]), 2047);
        assert_eq!(read("le:s12/16>>4", &[0x0F, 0x80]), -2048);
        assert_eq!(read("be:s24/32>>8", &[0xFF, 0xFF, 0xFE, 0x77]), -2);
        assert_eq!(read("le:s64/64>>0", &(-5_i64).to_le_bytes()), -5);
        assert_eq!(read("le:u8/8>>0", &[200]), 200);
    }

    #[test]
    fn other_types_are_refused() {
        for text in [
            "",
            "le:s16/16X2>>0",
            "xe:s16/16>>0",
            "le:f32/32>>0",
            "le:s0/16>>0",
            "le:s16/24>>0",
            "le:s16/16>>1",
        ] {
            assert_eq!(Storage::parse(text), None, "{text}");
        }
        assert!(Storage::parse("le:s16/16").is_some(), "without a shift");
    }

    #[test]
    fn matrices_are_three_rows_of_three() {
        assert_eq!(parse_matrix("0, 1, 0; -1, 0, 0; 0, 0, 1").unwrap()[(1, 0)], -1.0);
        for text in ["1, 0, 0; 0, 1, 0", "1, 0, 0; 0, 1, 0; 0, 0, x", "", "1,0,0;0,1,0;0,0,inf"] {
            assert!(parse_matrix(text).is_none(), "{text}");
        }
    }
}
