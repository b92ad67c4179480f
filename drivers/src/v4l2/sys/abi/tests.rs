//! The structs against the header of this system, by its compiler.

use super::*;
use std::fmt::Write as _;
use std::mem::{offset_of, size_of};
use std::process::Command;

/// Name in C and in Rust, size, and fields in C with their offsets here.
type Layout = (&'static str, usize, Vec<(&'static str, usize)>);

macro_rules! layout {
    ($c:literal, $rust:ident { $($field:literal $member:ident),* $(,)? }) => {
        ($c, size_of::<$rust>(), vec![$(($field, offset_of!($rust, $member))),*])
    };
}

fn layouts() -> Vec<Layout> {
    vec![
        layout!("struct v4l2_capability", Capability {
            "driver" driver, "card" card, "bus_info" bus_info, "version" version,
            "capabilities" capabilities, "device_caps" device_caps,
        }),
        layout!("struct v4l2_fmtdesc", FormatDescription {
            "index" index, "type" kind, "flags" flags, "description" description, "pixelformat" fourcc,
        }),
        layout!("struct v4l2_frmsizeenum", FrameSize {
            "index" index, "pixel_format" fourcc, "type" kind, "discrete.width" sizes, "stepwise.min_width" sizes,
        }),
        layout!("struct v4l2_frmivalenum", FrameInterval {
            "index" index, "pixel_format" fourcc, "width" width, "height" height, "type" kind,
            "discrete.numerator" fractions, "stepwise.min" fractions,
        }),
        layout!("struct v4l2_format", Format {
            "type" kind, "fmt.pix.width" width, "fmt.pix.height" height, "fmt.pix.pixelformat" fourcc,
            "fmt.pix.field" field, "fmt.pix.bytesperline" stride, "fmt.pix.sizeimage" size,
            "fmt.pix.colorspace" colorspace, "fmt.pix.xfer_func" transfer,
        }),
        layout!("struct v4l2_plane_pix_format", PlaneFormat { "sizeimage" size, "bytesperline" stride }),
        layout!("struct v4l2_format", PlanarFormat {
            "type" kind, "fmt.pix_mp.width" width, "fmt.pix_mp.height" height,
            "fmt.pix_mp.pixelformat" fourcc, "fmt.pix_mp.field" field, "fmt.pix_mp.plane_fmt" planes,
            "fmt.pix_mp.num_planes" plane_count, "fmt.pix_mp.flags" flags, "fmt.pix_mp.reserved" reserved,
        }),
        layout!("struct v4l2_streamparm", StreamParameters {
            "type" kind, "parm.capture.capability" capability, "parm.capture.timeperframe.numerator" numerator,
            "parm.capture.timeperframe.denominator" denominator, "parm.capture.readbuffers" read_buffers,
        }),
        layout!("struct v4l2_requestbuffers", RequestBuffers {
            "count" count, "type" kind, "memory" memory, "capabilities" capabilities, "flags" flags,
        }),
        layout!("struct v4l2_plane", Plane {
            "bytesused" bytes_used, "length" length, "m.mem_offset" place, "data_offset" data_offset,
        }),
        layout!("struct v4l2_buffer", Buffer {
            "index" index, "type" kind, "bytesused" bytes_used, "flags" flags, "field" field,
            "timestamp.tv_sec" seconds, "timestamp.tv_usec" microseconds, "timecode" timecode,
            "sequence" sequence, "memory" memory, "m.offset" place, "m.planes" place, "length" length,
            "request_fd" request,
        }),
        layout!("struct uvc_xu_control_query", ExtensionQuery {
            "unit" unit, "selector" selector, "query" query, "size" size, "data" data,
        }),
        layout!("struct v4l2_control", Control { "id" id, "value" value }),
        layout!("struct v4l2_query_ext_ctrl", ControlDescription {
            "id" id, "type" kind, "name" name, "minimum" minimum, "maximum" maximum, "step" step,
            "default_value" default, "flags" flags, "dims" sizes, "reserved" reserved,
        }),
    ]
}

