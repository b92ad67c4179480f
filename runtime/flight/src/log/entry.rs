//! Entries of the recorder: owned, of fixed size, made without allocation.

use plumbline_drivers::StereoFrame;
use plumbline_record::{EntryKind, Said};

/// One thing that happened.
// Boxing it would allocate.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug)]
pub enum LogEntry {
    /// Something that the flight said.
    Said(Said),
    /// A frame, moved in: its buffers come back to the owner once it is written.
    Frame(StereoFrame),
}

impl LogEntry {
    /// Kind of the entry.
    pub fn kind(&self) -> EntryKind {
        match self {
            Self::Said(said) => said.kind(),
            Self::Frame(_) => EntryKind::Frame,
        }
    }
}
