//! Controls of a device: what there is, and setting exposure, gain and whatever else the configuration names.

use super::sys::abi::{
    CONTROL_BITMASK, CONTROL_BOOLEAN, CONTROL_BUTTON, CONTROL_DISABLED, CONTROL_INACTIVE, CONTROL_INTEGER,
    CONTROL_INTEGER_MENU, CONTROL_MENU, CONTROL_READ_ONLY, CONTROL_WRITE_ONLY, ControlDescription,
    EXPOSURE_MANUAL, ID_ANALOGUE_GAIN, ID_AUTO_GAIN, ID_EXPOSURE, ID_EXPOSURE_ABSOLUTE, ID_EXPOSURE_AUTO,
    ID_EXPOSURE_AUTO_PRIORITY, ID_GAIN, NEXT_CONTROL,
};
use super::sys::calls;
use super::{extension, node};
use crate::DriverError;
use plumbline_config::Portable;
use plumbline_config::options::{ControlTarget, V4l2Config, V4l2Control};
use rustix::fd::{AsFd, BorrowedFd, OwnedFd};
use rustix::io::Errno;
use serde::Serialize;
use std::path::Path;

/// Controls of a device that are looked at, at most.
const MAX_CONTROLS: usize = 512;
/// The unit of exposures that are not counted in rows, us.
const ABSOLUTE_UNIT_US: f64 = 100.0;

/// A control of a device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ControlInfo {
    /// The kernel's number of it.
    pub id: u32,
    /// Name as `driver.v4l2.controls` takes it.
    pub name: String,
    /// True if it does something whatever it is set to.
    pub is_button: bool,
    /// Smallest value, largest, and the step between.
    pub range: (i64, i64, u64),
    /// The value of a device that was just plugged in.
    pub default: i64,
    /// The value in force, where it can be read.
    pub value: Option<i32>,
    /// True if it can be set.
    pub is_writable: bool,
    /// True while another control governs it, as an automatic exposure governs the exposure.
    pub is_inactive: bool,
}

/// All controls with a single number as value.
pub(crate) fn list(fd: BorrowedFd<'_>) -> Vec<ControlInfo> {
    let mut found = Vec::new();
    let mut id = 0;
    while found.len() < MAX_CONTROLS
        && let Ok(description) = calls::control_description(fd, id | NEXT_CONTROL)
        && description.id > id
    {
        id = description.id;
        found.extend(info(fd, &description));
    }
    found
}

fn info(fd: BorrowedFd<'_>, description: &ControlDescription) -> Option<ControlInfo> {
    let ControlDescription { id, kind, minimum, maximum, step, default, flags, .. } = *description;
    let is_number = matches!(
        kind,
        CONTROL_INTEGER
            | CONTROL_BOOLEAN
            | CONTROL_MENU
            | CONTROL_INTEGER_MENU
            | CONTROL_BITMASK
            | CONTROL_BUTTON
    );
    if !is_number || flags & CONTROL_DISABLED != 0 || description.dimensions > 0 {
        return None;
    }
    let is_readable = flags & CONTROL_WRITE_ONLY == 0 && kind != CONTROL_BUTTON;
    Some(ControlInfo {
        id,
        name: V4l2Control::plain_name(&text(&description.name)),
        is_button: kind == CONTROL_BUTTON,
        range: (minimum, maximum, step),
        default,
        value: is_readable.then(|| calls::control(fd, id).ok()).flatten(),
        is_writable: flags & CONTROL_READ_ONLY == 0,
        is_inactive: flags & CONTROL_INACTIVE != 0,
    })
}

/// Text of the kernel up to its zero.
pub(crate) fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

/// Reason why a control cannot be set: what is wrong, with the key and the cure, or the device's error.
pub(crate) enum ControlError {
    /// It cannot be as the configuration says.
    Refused(String),
    /// The device failed.
    Device(Errno),
}

fn refused<T>(words: String) -> Result<T, ControlError> {
    Err(ControlError::Refused(words))
}

impl From<Errno> for ControlError {
    fn from(error: Errno) -> Self {
        Self::Device(error)
    }
}

