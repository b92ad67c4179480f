//! Nodes of the kernel, of which a camera has several: one brings images.

use super::sys::abi::{
    CAP_DEVICE_CAPS, CAP_STREAMING, CAP_VIDEO_CAPTURE, CAP_VIDEO_CAPTURE_MPLANE, Capability, KIND_CAPTURE,
    KIND_CAPTURE_MPLANE,
};
use rustix::fd::OwnedFd;
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use std::path::Path;

/// Opens a node, not to wait in any call.
pub(crate) fn open(path: &Path) -> Result<OwnedFd, Errno> {
    rustix::fs::open(path, OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC, Mode::empty())
}

/// Buffer type: single-planar or multi-planar; `None` for a node that brings no images, or not into buffers.
pub(crate) fn capture_kind(capability: &Capability) -> Option<u32> {
    // Of the node itself, where the driver tells them apart from those of the whole camera.
    let capabilities = match capability.capabilities & CAP_DEVICE_CAPS != 0 {
        true => capability.device_caps,
        false => capability.capabilities,
    };
    let has = |what: u32| capabilities & (what | CAP_STREAMING) == what | CAP_STREAMING;
    match (has(CAP_VIDEO_CAPTURE), has(CAP_VIDEO_CAPTURE_MPLANE)) {
        (true, _) => Some(KIND_CAPTURE),
        (false, true) => Some(KIND_CAPTURE_MPLANE),
        (false, false) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::v4l2::sys::abi::Zero as _;

    #[test]
    fn the_node_of_the_images_is_told_from_that_of_the_metadata() {
        let with = |device_caps: u32| Capability {
            // A camera of UVC: images and metadata.
            capabilities: 0x84a0_0001,
            device_caps,
            ..Capability::ZERO
        };
        assert_eq!(capture_kind(&with(0x0420_0001)), Some(KIND_CAPTURE));
        assert_eq!(capture_kind(&with(0x04a0_0000)), None);
        assert_eq!(capture_kind(&with(0x0420_1000)), Some(KIND_CAPTURE_MPLANE));
        let old = Capability { capabilities: 0x0400_0001, ..Capability::ZERO };
        assert_eq!(capture_kind(&old), Some(KIND_CAPTURE));
        assert_eq!(capture_kind(&Capability { capabilities: 0x0100_0001, ..Capability::ZERO }), None);
    }
}
