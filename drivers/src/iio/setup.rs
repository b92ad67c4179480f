//! Has a device measure what we need into its buffer.

use super::devices::{IioDeviceInfo, IioRoots, RATES};
use super::layout::{Layout, Quantity};
use crate::DriverError;
use crate::sysfs::{number, text, write};
use std::path::Path;

/// Scans that the kernel holds for us: a quarter of a second at 1 kHz.
const SCANS: &str = "256";
/// A rate this much off the one that was asked for is another, relative.
const OFF_RATE: f64 = 0.2;

/// Sets a device up and starts its buffer: these quantities with stamps, as near to `rate_hz` as it offers.
///
/// # Errors
/// When it cannot do that; the message says which attribute, and what to do.
pub fn start(
    device: &IioDeviceInfo,
    roots: &IioRoots,
    wanted: &[Quantity],
    rate_hz: f64,
    is_rate_exact: bool,
) -> Result<Layout, DriverError> {
    let folder = &device.folder;
    write(&folder.join("buffer/enable"), "0")?;
    channels(folder, wanted)?;
    rate(device, wanted, rate_hz, is_rate_exact)?;
    // Drivers that stamp by themselves do not have it, or do not heed it: the stamps are looked at.
    let clock = folder.join("current_timestamp_clock");
    if clock.exists() {
        let _ = write(&clock, "monotonic");
    }
    trigger(device, roots)?;
    write(&folder.join("buffer/length"), SCANS)?;
    let watermark = folder.join("buffer/watermark");
    if watermark.exists() {
        write(&watermark, "1")?;
    }
    let layout = Layout::read(folder).map_err(|reason| DriverError::refused(folder, reason))?;
    write(&folder.join("buffer/enable"), "1").map_err(|error| {
        let cure = "the buffer cannot be started: another program may use it, or the device needs a trigger \
                    (modprobe iio-trig-hrtimer, and write its name to trigger/current_trigger)";
        DriverError::refused(folder, format!("{cure}; {error}"))
    })?;
    Ok(layout)
}

/// Stops the buffer of a device, which may be gone.
pub fn stop(folder: &Path) {
    let _ = write(&folder.join("buffer/enable"), "0");
}

/// Switches on the axes that are wanted and the stamp, and all else off.
fn channels(folder: &Path, wanted: &[Quantity]) -> Result<(), DriverError> {
    let elements = folder.join("scan_elements");
    let listed = std::fs::read_dir(&elements).map_err(|error| DriverError::io(&elements, error))?;
    let mut files: Vec<_> = listed.flatten().map(|entry| entry.path()).collect();
    files.sort();
    for file in files {
        let Some(channel) = file.file_name().and_then(|name| name.to_str()?.strip_suffix("_en")) else {
            continue;
        };
        let is_axis = |quantity: &Quantity| {
            let axis = channel.strip_prefix(quantity.channel());
            matches!(axis, Some("_x" | "_y" | "_z"))
        };
        let is_on = wanted.iter().any(is_axis) || channel == "in_timestamp";
        write(&file, if is_on { "1" } else { "0" })?;
    }
    Ok(())
}

/// Asks for the rate that is offered nearest.
fn rate(
    device: &IioDeviceInfo,
    wanted: &[Quantity],
    rate_hz: f64,
    is_exact: bool,
) -> Result<(), DriverError> {
    let folder = &device.folder;
    let off = |rate: f64| (rate / rate_hz - 1.0).abs();
    let nearest = device.rates_hz.iter().copied().min_by(|a, b| off(*a).total_cmp(&off(*b)));
    let is_range = device.rates_hz.len() == 2 && (device.rates_hz[0]..=device.rates_hz[1]).contains(&rate_hz);
    let asked = if is_range { rate_hz } else { nearest.unwrap_or(rate_hz) };
    let concerns = |name: &&str| match *name {
        "in_anglvel_sampling_frequency" => wanted.contains(&Quantity::Gyro),
        "in_accel_sampling_frequency" => wanted.contains(&Quantity::Accel),
        _ => true,
    };
    let files = RATES.into_iter().filter(concerns).map(|name| folder.join(name));
    for file in files.filter(|file| file.exists()) {
        // Some drivers take whole numbers only, and give back what they really do.
        if write(&file, &format!("{asked}")).is_err() {
            write(&file, &format!("{asked:.6}"))?;
        }
        let real = number(&file).unwrap_or(asked);
        if is_exact && off(real) > OFF_RATE {
            let offered: Vec<String> = device.rates_hz.iter().map(f64::to_string).collect();
            let message = format!(
                "it measures {real} times a second where imu.rate_hz = {rate_hz} is wanted; set imu.rate_hz to what it \
                 offers ({})",
                offered.join(", ")
            );
            return Err(DriverError::refused(file, message));
        }
    }
    Ok(())
}

/// Gives a device its own trigger where it has one and none is set.
fn trigger(device: &IioDeviceInfo, roots: &IioRoots) -> Result<(), DriverError> {
    let current = device.folder.join("trigger/current_trigger");
    let is_set = text(&current).is_some_and(|name| !name.is_empty() && name != "(null)");
    if is_set || !current.exists() {
        return Ok(());
    }
    let listed = std::fs::read_dir(&roots.sys).map_err(|error| DriverError::io(&roots.sys, error))?;
    let mut names: Vec<String> = listed
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().starts_with("trigger"))
        .filter_map(|entry| text(&entry.path().join("name")))
        // Drivers name it after themselves and their device's number.
        .filter(|name| {
            name.strip_prefix(device.driver_name.as_str()).is_some_and(|rest| rest.starts_with("-dev"))
        })
        .collect();
    names.sort();
    let number = device.device.trim_start_matches("iio:device");
    let own = names.iter().find(|name| name.ends_with(&format!("-dev{number}"))).or(names.first());
    own.map_or(Ok(()), |name| write(&current, name))
}
