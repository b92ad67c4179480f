//! The kernel's interface: its structs ([`abi`]), its calls ([`calls`]) and the buffers that it shares ([`queue`]). The
//! only `unsafe` of the cameras is here.
//!
//! Source: `linux/videodev2.h` and the kernel's documentation "Video for Linux API". The structs are ours: those of the
//! crates hold C unions, every reading of which is `unsafe`, and come without tests of their layout.

pub(crate) mod abi;
pub(crate) mod calls;
pub(crate) mod queue;
