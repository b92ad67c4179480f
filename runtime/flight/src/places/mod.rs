//! Maps on disk.
//!
//! The mathematics is in [`plumbline_estimator::places`]; here are the file ([`codec`], [`mod@file`]) and two maps joined
//! ([`merge`]). A [`MapSaver`] keeps the map of a flight that goes on.

pub mod codec;
pub mod file;
pub mod merge;
mod saver;

pub use codec::{MapContents, MapDefect, StoredKeyframe};
pub use file::{MapFileError, read_known_map, read_map, write_atomically, write_map};
pub use saver::MapSaver;
