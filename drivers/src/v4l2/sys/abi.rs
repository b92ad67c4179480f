//! Structs and numbers of `linux/videodev2.h`, as far as cameras need them. Where the header has a union, here are the
//! members that are used and padding; a test compares sizes and offsets with the header of the system.

#[cfg(not(target_pointer_width = "64"))]
compile_error!("the layout of these structs is that of 64-bit systems");

/// All-zero value of a struct before the call.
pub(crate) trait Zero: Copy {
    const ZERO: Self;
}

macro_rules! zero {
    ($($type:ident)*) => {$(impl Zero for $type { const ZERO: Self = 0; })*};
}

zero! { u8 u16 u32 u64 i32 i64 }

impl<T: Zero, const N: usize> Zero for [T; N] {
    const ZERO: Self = [T::ZERO; N];
}

/// Structs of the header with their fields, and their zeros.
macro_rules! abi {
    ($($(#[$doc:meta])* $name:ident { $($field:ident: $type:ty,)* })*) => {$(
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug)]
        pub(crate) struct $name { $(pub(crate) $field: $type,)* }

        impl Zero for $name {
            const ZERO: Self = Self { $($field: Zero::ZERO,)* };
        }
    )*};
}

abi! {
    /// `v4l2_capability`.
    Capability {
        driver: [u8; 16],
        card: [u8; 32],
        bus_info: [u8; 32],
        version: u32,
        capabilities: u32,
        device_caps: u32,
        reserved: [u32; 3],
    }

    /// `v4l2_fmtdesc`.
    FormatDescription {
        index: u32,
        kind: u32,
        flags: u32,
        description: [u8; 32],
        fourcc: u32,
        bus_code: u32,
        reserved: [u32; 3],
    }

    /// `v4l2_frmsizeenum`: `sizes` is width and height, or smallest, largest and step of the width, then of the height.
    FrameSize {
        index: u32,
        fourcc: u32,
        kind: u32,
        sizes: [u32; 6],
        reserved: [u32; 2],
    }

    /// `v4l2_frmivalenum`: `fractions` are numerator and denominator of the interval in seconds, or of the shortest,
    /// the longest and the step.
    FrameInterval {
        index: u32,
        fourcc: u32,
        width: u32,
        height: u32,
        kind: u32,
        fractions: [u32; 6],
        reserved: [u32; 2],
    }

    /// `v4l2_format` with `v4l2_pix_format`.
    Format {
        kind: u32,
        align: u32,
        width: u32,
        height: u32,
        fourcc: u32,
        field: u32,
        stride: u32,
        size: u32,
        colorspace: u32,
        private: u32,
        flags: u32,
        encoding: u32,
        quantization: u32,
        transfer: u32,
        rest: [u64; 19],
    }

    /// `v4l2_plane_pix_format`.
    PlaneFormat {
        size: u32,
        stride: u32,
        reserved: [u16; 6],
    }

    /// `v4l2_format` with `v4l2_pix_format_mplane`.
    PlanarFormat {
        kind: u32,
        align: u32,
        width: u32,
        height: u32,
        fourcc: u32,
        field: u32,
        colorspace: u32,
        planes: [PlaneFormat; MAX_PLANES],
        plane_count: u8,
        flags: u8,
        encoding: u8,
        quantization: u8,
        transfer: u8,
        reserved: [u8; 7],
        rest: u64,
    }

    /// `v4l2_streamparm` with `v4l2_captureparm`.
    StreamParameters {
        kind: u32,
        capability: u32,
        mode: u32,
        numerator: u32,
        denominator: u32,
        extended: u32,
        read_buffers: u32,
        rest: [u32; 44],
    }

    /// `v4l2_requestbuffers`.
    RequestBuffers {
        count: u32,
        kind: u32,
        memory: u32,
        capabilities: u32,
        flags: u8,
        reserved: [u8; 3],
    }

    /// `v4l2_plane`; `place` is a union, of which `mem_offset` is the first four bytes.
    Plane {
        bytes_used: u32,
        length: u32,
        place: [u32; 2],
        data_offset: u32,
        reserved: [u32; 11],
    }

    /// `v4l2_buffer`; `place` is a union: `offset` in its first four bytes, or the address of the planes.
    Buffer {
        index: u32,
        kind: u32,
        bytes_used: u32,
        flags: u32,
        field: u32,
        align: u32,
        seconds: i64,
        microseconds: i64,
        timecode: [u32; 4],
        sequence: u32,
        memory: u32,
        place: u64,
        length: u32,
        reserved: u32,
        request: i32,
        end: u32,
    }

    /// `uvc_xu_control_query` of `linux/uvcvideo.h`; `data` is an address.
    ExtensionQuery {
        unit: u8,
        selector: u8,
        query: u8,
        align: u8,
        size: u16,
        align_2: u16,
        data: u64,
    }

    /// `v4l2_control`.
    Control {
        id: u32,
        value: i32,
    }

    /// `v4l2_query_ext_ctrl`.
    ControlDescription {
        id: u32,
        kind: u32,
        name: [u8; 32],
        minimum: i64,
        maximum: i64,
        step: u64,
        default: i64,
        flags: u32,
        element_size: u32,
        elements: u32,
        dimensions: u32,
        sizes: [u32; 4],
        reserved: [u32; 32],
    }
}

