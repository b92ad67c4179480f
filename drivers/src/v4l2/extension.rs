//! Controls of a camera's extension units (USB Video Class): bytes that only the manufacturer explains.

use super::node;
use super::sys::calls;
use crate::DriverError;
use rustix::fd::{AsFd as _, OwnedFd};
use rustix::io::Errno;
use std::path::{Path, PathBuf};

/// Extension unit of an opened camera.
#[derive(Debug)]
pub struct ExtensionUnit {
    fd: OwnedFd,
    path: PathBuf,
    unit: u8,
}

impl ExtensionUnit {
    /// Opens a node of the camera.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn open(path: &Path, unit: u8) -> Result<Self, DriverError> {
        let fd = node::open(path).map_err(|error| DriverError::device(path, unopened(error)))?;
        Ok(Self { fd, path: path.into(), unit })
    }

    /// Sets a control.
    ///
    /// # Errors
    /// When the camera does not take it.
    pub fn set(&self, selector: u8, value: &[u8]) -> Result<(), DriverError> {
        let set = calls::set_extension(self.fd.as_fd(), self.unit, selector, value);
        set.map_err(|error| self.refused(selector, "set", error))
    }

    /// Reads a control, as many bytes as `value` has.
    ///
    /// # Errors
    /// When the camera does not give it.
    pub fn get(&self, selector: u8, value: &mut [u8]) -> Result<(), DriverError> {
        let got = calls::extension(self.fd.as_fd(), self.unit, selector, value);
        got.map_err(|error| self.refused(selector, "read", error))
    }

    fn refused(&self, selector: u8, doing: &str, error: Errno) -> DriverError {
        let control = format!("control {selector} of extension unit {}", self.unit);
        DriverError::device(&self.path, format!("{control} cannot be {doing}: {}", why(error)))
    }
}

/// Reason why a node cannot be opened, and the cure.
pub(crate) fn unopened(error: Errno) -> String {
    match error {
        Errno::ACCESS | Errno::PERM => "may not be opened; add this user to the group `video`".into(),
        Errno::BUSY => "is in use by another program; end it".into(),
        Errno::NOENT | Errno::NODEV => "is not there; `plumbline devices` lists the cameras that are".into(),
        error => format!("cannot be opened: {error}"),
    }
}

/// Reason why a control cannot be used, and the cure.
pub(crate) fn why(error: Errno) -> String {
    match error {
        Errno::NOTTY => "this node is no camera of the kernel's driver for USB (uvcvideo)".into(),
        Errno::NOENT => "this camera has no such control; is it the node of the stereo module?".into(),
        Errno::NOBUFS | Errno::INVAL => "its length or value is another; the firmware may be too old".into(),
        Errno::BUSY => "another program holds the camera; end it".into(),
        error => format!("{error}; plug the camera in again"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::v4l2::set_controls;

    #[test]
    fn what_is_no_usb_camera_is_named_with_the_cause() {
        let path = Path::new("/dev/null");
        let unit = ExtensionUnit::open(path, 3).unwrap();
        let error = unit.set(1, &[0; 1024]).unwrap_err().to_string();
        assert!(
            error.contains("/dev/null: control 1 of extension unit 3") && error.contains("uvcvideo"),
            "{error}"
        );
        assert!(unit.get(2, &mut [0]).is_err());
        let error = set_controls(path, &["xu:3:2:1=0".into()]).unwrap_err().to_string();
        assert!(error.contains("`xu:3:2:1=0` cannot be set") && error.contains("uvcvideo"), "{error}");
        let error = ExtensionUnit::open(Path::new("/dev/video-none"), 3).unwrap_err().to_string();
        assert!(error.contains("is not there"), "{error}");
    }

    #[test]
    fn a_value_longer_than_the_interface_carries_is_refused() {
        let unit = ExtensionUnit::open(Path::new("/dev/null"), 3).unwrap();
        assert!(unit.set(1, &vec![0; 1 << 16]).is_err());
    }
}
