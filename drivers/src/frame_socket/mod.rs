//! Frames that a program of the user's own sends over a Unix socket: one that knows a camera by its maker's SDK, or one
//! that plays a recording. `docs/own-sensors.md` says what it sends; [`FrameHeader`] is that.
//!
//! The socket is ours: programs come and go as cameras do. Bytes are read straight into the images of a frame.

mod figures;
mod source;

pub use figures::{SocketFigures, SocketMonitor};
pub use plumbline_protocol::frame_header::{FrameHeader, FrameRefusal, MAGIC};
pub use source::SocketStereo;