/// Sets what the configuration asks for: the controls by name in their order, then exposure and gain.
pub(crate) fn apply(fd: BorrowedFd<'_>, options: &V4l2Config) -> Result<(), ControlError> {
    for (i, text) in options.controls.iter().enumerate() {
        let key = format!("driver.v4l2.controls[{i}]");
        let control =
            V4l2Control::parse(text).map_err(|why| ControlError::Refused(format!("{key}: {why}")))?;
        match &control.target {
            ControlTarget::Name(name) => set_named(fd, name, control.value, &key)?,
            ControlTarget::Extension { unit, selector, bytes } => {
                let value = &control.value.to_le_bytes()[..usize::from(*bytes).min(4)];
                set_extension(fd, (*unit, *selector), value)
                    .map_err(|why| ControlError::Refused(format!("{key}: `{text}` cannot be set: {why}")))?;
            }
        }
    }
    apply_exposure(fd, options)?;
    apply_gain(fd, options)
}

fn set_named(fd: BorrowedFd<'_>, name: &str, value: i32, key: &str) -> Result<(), ControlError> {
    let there = list(fd);
    let Some(info) = there.iter().find(|info| info.name == name) else {
        let names: Vec<_> = there.iter().map(|info| info.name.as_str()).collect();
        let names = names.join(", ");
        return refused(format!("{key}: this device has no control `{name}`; it has {names}"));
    };
    set(fd, info, value, key)
}

/// Sets a control of an extension unit, and reads back whether the camera has taken it; else the reason, with what to do.
fn set_extension(fd: BorrowedFd<'_>, (unit, selector): (u8, u8), value: &[u8]) -> Result<(), String> {
    calls::set_extension(fd, unit, selector, value).map_err(extension::why)?;
    let mut taken = vec![0; value.len()];
    calls::extension(fd, unit, selector, &mut taken).map_err(extension::why)?;
    match is_taken(value, &taken) {
        true => Ok(()),
        false => Err(format!("the camera keeps {}; is another program using it?", number(&taken))),
    }
}

/// True if a camera has taken a value. A switch is kept as it is; an exposure may be rounded to whole rows of
/// the sensor.
fn is_taken(wanted: &[u8], taken: &[u8]) -> bool {
    let (wanted, taken, is_switch) = (number(wanted), number(taken), wanted.len() == 1);
    let tolerance = if is_switch { 0 } else { wanted / 16 };
    wanted.abs_diff(taken) <= tolerance
}

/// Number of at most four bytes, least significant first.
fn number(bytes: &[u8]) -> u32 {
    bytes.iter().take(4).rev().fold(0, |number, byte| (number << 8) | u32::from(*byte))
}

/// Sets these controls of a device, as `driver.v4l2.controls` has them, as opening it does.
///
/// # Errors
/// When it cannot be opened, or does not take them.
pub fn set_controls(path: &Path, controls: &[String]) -> Result<(), DriverError> {
    let fd = node::open(path).map_err(|error| DriverError::refused(path, extension::unopened(error)))?;
    let options = V4l2Config { controls: controls.to_vec(), ..V4l2Config::default() };
    apply(fd.as_fd(), &options).map_err(|error| match error {
        ControlError::Refused(message) => DriverError::refused(path, message),
        ControlError::Device(error) => {
            DriverError::refused(path, format!("a control cannot be set: {error}"))
        }
    })
}

/// Sets one within its range.
fn set(fd: BorrowedFd<'_>, info: &ControlInfo, value: i32, key: &str) -> Result<(), ControlError> {
    let (least, most, _) = info.range;
    if !info.is_button && !(least..=most).contains(&value.into()) {
        return refused(format!("{key}: `{}` takes {least} to {most}, and not {value}", info.name));
    }
    match calls::set_control(fd, info.id, value) {
        Err(Errno::ACCESS | Errno::INVAL | Errno::RANGE | Errno::BUSY) => refused(format!(
            "{key}: the device does not take {value} for `{}` now; `plumbline devices` says which controls can be set",
            info.name
        )),
        result => Ok(result?),
    }
}

/// The control of this number, where there is one that can be set.
fn settable(fd: BorrowedFd<'_>, id: u32) -> Option<ControlInfo> {
    let description = calls::control_description(fd, id).ok()?;
    info(fd, &description).filter(|info| info.is_writable)
}

