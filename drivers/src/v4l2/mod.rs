//! Cameras of the Linux kernel (Video4Linux): [`V4l2Stereo`] reads them, [`cameras`] lists them.
//!
//! From the bottom: [`sys`] is the kernel's interface with all `unsafe`; [`mod@format`], [`convert`] and [`jpeg`] make grey
//! images of a driver's bytes; [`node`], [`offers`], [`controls`], [`extension`], [`device`] and [`list`] ask devices what they can and set
//! them up; [`stamp`],
//! [`sequence`], [`pairing`] and [`numbering`] say when an image was measured and what it belongs to, without any device;
//! [`camera`] is a device while it streams, [`keeper`] the thread that opens and closes devices, and [`stereo`] the source
//! of frames.

mod camera;
mod controls;
mod convert;
mod device;
mod extension;
mod figures;
mod format;
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) mod fuzzing;
pub(crate) mod jpeg;
mod keeper;
mod list;
mod node;
pub(crate) mod numbering;
mod offers;
mod pairing;
mod sequence;
pub(crate) mod stamp;
mod stereo;
mod sys;

pub use controls::{ControlInfo, set_controls};
pub use convert::{Converter, RawLayout};
pub use figures::{V4l2CameraFigures, V4l2Figures, V4l2Monitor};
pub use format::{Arrangement, PixelFormat};
pub use jpeg::LumaDecoder;
pub use list::{CameraInfo, FormatInfo, cameras};
pub use offers::{FrameRates, SizeInfo};
pub use stereo::{V4l2Options, V4l2Stereo};
