//! The kernel's calls, each with the struct it takes. A call that a signal interrupts is made again.

use super::abi::{
    Buffer, Capability, Control, ControlDescription, ExtensionQuery, Format, FormatDescription,
    FrameInterval, FrameSize, KIND_CAPTURE_MPLANE, MAX_PLANES, MEMORY_MMAP, PlanarFormat, Plane,
    RequestBuffers, StreamParameters, UVC_GET, UVC_SET, Zero,
};
use rustix::fd::BorrowedFd;
use rustix::io::Errno;
use rustix::ioctl::{self, Opcode, Updater, opcode};

pub(crate) const QUERY_CAPABILITY: Opcode = opcode::read::<Capability>(b'V', 0);
pub(crate) const ENUM_FORMAT: Opcode = opcode::read_write::<FormatDescription>(b'V', 2);
pub(crate) const SET_FORMAT: Opcode = opcode::read_write::<Format>(b'V', 5);
pub(crate) const REQUEST_BUFFERS: Opcode = opcode::read_write::<RequestBuffers>(b'V', 8);
pub(crate) const QUERY_BUFFER: Opcode = opcode::read_write::<Buffer>(b'V', 9);
pub(crate) const QUEUE_BUFFER: Opcode = opcode::read_write::<Buffer>(b'V', 15);
pub(crate) const DEQUEUE_BUFFER: Opcode = opcode::read_write::<Buffer>(b'V', 17);
pub(crate) const STREAM_ON: Opcode = opcode::write::<u32>(b'V', 18);
pub(crate) const STREAM_OFF: Opcode = opcode::write::<u32>(b'V', 19);
pub(crate) const GET_PARAMETERS: Opcode = opcode::read_write::<StreamParameters>(b'V', 21);
pub(crate) const SET_PARAMETERS: Opcode = opcode::read_write::<StreamParameters>(b'V', 22);
pub(crate) const GET_CONTROL: Opcode = opcode::read_write::<Control>(b'V', 27);
pub(crate) const SET_CONTROL: Opcode = opcode::read_write::<Control>(b'V', 28);
pub(crate) const ENUM_SIZE: Opcode = opcode::read_write::<FrameSize>(b'V', 74);
pub(crate) const ENUM_INTERVAL: Opcode = opcode::read_write::<FrameInterval>(b'V', 75);
pub(crate) const QUERY_EXTENSION: Opcode = opcode::read_write::<ExtensionQuery>(b'u', 0x21);
pub(crate) const QUERY_CONTROL: Opcode = opcode::read_write::<ControlDescription>(b'V', 103);

/// Makes a call whose number is that of a `T` without pointers.
#[allow(unsafe_code)]
fn call<const OPCODE: Opcode, T: Copy>(fd: BorrowedFd<'_>, value: &mut T) -> Result<(), Errno> {
    loop {
        // SAFETY: the numbers above are made with the size of the struct that each function below passes: a kernel or
        // driver that does not know a number refuses it (ENOTTY), and one that knows it copies that many bytes from
        // and to `value`, which is plain data of integers, valid whatever the bytes are.
        match unsafe { ioctl::ioctl(fd, Updater::<OPCODE, T>::new(value)) } {
            Err(Errno::INTR) => {}
            result => return result,
        }
    }
}

/// Queries the capabilities of the device.
pub(crate) fn capability(fd: BorrowedFd<'_>) -> Result<Capability, Errno> {
    let mut value = Capability::ZERO;
    call::<QUERY_CAPABILITY, _>(fd, &mut value).map(|()| value)
}

/// The pixel format of this index; `EINVAL` beyond the last.
pub(crate) fn format_description(
    fd: BorrowedFd<'_>,
    kind: u32,
    index: u32,
) -> Result<FormatDescription, Errno> {
    let mut value = FormatDescription { index, kind, ..Zero::ZERO };
    call::<ENUM_FORMAT, _>(fd, &mut value).map(|()| value)
}

/// The frame size of this index; `EINVAL` beyond the last.
pub(crate) fn frame_size(fd: BorrowedFd<'_>, fourcc: u32, index: u32) -> Result<FrameSize, Errno> {
    let mut value = FrameSize { index, fourcc, ..Zero::ZERO };
    call::<ENUM_SIZE, _>(fd, &mut value).map(|()| value)
}

