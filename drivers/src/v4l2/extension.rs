//! Reasons why controls of a camera's extension units (USB Video Class) cannot be set.

use rustix::io::Errno;

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
    use crate::v4l2::set_controls;
    use std::path::Path;

    #[test]
    fn what_is_no_usb_camera_is_named_with_the_cause() {
        let refused =
            |path: &str| set_controls(Path::new(path), &["xu:3:2:1=0".into()]).unwrap_err().to_string();
        let error = refused("/dev/null");
        assert!(error.contains("`xu:3:2:1=0` cannot be set") && error.contains("uvcvideo"), "{error}");
        assert!(refused("/dev/video-none").contains("is not there"));
    }
}
