//! Folders of tests, and simulated data sets that tests look at or damage: rendered once, and copied for each of them.

use super::succeeds;
use plumbline_test_support::kept;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// A folder for the files of one test.
pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// The place of a file in it.
    pub fn at(&self, name: &str) -> String {
        self.path().join(name).to_str().unwrap().to_owned()
    }
}

/// Copies a folder.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => copy(&entry.path(), &target),
            false => drop(fs::copy(entry.path(), target).unwrap()),
        }
    }
}

/// A flight of so many seconds in images of half the size, as `flight` in `folder`.
pub fn dataset(folder: &Path, seconds: &str) -> String {
    let made = kept::folder().join(format!("flight-{seconds}"));
    kept::done_once(&format!("data set of {seconds} s"), || {
        let _ = fs::remove_dir_all(&made);
        let arguments =
            ["simulate", made.to_str().unwrap(), "--start", "3", "--duration", seconds, "--scale", "0.5"];
        succeeds(&arguments);
    });
    let path = folder.join("flight");
    copy(&made, &path);
    path.to_str().unwrap().to_owned()
}
