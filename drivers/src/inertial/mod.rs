//! Common parts of all live inertial sensors: [`SampleWatch`] checks the samples, [`Numbering`] numbers them so
//! that losses show, and [`ImuMonitor`] shows the figures while the sensor runs.

mod figures;
mod numbering;
mod watch;

pub(crate) use figures::Post;
pub use figures::{FramingFigures, ImuFigures, ImuMonitor, LinkFigures};
pub use numbering::Numbering;
pub use watch::{SampleWatch, WatchFigures};
