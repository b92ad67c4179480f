//! The complete parts of a log on the disk, of which the oldest may make room for newer ones.

use super::parts::part_path;
use parking_lot::Mutex;
use plumbline_config::options::KeepPolicy;
use std::collections::VecDeque;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Complete parts, shared by the writer of a log and its files, which may find the disk full in the middle of a chunk.
#[derive(Clone, Debug)]
pub struct CompleteParts(Arc<Mutex<Kept>>);

#[derive(Debug)]
struct Kept {
    path: PathBuf,
    keep: KeepPolicy,
    /// Number and bytes of each part, the oldest first.
    parts: VecDeque<(u32, u64)>,
    deleted_bytes: u64,
}

impl CompleteParts {
    /// No part yet of the log at `path`.
    pub fn new(path: &Path, keep: KeepPolicy) -> Self {
        let kept = Kept { path: path.to_owned(), keep, parts: VecDeque::new(), deleted_bytes: 0 };
        Self(Arc::new(Mutex::new(kept)))
    }

    /// Adds a part that is complete.
    pub fn add(&self, number: u32, bytes: u64) {
        self.0.lock().parts.push_back((number, bytes));
    }

    /// Counts the newest part as deleted: its file is not there any more.
    pub fn forget_newest(&self) {
        let mut kept = self.0.lock();
        if let Some((_, bytes)) = kept.parts.pop_back() {
            kept.deleted_bytes += bytes;
        }
    }

    /// Bytes in the files.
    pub fn bytes(&self) -> u64 {
        self.0.lock().parts.iter().map(|(_, bytes)| bytes).sum()
    }

    /// Bytes that were written and deleted again.
    pub fn deleted_bytes(&self) -> u64 {
        self.0.lock().deleted_bytes
    }

    /// Deletes the oldest part; `false` where there is none, or where the beginning is kept. A file that somebody else has
    /// deleted or moved has made room already.
    ///
    /// # Errors
    /// The file, and what the system said, when it cannot be deleted.
    pub fn delete_oldest(&self) -> Result<bool, (PathBuf, io::Error)> {
        let mut kept = self.0.lock();
        let oldest = if kept.keep == KeepPolicy::Newest { kept.parts.pop_front() } else { None };
        let Some((number, bytes)) = oldest else { return Ok(false) };
        kept.deleted_bytes += bytes;
        let path = part_path(&kept.path, number);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err((path, error)),
            _ => Ok(true),
        }
    }
}
