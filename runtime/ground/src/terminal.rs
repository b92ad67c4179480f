//! The terminal that a station is watched from, which may go away.

use std::io::{self, ErrorKind};

/// True if an error of the output means that its reader is gone.
pub fn is_gone(error: &io::Error) -> bool {
    let gone = [rustix::io::Errno::IO, rustix::io::Errno::NXIO, rustix::io::Errno::BADF];
    error.kind() == ErrorKind::BrokenPipe
        || gone.iter().any(|gone| error.raw_os_error() == Some(gone.raw_os_error()))
}
