//! Maps on disk and maps from data sets: what `plumbline map` does, as a library.
//!
//! The mathematics is in [`plumbline_estimator::places`]; here are the file ([`codec`], [`mod@file`]), the images
//! ([`frames`]), and what is made of both ([`build`], [`merge`], [`ply`]). A [`MapSaver`] keeps the map of a
//! flight that goes on.

pub mod build;
pub mod codec;
pub mod file;
pub mod frames;
pub mod merge;
pub mod ply;
mod saver;

pub use codec::{MapContents, MapDefect, StoredKeyframe};
pub use file::{MapFileError, read_known_map, read_map, write_atomically, write_map};
pub use saver::MapSaver;
