//! The cameras of this computer: what they offer, and the names by which they are found again.

use super::controls::{self, ControlInfo};
use super::format::{PixelFormat, fourcc_text};
use super::node;
use super::offers::{SizeInfo, fourccs, size_list};
use super::sys::calls;
use crate::sysfs::entries;
use rustix::fd::AsFd as _;
use serde::Serialize;
use std::fmt::{self, Display};
use std::path::{Path, PathBuf};

/// A camera, or another node that brings images.
#[derive(Clone, Debug, Serialize)]
pub struct CameraInfo {
    /// Node, whose number depends on the order of plugging in.
    pub path: PathBuf,
    /// Names that lead to it whenever it is there: by the port, then by the device itself.
    pub stable_paths: Vec<PathBuf>,
    /// Name given by the device.
    pub card: String,
    /// The kernel's driver.
    pub driver: String,
    /// Bus address.
    pub bus: String,
    /// Formats that it can send.
    pub formats: Vec<FormatInfo>,
    /// Controls that it has.
    pub controls: Vec<ControlInfo>,
}

/// A format of a device.
#[derive(Clone, Debug, Serialize)]
pub struct FormatInfo {
    /// The kernel's code, such as `YUYV`.
    pub code: String,
    /// Conversion to grey; `None` for a format that is not supported.
    pub format: Option<PixelFormat>,
    /// Sizes, with their rates.
    pub sizes: Vec<SizeInfo>,
}

/// Every camera there is, by the number of its node.
pub fn cameras() -> Vec<CameraInfo> {
    let mut numbers: Vec<u32> = entries(Path::new("/sys/class/video4linux"))
        .iter()
        .filter_map(|entry| entry.file_name()?.to_str()?.strip_prefix("video")?.parse().ok())
        .collect();
    numbers.sort_unstable();
    numbers.into_iter().filter_map(|number| camera(&PathBuf::from(format!("/dev/video{number}")))).collect()
}

/// Description of a node; `None` if it brings no images or cannot be opened.
fn camera(path: &Path) -> Option<CameraInfo> {
    let fd = node::open(path).ok()?;
    let fd = fd.as_fd();
    let capability = calls::capability(fd).ok()?;
    let kind = node::capture_kind(&capability)?;
    let format = |fourcc: u32| FormatInfo {
        code: fourcc_text(fourcc),
        format: PixelFormat::from_fourcc(fourcc),
        sizes: size_list(fd, fourcc),
    };
    Some(CameraInfo {
        path: path.to_owned(),
        stable_paths: stable_paths(path),
        card: controls::text(&capability.card),
        driver: controls::text(&capability.driver),
        bus: controls::text(&capability.bus_info),
        formats: fourccs(fd, kind).into_iter().map(format).collect(),
        controls: controls::list(fd),
    })
}

/// Links of udev that lead to this node.
fn stable_paths(path: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for folder in ["/dev/v4l/by-path", "/dev/v4l/by-id"] {
        let leads_here = |link: &PathBuf| link.canonicalize().is_ok_and(|target| target == path);
        found.extend(entries(Path::new(folder)).into_iter().filter(leads_here));
    }
    found
}

impl Display for CameraInfo {
    /// Names, formats and controls, a line each.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} ({}, {}) at {}", self.card, self.driver, self.bus, self.path.display())?;
        for path in &self.stable_paths {
            writeln!(f, "  {}", path.display())?;
        }
        for format in &self.formats {
            let note = if format.format.is_none() { " (not read here)" } else { "" };
            writeln!(f, "  {}{note}", format.code)?;
            for size in &format.sizes {
                writeln!(f, "    {} px: {}", size.size_text(), size.rates)?;
            }
        }
        self.controls.iter().try_for_each(|control| writeln!(f, "  {control}"))
    }
}

impl Display for ControlInfo {
    /// As `driver.v4l2.controls` takes it, with its range.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (least, most, _) = self.range;
        f.write_str(&self.name)?;
        if let Some(value) = self.value {
            write!(f, "={value}")?;
        }
        match self.is_button {
            true => f.write_str(" (button")?,
            false => write!(f, " ({least} to {most}; default {}", self.default)?,
        }
        let notes = [(!self.is_writable, "read only"), (self.is_inactive, "not in force")];
        notes.iter().filter(|(is, _)| *is).try_for_each(|(_, note)| write!(f, "; {note}"))?;
        f.write_str(")")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_control_is_shown_as_the_configuration_takes_it() {
        let control = ControlInfo {
            id: 1,
            name: "power_line_frequency".into(),
            is_button: false,
            range: (0, 1, 1),
            default: 1,
            value: Some(0),
            is_writable: true,
            is_inactive: true,
        };
        let shown = "power_line_frequency=0 (0 to 1; default 1; not in force)";
        assert_eq!(control.to_string(), shown);
    }
}