/// The frame interval of this index; `EINVAL` beyond the last.
pub(crate) fn frame_interval(
    fd: BorrowedFd<'_>,
    fourcc: u32,
    (width, height): (u32, u32),
    index: u32,
) -> Result<FrameInterval, Errno> {
    let mut value = FrameInterval { index, fourcc, width, height, ..Zero::ZERO };
    call::<ENUM_INTERVAL, _>(fd, &mut value).map(|()| value)
}

/// Asks for a format; `value` is then what the driver has set.
pub(crate) fn set_format(fd: BorrowedFd<'_>, value: &mut Format) -> Result<(), Errno> {
    call::<SET_FORMAT, _>(fd, value)
}

/// Sets the format of a multi-planar device; `value` then holds what the driver has set.
pub(crate) fn set_planar_format(fd: BorrowedFd<'_>, value: &mut PlanarFormat) -> Result<(), Errno> {
    const { assert!(size_of::<PlanarFormat>() == size_of::<Format>()) };
    call::<SET_FORMAT, _>(fd, value)
}

/// The frame interval in force.
pub(crate) fn parameters(fd: BorrowedFd<'_>, kind: u32) -> Result<StreamParameters, Errno> {
    let mut value = StreamParameters { kind, ..Zero::ZERO };
    call::<GET_PARAMETERS, _>(fd, &mut value).map(|()| value)
}

/// Asks for a frame interval; `value` is then what the driver has set.
pub(crate) fn set_parameters(fd: BorrowedFd<'_>, value: &mut StreamParameters) -> Result<(), Errno> {
    call::<SET_PARAMETERS, _>(fd, value)
}

/// The value of a control.
pub(crate) fn control(fd: BorrowedFd<'_>, id: u32) -> Result<i32, Errno> {
    let mut value = Control { id, ..Zero::ZERO };
    call::<GET_CONTROL, _>(fd, &mut value).map(|()| value.value)
}

/// Sets a control.
pub(crate) fn set_control(fd: BorrowedFd<'_>, id: u32, value: i32) -> Result<(), Errno> {
    call::<SET_CONTROL, _>(fd, &mut Control { id, value })
}

/// The control of this id, or the next one where [`NEXT_CONTROL`](super::abi::NEXT_CONTROL) is added; `EINVAL` when
/// there is none.
pub(crate) fn control_description(fd: BorrowedFd<'_>, id: u32) -> Result<ControlDescription, Errno> {
    let mut value = ControlDescription { id, ..Zero::ZERO };
    call::<QUERY_CONTROL, _>(fd, &mut value).map(|()| value)
}

/// Asks for so many buffers, which the kernel allocates; how many there are.
pub(crate) fn request_buffers(fd: BorrowedFd<'_>, kind: u32, count: u32) -> Result<u32, Errno> {
    let mut value = RequestBuffers { count, kind, memory: MEMORY_MMAP, ..Zero::ZERO };
    call::<REQUEST_BUFFERS, _>(fd, &mut value).map(|()| value.count)
}

/// Starts or stops the stream.
pub(crate) fn stream(fd: BorrowedFd<'_>, mut kind: u32, on: bool) -> Result<(), Errno> {
    match on {
        true => call::<STREAM_ON, _>(fd, &mut kind),
        false => call::<STREAM_OFF, _>(fd, &mut kind),
    }
}

/// Reads a control of an extension unit of a USB camera, as many bytes as `value` has.
pub(crate) fn extension(fd: BorrowedFd<'_>, unit: u8, selector: u8, value: &mut [u8]) -> Result<(), Errno> {
    extension_call(fd, ExtensionQuery { unit, selector, query: UVC_GET, ..Zero::ZERO }, value)
}

/// Sets a control of an extension unit of a USB camera.
pub(crate) fn set_extension(fd: BorrowedFd<'_>, unit: u8, selector: u8, value: &[u8]) -> Result<(), Errno> {
    extension_call(fd, ExtensionQuery { unit, selector, query: UVC_SET, ..Zero::ZERO }, &mut value.to_vec())
}

