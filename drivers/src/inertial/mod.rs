//! What all live inertial sensors share: their samples are looked at for what is wrong with them ([`Watch`]), numbered so
//! that losses show ([`Numbering`]), and what became of them can be read while the sensor runs ([`ImuMonitor`]).

mod figures;
mod numbering;
mod watch;

pub(crate) use figures::Post;
pub use figures::{FramingFigures, ImuFigures, ImuMonitor, LinkFigures};
pub use numbering::{LossFigures, Numbering};
pub use watch::{SampleVerdict, Watch, WatchFigures};
