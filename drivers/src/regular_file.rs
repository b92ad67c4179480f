//! Files that are read whole: what is none, such as a pipe without a writer, would hold up its reader for ever.

use std::fs::File;
use std::io::{Error, ErrorKind, Result};
use std::path::Path;

/// Opens a regular file for reading.
///
/// # Errors
/// When it cannot be opened, or is a directory, a pipe, a socket or a device.
pub fn open_regular(path: &Path) -> Result<File> {
    // A pipe blocks when it is opened, so it is looked at first.
    if !std::fs::metadata(path)?.is_file() {
        return Err(Error::new(ErrorKind::InvalidInput, "is not a regular file"));
    }
    File::open(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, FileType, Mode, mknodat};

    #[test]
    fn a_pipe_without_a_writer_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        assert_eq!(open_regular(&pipe).unwrap_err().kind(), ErrorKind::InvalidInput);
        assert!(open_regular(folder.path()).is_err());
        assert_eq!(open_regular(&folder.path().join("none")).unwrap_err().kind(), ErrorKind::NotFound);
        std::fs::write(folder.path().join("file"), "x").unwrap();
        assert!(open_regular(&folder.path().join("file")).is_ok());
    }
}