/// `VIDEO_MAX_PLANES`.
pub(crate) const MAX_PLANES: usize = 8;

/// `V4L2_CAP_VIDEO_CAPTURE`, of `Capability::device_caps`.
pub(crate) const CAP_VIDEO_CAPTURE: u32 = 0x0000_0001;
/// `V4L2_CAP_VIDEO_CAPTURE_MPLANE`.
pub(crate) const CAP_VIDEO_CAPTURE_MPLANE: u32 = 0x0000_1000;
/// `V4L2_CAP_STREAMING`.
pub(crate) const CAP_STREAMING: u32 = 0x0400_0000;
/// `V4L2_CAP_DEVICE_CAPS`, of `Capability::capabilities`: `device_caps` is filled in.
pub(crate) const CAP_DEVICE_CAPS: u32 = 0x8000_0000;

/// `V4L2_BUF_TYPE_VIDEO_CAPTURE`.
pub(crate) const KIND_CAPTURE: u32 = 1;
/// `V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE`.
pub(crate) const KIND_CAPTURE_MPLANE: u32 = 9;
/// `V4L2_MEMORY_MMAP`.
pub(crate) const MEMORY_MMAP: u32 = 1;
/// `V4L2_FIELD_NONE`: progressive.
pub(crate) const FIELD_NONE: u32 = 1;
/// `V4L2_CAP_TIMEPERFRAME`, of `StreamParameters::capability`.
pub(crate) const CAP_TIME_PER_FRAME: u32 = 0x1000;

/// `V4L2_BUF_FLAG_ERROR`.
pub(crate) const FLAG_ERROR: u32 = 0x0000_0040;
/// `V4L2_BUF_FLAG_TSTAMP_SRC_MASK`.
pub(crate) const FLAG_SOURCE_MASK: u32 = 0x0007_0000;
/// `V4L2_BUF_FLAG_TSTAMP_SRC_SOE`.
pub(crate) const FLAG_SOURCE_START: u32 = 0x0001_0000;

/// `V4L2_FRMSIZE_TYPE_DISCRETE` and `V4L2_FRMIVAL_TYPE_DISCRETE`.
pub(crate) const KIND_DISCRETE: u32 = 1;

/// Requests of the USB Video Class (`linux/usb/video.h`): set a control, read it.
pub(crate) const UVC_SET: u8 = 0x01;
pub(crate) const UVC_GET: u8 = 0x81;

/// `V4L2_CTRL_FLAG_NEXT_CTRL`, added to an id.
pub(crate) const NEXT_CONTROL: u32 = 0x8000_0000;
/// `V4L2_CTRL_FLAG_DISABLED`.
pub(crate) const CONTROL_DISABLED: u32 = 0x0001;
/// `V4L2_CTRL_FLAG_READ_ONLY`.
pub(crate) const CONTROL_READ_ONLY: u32 = 0x0004;
/// `V4L2_CTRL_FLAG_INACTIVE`.
pub(crate) const CONTROL_INACTIVE: u32 = 0x0010;
/// `V4L2_CTRL_FLAG_WRITE_ONLY`.
pub(crate) const CONTROL_WRITE_ONLY: u32 = 0x0040;

/// `V4L2_CTRL_TYPE_INTEGER`.
pub(crate) const CONTROL_INTEGER: u32 = 1;
/// `V4L2_CTRL_TYPE_BOOLEAN`.
pub(crate) const CONTROL_BOOLEAN: u32 = 2;
/// `V4L2_CTRL_TYPE_MENU`.
pub(crate) const CONTROL_MENU: u32 = 3;
/// `V4L2_CTRL_TYPE_BUTTON`.
pub(crate) const CONTROL_BUTTON: u32 = 4;
/// `V4L2_CTRL_TYPE_BITMASK`.
pub(crate) const CONTROL_BITMASK: u32 = 8;
/// `V4L2_CTRL_TYPE_INTEGER_MENU`.
pub(crate) const CONTROL_INTEGER_MENU: u32 = 9;

/// `V4L2_CID_EXPOSURE`: often counted in rows of the sensor.
pub(crate) const ID_EXPOSURE: u32 = 0x0098_0911;
/// `V4L2_CID_AUTOGAIN`.
pub(crate) const ID_AUTO_GAIN: u32 = 0x0098_0912;
/// `V4L2_CID_GAIN`.
pub(crate) const ID_GAIN: u32 = 0x0098_0913;
/// `V4L2_CID_EXPOSURE_AUTO`: a menu, of which 1 is manual.
pub(crate) const ID_EXPOSURE_AUTO: u32 = 0x009a_0901;
/// `V4L2_CID_EXPOSURE_ABSOLUTE`: in units of 100 us.
pub(crate) const ID_EXPOSURE_ABSOLUTE: u32 = 0x009a_0902;
/// `V4L2_CID_EXPOSURE_AUTO_PRIORITY`: 1 lets the exposure lower the rate.
pub(crate) const ID_EXPOSURE_AUTO_PRIORITY: u32 = 0x009a_0903;
/// `V4L2_CID_ANALOGUE_GAIN`.
pub(crate) const ID_ANALOGUE_GAIN: u32 = 0x009e_0903;
/// `V4L2_EXPOSURE_MANUAL`.
pub(crate) const EXPOSURE_MANUAL: i32 = 1;

#[cfg(test)]
mod tests;
