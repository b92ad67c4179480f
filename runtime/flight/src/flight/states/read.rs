//! Reading a table of states back, strictly: what is not as it was written is refused with its line and column.

use plumbline_estimator::Estimate;
use plumbline_record::columns::{check_header, parse_row};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The longest line that is read, bytes; a real one has about 1,600.
const MAX_LINE_BYTES: u64 = 1 << 14;

/// Errors of reading a table of states.
#[derive(Debug, Error)]
pub enum StatesError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A line is not one that was written by `--states`.
    #[error("{}: line {line}: {reason}; give a table that `plumbline replay --states` wrote", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// Defect.
        reason: String,
    },
}

/// True if the first line of the file at `path` is that of a table of states, which distinguishes it from other tables.
#[must_use]
pub fn is_states(path: &Path) -> bool {
    let Ok(file) = File::open(path) else { return false };
    let mut start = String::new();
    BufReader::new(std::io::Read::take(file, 64)).read_line(&mut start).is_ok()
        && start.starts_with("stamp_ns,frame,")
}

/// Reads a table of states; there is at least one row, and stamps increase.
///
/// # Errors
/// When the file cannot be read, or a line is not as it was written.
pub fn read_states(path: &Path) -> Result<Vec<Estimate>, StatesError> {
    let io = |source| StatesError::Io { path: path.into(), source };
    let refuse = |line, reason| StatesError::Malformed { path: path.into(), line, reason };
    let mut file = BufReader::new(File::open(path).map_err(io)?);
    let mut rows: Vec<Estimate> = Vec::new();
    let (mut text, mut count) = (String::new(), 0);
    for number in 1.. {
        text.clear();
        let mut bounded = std::io::Read::take(&mut file, MAX_LINE_BYTES);
        let read = match bounded.read_line(&mut text) {
            Err(e) if e.kind() == std::io::ErrorKind::InvalidData => {
                return Err(refuse(number, "is not text".into()));
            }
            other => other.map_err(io)?,
        };
        if read as u64 == MAX_LINE_BYTES {
            return Err(refuse(number, format!("is longer than {MAX_LINE_BYTES} bytes")));
        }
        let line = text.trim_end_matches(['\n', '\r']);
        if number == 1 {
            check_header(line).map_err(|reason| refuse(number, reason))?;
            count = line.split(',').count();
            continue;
        }
        if read == 0 {
            break;
        }
        let row = parse_row(line, count).map_err(|reason| refuse(number, reason))?;
        if rows.last().is_some_and(|last| row.stamp <= last.stamp) {
            return Err(refuse(number, "its stamp is not later than the one before".into()));
        }
        rows.push(row);
    }
    if rows.is_empty() {
        return Err(refuse(1, "there is no row after it".into()));
    }
    Ok(rows)
}