fn apply_exposure(fd: BorrowedFd<'_>, options: &V4l2Config) -> Result<(), ControlError> {
    const KEY: &str = "driver.v4l2.exposure_us";
    if options.exposure_us <= 0.0 {
        return Ok(());
    }
    // Either is missing in many devices, and neither is an end in itself.
    if settable(fd, ID_EXPOSURE_AUTO).is_some() {
        let _ = calls::set_control(fd, ID_EXPOSURE_AUTO, EXPOSURE_MANUAL);
    }
    if settable(fd, ID_EXPOSURE_AUTO_PRIORITY).is_some() {
        let _ = calls::set_control(fd, ID_EXPOSURE_AUTO_PRIORITY, 0);
    }
    let (info, unit_us) = match (settable(fd, ID_EXPOSURE_ABSOLUTE), settable(fd, ID_EXPOSURE)) {
        (Some(info), _) => (info, ABSOLUTE_UNIT_US),
        (None, Some(info)) if options.row_us > 0.0 => (info, options.row_us),
        (None, Some(_)) => {
            return refused(format!(
                "{KEY}: this device counts the exposure in rows of the sensor; give the time of a row in \
                 `driver.v4l2.row_us`, or leave it 0 and set `exposure` by `driver.v4l2.controls`"
            ));
        }
        (None, None) => return refused(format!("{KEY}: this device has no exposure to set; leave it 0")),
    };
    let steps = (options.exposure_us / unit_us).round().at_least(1.0);
    let (least, most, _) = info.range;
    if steps < least as f64 || steps > most as f64 {
        let [least_us, most_us] = [least, most].map(|steps| steps as f64 * unit_us);
        return refused(format!("{KEY}: this device takes {least_us} to {most_us} us"));
    }
    set(fd, &info, steps as i32, KEY)
}

fn apply_gain(fd: BorrowedFd<'_>, options: &V4l2Config) -> Result<(), ControlError> {
    const KEY: &str = "driver.v4l2.gain";
    if options.gain < 0.0 {
        return Ok(());
    }
    let gain = options.gain.round() as i32;
    if settable(fd, ID_AUTO_GAIN).is_some() {
        let _ = calls::set_control(fd, ID_AUTO_GAIN, 0);
    }
    match settable(fd, ID_ANALOGUE_GAIN).or_else(|| settable(fd, ID_GAIN)) {
        Some(info) => set(fd, &info, gain, KEY),
        None => refused(format!("{KEY}: this device has no gain to set; leave it -1")),
    }
}

/// Reads the exposure in force, beside the stream.
#[derive(Debug)]
pub(crate) struct ExposureProbe {
    fd: OwnedFd,
    row_us: f64,
}

impl ExposureProbe {
    /// Opens another handle of the device; `None` if the device does not report its exposure.
    pub(crate) fn new(fd: BorrowedFd<'_>, options: &V4l2Config) -> Option<Self> {
        let fd = rustix::io::fcntl_dupfd_cloexec(fd, 0).ok()?;
        let probe = Self { fd, row_us: options.row_us };
        probe.read_ns().is_some().then_some(probe)
    }

    /// The exposure, ns.
    pub(crate) fn read_ns(&self) -> Option<i64> {
        let us = match calls::control(self.fd.as_fd(), ID_EXPOSURE_ABSOLUTE) {
            Ok(steps) => f64::from(steps) * ABSOLUTE_UNIT_US,
            Err(_) if self.row_us > 0.0 => {
                f64::from(calls::control(self.fd.as_fd(), ID_EXPOSURE).ok()?) * self.row_us
            }
            Err(_) => return None,
        };
        (us > 0.0).then_some((us * 1e3) as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::is_taken;

    #[test]
    fn a_switch_is_kept_and_an_exposure_may_be_rounded() {
        assert!(is_taken(&[0], &[0]) && !is_taken(&[0], &[1]) && !is_taken(&[16], &[17]));
        let us = |number: u32| number.to_le_bytes();
        assert!(is_taken(&us(5000), &us(4989)) && !is_taken(&us(5000), &us(33_000)));
    }
}
