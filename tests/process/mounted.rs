//! File systems of a test's own.

use super::stderr;
use plumbline_test_support::{Need, skip};
use std::path::PathBuf;
use std::process::Command;

/// A file system of the test's own, unmounted with it.
pub struct Mounted(pub PathBuf);

impl Mounted {
    /// `None`, told, where that is not allowed.
    pub fn with(arguments: &[&str], at: PathBuf) -> Option<Self> {
        std::fs::create_dir_all(&at).unwrap();
        let mounted = Command::new("mount").args(arguments).arg(&at).output().unwrap();
        if !mounted.status.success() {
            skip(Need::Mounts, stderr(&mounted).trim());
            return None;
        }
        Some(Self(at))
    }
}

impl Drop for Mounted {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}
