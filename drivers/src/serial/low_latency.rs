//! Asks a serial driver to hand bytes on as they come.
//!
//! An adapter of FTDI holds what it has for up to 16 ms unless its driver is told otherwise; 8250-like ports poll. The flag
//! ASYNC_LOW_LATENCY of the Linux interface `TIOCSSERIAL` does it, which anybody may set who may open the port.

use rustix::fd::AsFd;
use rustix::io;
use std::ffi::{c_char, c_int, c_uchar, c_uint, c_ulong, c_ushort};

/// `struct serial_struct` of `include/uapi/linux/serial.h`, the same on all architectures but for the sizes of `long` and of
/// pointers, which the types follow.
#[repr(C)]
#[derive(Clone, Copy)]
struct SerialStruct {
    kind: c_int,
    line: c_int,
    port: c_uint,
    irq: c_int,
    flags: c_int,
    xmit_fifo_size: c_int,
    custom_divisor: c_int,
    baud_base: c_int,
    close_delay: c_ushort,
    io_type: c_char,
    reserved: [c_char; 1],
    hub6: c_int,
    closing_wait: c_ushort,
    closing_wait2: c_ushort,
    iomem_base: *mut c_uchar,
    iomem_reg_shift: c_ushort,
    port_high: c_uint,
    iomap_base: c_ulong,
}

/// `TIOCGSERIAL` and `TIOCSSERIAL` of `asm-generic/ioctls.h`, which the architectures that we build for share.
const TIOCGSERIAL: rustix::ioctl::Opcode = 0x541E;
const TIOCSSERIAL: rustix::ioctl::Opcode = 0x541F;
/// `ASYNC_LOW_LATENCY` of `include/uapi/linux/tty_flags.h`.
const ASYNC_LOW_LATENCY: c_int = 1 << 13;

/// Sets the flag.
///
/// # Errors
/// Error of the driver. One without the interface (USB modems, pseudo-terminals) needs no setting.
#[allow(unsafe_code)]
pub(super) fn ask_for_low_latency(port: impl AsFd) -> io::Result<()> {
    // SAFETY: `TIOCGSERIAL` writes a `struct serial_struct` to its argument and nothing else, and `SerialStruct` has that
    // layout. The integers and the pointer of it, which is never followed, hold any bits.
    let mut settings: SerialStruct =
        unsafe { rustix::ioctl::ioctl(&port, rustix::ioctl::Getter::<TIOCGSERIAL, SerialStruct>::new())? };
    settings.flags |= ASYNC_LOW_LATENCY;
    // SAFETY: `TIOCSSERIAL` reads a `struct serial_struct` from its argument; this one came from the kernel, but for a flag
    // that is among those that users may set.
    unsafe { rustix::ioctl::ioctl(&port, rustix::ioctl::Setter::<TIOCSSERIAL, SerialStruct>::new(settings)) }
}