/// A call about a control of an extension unit.
#[allow(unsafe_code)]
fn extension_call(fd: BorrowedFd<'_>, query: ExtensionQuery, bytes: &mut [u8]) -> Result<(), Errno> {
    let size = u16::try_from(bytes.len()).map_err(|_| Errno::NOBUFS)?;
    let mut query = ExtensionQuery { size, data: bytes.as_mut_ptr().expose_provenance() as u64, ..query };
    loop {
        // SAFETY: this number takes an `ExtensionQuery`. The driver copies at most `size` bytes from or to `data`, which is
        // `bytes`: borrowed mutably beyond the call, of that length, and of plain bytes. It keeps no address. Another driver
        // does not know the number (ENOTTY).
        match unsafe { ioctl::ioctl(fd, Updater::<QUERY_EXTENSION, ExtensionQuery>::new(&mut query)) } {
            Err(Errno::INTR) => {}
            result => return result,
        }
    }
}

/// A buffer as a call leaves it; of planes the first, which holds the luma of every format here.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BufferState {
    pub(crate) index: u32,
    /// Offset in the device's memory, bytes, and length.
    pub(crate) offset: u32,
    pub(crate) length: u32,
    /// Bytes that hold data, and where the image begins in them.
    pub(crate) bytes_used: u32,
    pub(crate) data_offset: u32,
    pub(crate) flags: u32,
    pub(crate) sequence: u32,
    /// Stamp, seconds and microseconds.
    pub(crate) stamp: (i64, i64),
}

/// State of the buffer of this index.
pub(crate) fn query_buffer(fd: BorrowedFd<'_>, kind: u32, index: u32) -> Result<BufferState, Errno> {
    buffer_call::<QUERY_BUFFER>(fd, kind, index)
}

/// Gives a buffer to the driver.
pub(crate) fn queue_buffer(fd: BorrowedFd<'_>, kind: u32, index: u32) -> Result<(), Errno> {
    buffer_call::<QUEUE_BUFFER>(fd, kind, index).map(|_| ())
}

/// Takes a full buffer; `EAGAIN` when there is none.
pub(crate) fn dequeue_buffer(fd: BorrowedFd<'_>, kind: u32) -> Result<BufferState, Errno> {
    buffer_call::<DEQUEUE_BUFFER>(fd, kind, 0)
}

/// A call about a buffer.
#[allow(unsafe_code)]
fn buffer_call<const OPCODE: Opcode>(
    fd: BorrowedFd<'_>,
    kind: u32,
    index: u32,
) -> Result<BufferState, Errno> {
    let mut planes = [Plane::ZERO; MAX_PLANES];
    let mut value = Buffer { index, kind, memory: MEMORY_MMAP, ..Zero::ZERO };
    let is_planar = kind == KIND_CAPTURE_MPLANE;
    if is_planar {
        (value.place, value.length) = (planes.as_mut_ptr().expose_provenance() as u64, MAX_PLANES as u32);
    }
    loop {
        // SAFETY: the three numbers that this is called with take a `Buffer`. It holds a pointer only where the kernel
        // reads one, for a device with planes: to `planes`, which outlives the call and has the length that is given,
        // as plain data of integers. The kernel keeps neither address.
        match unsafe { ioctl::ioctl(fd, Updater::<OPCODE, Buffer>::new(&mut value)) } {
            Err(Errno::INTR) => {}
            Err(error) => return Err(error),
            Ok(()) => break,
        }
    }
    let Buffer { index, flags, sequence, seconds, microseconds, .. } = value;
    let first = &planes[0];
    let (offset, length, bytes_used, data_offset) = if is_planar {
        (first.place[0], first.length, first.bytes_used, first.data_offset)
    } else {
        (low_word(value.place), value.length, value.bytes_used, 0)
    };
    let stamp = (seconds, microseconds);
    Ok(BufferState { index, offset, length, bytes_used, data_offset, flags, sequence, stamp })
}

/// The first four bytes of a union.
fn low_word(place: u64) -> u32 {
    let [a, b, c, d, ..] = place.to_ne_bytes();
    u32::from_ne_bytes([a, b, c, d])
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fd::AsFd as _;

    #[test]
    fn what_is_no_camera_refuses_every_call() {
        let file = std::fs::File::open("/dev/null").unwrap();
        let fd = file.as_fd();
        assert_eq!(capability(fd).unwrap_err(), Errno::NOTTY);
        assert_eq!(dequeue_buffer(fd, KIND_CAPTURE_MPLANE).unwrap_err(), Errno::NOTTY);
        assert_eq!(stream(fd, KIND_CAPTURE_MPLANE, true).unwrap_err(), Errno::NOTTY);
    }
}