fn constants() -> Vec<(&'static str, u32)> {
    vec![
        ("VIDEO_MAX_PLANES", MAX_PLANES as u32),
        ("V4L2_CAP_VIDEO_CAPTURE", CAP_VIDEO_CAPTURE),
        ("V4L2_CAP_VIDEO_CAPTURE_MPLANE", CAP_VIDEO_CAPTURE_MPLANE),
        ("V4L2_CAP_STREAMING", CAP_STREAMING),
        ("V4L2_CAP_DEVICE_CAPS", CAP_DEVICE_CAPS),
        ("V4L2_BUF_TYPE_VIDEO_CAPTURE", KIND_CAPTURE),
        ("V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE", KIND_CAPTURE_MPLANE),
        ("V4L2_MEMORY_MMAP", MEMORY_MMAP),
        ("V4L2_FIELD_NONE", FIELD_NONE),
        ("V4L2_CAP_TIMEPERFRAME", CAP_TIME_PER_FRAME),
        ("V4L2_BUF_FLAG_ERROR", FLAG_ERROR),
        ("V4L2_BUF_FLAG_TSTAMP_SRC_MASK", FLAG_SOURCE_MASK),
        ("V4L2_BUF_FLAG_TSTAMP_SRC_SOE", FLAG_SOURCE_START),
        ("V4L2_FRMSIZE_TYPE_DISCRETE", KIND_DISCRETE),
        ("V4L2_FRMIVAL_TYPE_DISCRETE", KIND_DISCRETE),
        ("V4L2_CTRL_FLAG_NEXT_CTRL", NEXT_CONTROL),
        ("V4L2_CTRL_FLAG_DISABLED", CONTROL_DISABLED),
        ("V4L2_CTRL_FLAG_READ_ONLY", CONTROL_READ_ONLY),
        ("V4L2_CTRL_FLAG_INACTIVE", CONTROL_INACTIVE),
        ("V4L2_CTRL_FLAG_WRITE_ONLY", CONTROL_WRITE_ONLY),
        ("V4L2_CTRL_TYPE_INTEGER", CONTROL_INTEGER),
        ("V4L2_CTRL_TYPE_BOOLEAN", CONTROL_BOOLEAN),
        ("V4L2_CTRL_TYPE_MENU", CONTROL_MENU),
        ("V4L2_CTRL_TYPE_BUTTON", CONTROL_BUTTON),
        ("V4L2_CTRL_TYPE_BITMASK", CONTROL_BITMASK),
        ("V4L2_CTRL_TYPE_INTEGER_MENU", CONTROL_INTEGER_MENU),
        ("V4L2_CID_EXPOSURE", ID_EXPOSURE),
        ("V4L2_CID_AUTOGAIN", ID_AUTO_GAIN),
        ("V4L2_CID_GAIN", ID_GAIN),
        ("V4L2_CID_EXPOSURE_AUTO", ID_EXPOSURE_AUTO),
        ("V4L2_CID_EXPOSURE_ABSOLUTE", ID_EXPOSURE_ABSOLUTE),
        ("V4L2_CID_EXPOSURE_AUTO_PRIORITY", ID_EXPOSURE_AUTO_PRIORITY),
        ("V4L2_CID_ANALOGUE_GAIN", ID_ANALOGUE_GAIN),
        ("V4L2_EXPOSURE_MANUAL", EXPOSURE_MANUAL as u32),
        ("UVC_SET_CUR", u32::from(UVC_SET)),
        ("UVC_GET_CUR", u32::from(UVC_GET)),
        ("UVCIOC_CTRL_QUERY", super::super::calls::QUERY_EXTENSION),
        ("VIDIOC_QUERYCAP", super::super::calls::QUERY_CAPABILITY),
        ("VIDIOC_ENUM_FMT", super::super::calls::ENUM_FORMAT),
        ("VIDIOC_S_FMT", super::super::calls::SET_FORMAT),
        ("VIDIOC_REQBUFS", super::super::calls::REQUEST_BUFFERS),
        ("VIDIOC_QUERYBUF", super::super::calls::QUERY_BUFFER),
        ("VIDIOC_QBUF", super::super::calls::QUEUE_BUFFER),
        ("VIDIOC_DQBUF", super::super::calls::DEQUEUE_BUFFER),
        ("VIDIOC_STREAMON", super::super::calls::STREAM_ON),
        ("VIDIOC_STREAMOFF", super::super::calls::STREAM_OFF),
        ("VIDIOC_G_PARM", super::super::calls::GET_PARAMETERS),
        ("VIDIOC_S_PARM", super::super::calls::SET_PARAMETERS),
        ("VIDIOC_G_CTRL", super::super::calls::GET_CONTROL),
        ("VIDIOC_S_CTRL", super::super::calls::SET_CONTROL),
        ("VIDIOC_QUERY_EXT_CTRL", super::super::calls::QUERY_CONTROL),
        ("VIDIOC_ENUM_FRAMESIZES", super::super::calls::ENUM_SIZE),
        ("VIDIOC_ENUM_FRAMEINTERVALS", super::super::calls::ENUM_INTERVAL),
    ]
}

/// A program that cannot be compiled unless the header says the same.
fn program() -> String {
    let mut text = "#include <stddef.h>\n#include <sys/time.h>\n#include <linux/videodev2.h>\n\
                    #include <linux/uvcvideo.h>\n#include <linux/usb/video.h>\n"
        .to_owned();
    for (name, size, fields) in layouts() {
        writeln!(text, "_Static_assert(sizeof({name}) == {size}, \"size of {name}\");").unwrap();
        for (field, offset) in fields {
            let claim = format!("offsetof({name}, {field}) == {offset}");
            writeln!(text, "_Static_assert({claim}, \"{claim}\");").unwrap();
        }
    }
    for (name, value) in constants() {
        writeln!(text, "_Static_assert((unsigned)({name}) == {value}u, \"{name}\");").unwrap();
    }
    text
}

#[test]
fn structs_and_numbers_are_those_of_the_system() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("layout.c");
    std::fs::write(&source, program()).unwrap();
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".into());
    let output =
        Command::new(compiler).arg("-fsyntax-only").arg(&source).output().expect("the linker's driver");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
