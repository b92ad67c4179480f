//! The inertial devices that the kernel drives, and their names.
//!
//! `iio:device0` is whichever was there first. What stays is the name that its driver gives (`bmi270`), the label of the
//! device tree, and where it is attached.

use super::layout::Quantity;
use crate::{DriverError, sysfs};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Devices that are looked at, at most.
const MAX_DEVICES: usize = 128;

/// Attributes that say how often a device measures.
pub(super) const RATES: [&str; 3] =
    ["in_anglvel_sampling_frequency", "in_accel_sampling_frequency", "sampling_frequency"];

/// Folders in which the kernel shows its devices.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IioRoots {
    /// Folder of the devices' attributes.
    pub sys: PathBuf,
    /// Folder of the devices' buffers.
    pub dev: PathBuf,
}

impl Default for IioRoots {
    fn default() -> Self {
        Self { sys: PathBuf::from("/sys/bus/iio/devices"), dev: PathBuf::from("/dev") }
    }
}

/// A device with an accelerometer or a gyroscope.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IioDeviceInfo {
    /// The name to configure, behind `iio://`: one that stays.
    pub name: String,
    /// Present name, such as `iio:device0`.
    pub device: String,
    /// Folder of its attributes.
    pub folder: PathBuf,
    /// Name given by the driver.
    pub driver_name: String,
    /// Name given by the device tree.
    pub label: Option<String>,
    /// True if it has a buffer with a gyroscope.
    pub has_gyro: bool,
    /// True if it has a buffer with an accelerometer.
    pub has_accel: bool,
    /// Samples a second that it is set to, where it says so.
    pub rate_hz: Option<f64>,
    /// Samples a second that it offers; empty where it does not say.
    pub rates_hz: Vec<f64>,
}

/// The inertial devices of this host, in order of their names.
pub fn iio_devices() -> Vec<IioDeviceInfo> {
    devices_below(&IioRoots::default())
}

/// Inertial devices below other roots than `/sys` and `/dev`, in order of their names.
pub fn devices_below(roots: &IioRoots) -> Vec<IioDeviceInfo> {
    let Ok(listed) = std::fs::read_dir(&roots.sys) else { return Vec::new() };
    let mut devices: Vec<IioDeviceInfo> =
        listed.flatten().take(MAX_DEVICES).filter_map(|entry| device_at(&entry.path())).collect();
    devices.sort_by(|a, b| (&a.driver_name, &a.folder).cmp(&(&b.driver_name, &b.folder)));
    let names: Vec<String> = devices.iter().map(|device| stable_name(device, &devices)).collect();
    devices.iter_mut().zip(names).for_each(|(device, name)| device.name = name);
    devices
}

/// The label or the driver's name of a device, where no other of `all` has it; else where it is.
fn stable_name(device: &IioDeviceInfo, all: &[IioDeviceInfo]) -> String {
    let is_single = |name: &str| {
        let has = |other: &&IioDeviceInfo| other.driver_name == name || other.label.as_deref() == Some(name);
        all.iter().filter(has).count() == 1
    };
    let mut names = device.label.iter().chain([&device.driver_name]);
    let name = names.find(|name| !name.contains([',', '/']) && is_single(name));
    name.cloned().unwrap_or_else(|| place_of(&device.folder))
}

fn device_at(folder: &Path) -> Option<IioDeviceInfo> {
    let device = folder.file_name()?.to_str()?.to_owned();
    if !device.starts_with("iio:device") {
        return None;
    }
    let has = |quantity: Quantity| folder.join(format!("scan_elements/{}_x_en", quantity.channel())).exists();
    let (has_gyro, has_accel) = (has(Quantity::Gyro), has(Quantity::Accel));
    (has_gyro || has_accel).then(|| IioDeviceInfo {
        name: String::new(),
        device,
        driver_name: sysfs::text(&folder.join("name")).unwrap_or_default(),
        label: sysfs::text(&folder.join("label")).filter(|label| !label.is_empty()),
        has_gyro,
        has_accel,
        rate_hz: sysfs::first_number(folder, &RATES),
        rates_hz: rates_of(folder),
        folder: folder.to_owned(),
    })
}

/// Rates that a device offers.
fn rates_of(folder: &Path) -> Vec<f64> {
    let offered = |name: &&str| sysfs::text(&folder.join(format!("{name}_available")));
    let text = RATES.iter().find_map(offered).unwrap_or_default();
    // `[least step most]` is a range, which is told by its ends.
    let is_range = text.starts_with('[');
    let numbers: Vec<f64> = text
        .trim_matches(['[', ']'])
        .split_whitespace()
        .filter_map(|word| word.parse().ok())
        .filter(|rate: &f64| rate.is_finite() && *rate > 0.0)
        .collect();
    match (is_range, &numbers[..]) {
        (true, [least, _, most]) => vec![*least, *most],
        _ => numbers,
    }
}

/// Attachment of a device: the path of its attributes without the number that changes.
fn place_of(folder: &Path) -> String {
    let whole = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    whole.parent().unwrap_or(&whole).display().to_string()
}

/// The device of this name, label or place that has what is wanted; none where it is not there.
///
/// # Errors
/// When several have it, or the one there is lacks what is wanted.
pub fn find(roots: &IioRoots, name: &str, wanted: &[Quantity]) -> Result<Option<IioDeviceInfo>, DriverError> {
    let devices = devices_below(roots);
    let is_it = |device: &IioDeviceInfo| {
        [&device.name, &device.driver_name, &device.device].contains(&&name.to_owned())
            || device.label.as_deref() == Some(name)
            || place_of(&device.folder) == name
    };
    let has = |device: &IioDeviceInfo, quantity: &Quantity| match quantity {
        Quantity::Accel => device.has_accel,
        Quantity::Gyro => device.has_gyro,
    };
    let called: Vec<&IioDeviceInfo> = devices.iter().filter(|device| is_it(device)).collect();
    let fit: Vec<&IioDeviceInfo> =
        called.iter().copied().filter(|device| wanted.iter().all(|quantity| has(device, quantity))).collect();
    match (&fit[..], &called[..]) {
        ([one], _) => Ok(Some((*one).clone())),
        ([], []) => Ok(None),
        ([], [other, ..]) => Err(DriverError::refused(
            &other.folder,
            format!(
                "`{name}` has no buffer with {}; where gyroscope and accelerometer are two devices, write \
                 iio://GYROSCOPE,ACCELEROMETER",
                wanted.iter().map(|quantity| quantity.channel()).collect::<Vec<_>>().join(" and ")
            ),
        )),
        (several, _) => Err(DriverError::refused(
            &roots.sys,
            format!(
                "`{name}` are several; name one of {}",
                several.iter().map(|device| device.name.as_str()).collect::<Vec<_>>().join(", ")
            ),
        )),
    }
}
