//! States at the instants of a list: read before the flight, kept during it.

use super::trajectory::Kept;
use crate::pipeline::Control;
use crate::pipeline::listener::Producer;
use plumbline_config::Timestamp;
use plumbline_drivers::tum::parse_seconds;
use plumbline_record::{InstantAnswer, InstantSource, Said};
use std::fs::File;
use std::io::{BufRead, BufReader, Read as _};
use std::path::{Path, PathBuf};

/// Stamps of a list at most: three hours of a trigger at 10 Hz.
pub const MAX_STAMPS: usize = 100_000;
/// Bytes of a list at most.
const MAX_BYTES: u64 = 16 << 20;
/// Why a list of stamps cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct StampsError {
    path: PathBuf,
    reason: String,
}

/// Reads the first column of a CSV file: nanoseconds as a whole number, or seconds with a decimal point. A header and lines
/// that begin with `#` are passed over.
///
/// # Errors
/// When the file cannot be read, or a line is no stamp.
pub fn read_stamps(path: &Path) -> Result<Vec<Timestamp>, StampsError> {
    let refused = |reason: String| StampsError { path: path.to_owned(), reason };
    let failed = |source: std::io::Error| refused(format!("cannot be read: {source}"));
    let file = File::open(path).map_err(failed)?;
    let mut stamps = Vec::new();
    for (line, text) in (1..).zip(BufReader::new(file.take(MAX_BYTES)).lines()) {
        let text = text.map_err(failed)?;
        let cell = text.split([',', ';', ' ', '\t']).next().unwrap_or_default().trim();
        if text.trim().is_empty() || cell.starts_with('#') {
            continue;
        }
        match stamp_of(cell) {
            Some(stamp) => stamps.push(stamp),
            // Names of columns.
            None if stamps.is_empty() && line == 1 && cell.starts_with(|c: char| c.is_ascii_alphabetic()) => {
            }
            None => {
                let text: String = cell.chars().take(40).collect();
                return Err(refused(format!(
                    "line {line}: `{text}` is no stamp; begin each line with nanoseconds as a whole number, or seconds with a \
                     decimal point, by the clock of the IMU"
                )));
            }
        }
        if stamps.len() > MAX_STAMPS {
            return Err(refused(format!("has more than {MAX_STAMPS} stamps; divide it")));
        }
    }
    if stamps.is_empty() {
        return Err(refused("has no stamp; write one a line, in nanoseconds".into()));
    }
    Ok(stamps)
}

fn stamp_of(cell: &str) -> Option<Timestamp> {
    match cell.contains('.') {
        true => parse_seconds(cell),
        false => cell.parse().ok().map(Timestamp::from_nanos),
    }
}

/// Answers to a list, in the order in which they came.
pub type KeptInstants = Kept<InstantAnswer>;

impl KeptInstants {
    /// Has the run of `control` asked for the states at `stamps`.
    pub fn of(stamps: Vec<Timestamp>, control: &Control) -> Self {
        let room = stamps.len();
        control.keep_instants().expect(stamps);
        Self::new(room, Producer::Tick, |said| match said {
            Said::Instant(answer) if answer.source == InstantSource::List => Some(answer.clone()),
            _ => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<i64>, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        let stamps = read_stamps(file.path()).map_err(|error| error.to_string())?;
        Ok(stamps.into_iter().map(Timestamp::as_nanos).collect())
    }

    #[test]
    fn stamps_are_read_from_lists_as_they_are_kept() {
        let euroc = "#timestamp [ns],filename\n1403636579763555584,1403636579763555584.png\n7,\n";
        assert_eq!(read(euroc), Ok(vec![1_403_636_579_763_555_584, 7]));
        let tum = "stamp x y\r\n1403636579.763555584 0 0\r\n\r\n1.5\r\n-0.25\r\n-2.000000001 3\r\n";
        assert_eq!(
            read(tum),
            Ok(vec![1_403_636_579_763_555_584, 1_500_000_000, -250_000_000, -2_000_000_001])
        );
    }

    #[test]
    fn what_is_no_list_of_stamps_is_refused_with_its_line() {
        for (text, says) in [
            ("1\n2\nthree\n", "line 3: `three` is no stamp"),
            ("1\nstamp\n", "line 2: `stamp`"),
            ("1e9\n", "line 1: `1e9`"),
            ("99999999999999999999\n", "line 1"),
            ("9999999999999.0\n", "line 1"),
            ("# nothing\n\n", "has no stamp"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(says), "{text:?}: {error}");
        }
        assert!(read(&"1\n".repeat(MAX_STAMPS + 1)).unwrap_err().contains("more than 100000 stamps"));
    }
}
