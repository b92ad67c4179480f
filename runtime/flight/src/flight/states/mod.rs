//! Table of states: all values of an estimate, a row a frame, kept during a flight, written as CSV, read back for figures. The
//! columns are those of [`plumbline_record::columns`].

mod read;

pub use read::{StatesError, is_states, read_states};

use plumbline_estimator::Estimate;
use plumbline_record::columns;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes the estimates to `path` as CSV, replacing a file of that name. Numbers come back from it bit for bit.
///
/// # Errors
/// When the file cannot be written.
pub fn write_states<'a>(path: &Path, rows: impl IntoIterator<Item = &'a Estimate>) -> std::io::Result<()> {
    let mut out = BufWriter::new(std::fs::File::create(path)?);
    writeln!(out, "{}", columns::names().join(","))?;
    let mut line = String::new();
    for row in rows {
        line.clear();
        columns::write_row(&mut line, row);
        writeln!(out, "{line}")?;
    }
    out.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fuzzing::fixture;
    use plumbline_config::Timestamp;
    use plumbline_estimator::TrackingState;

    fn row(k: i64) -> Estimate {
        Estimate { stamp: Timestamp::from_nanos(k), time_offset_s: -0.0025, ..fixture::estimate() }
    }

    #[test]
    fn rows_come_back_from_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("states.csv");
        let none = Estimate { state: TrackingState::Failed, quality: -1, ..row(3) };
        write_states(&path, &[row(1), row(2), none]).unwrap();
        assert!(is_states(&path));
        let rows = read_states(&path).unwrap();
        assert_eq!(rows[..2], [row(1), row(2)]);
        assert_eq!((rows.len(), rows[2].has_pose(), rows[2].quality), (3, false, -1));
    }

    #[test]
    fn what_is_no_such_table_is_refused_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("states.csv");
        write_states(&path, &[row(1), row(2)]).unwrap();
        let good = std::fs::read_to_string(&path).unwrap();
        let refused = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read_states(&path).unwrap_err().to_string()
        };
        for (from, to, says) in [
            ("stamp_ns", "stamp", "line 1: column 1 is `stamp`, expected `stamp_ns`"),
            ("tracking,80", "walking,80", "line 2: column 3 (tracking): `walking`"),
            ("tracking,80", "tracking,800", "line 2: column 4 (quality): `800`"),
            (",80,5,2,", ",80,5,2,,", "line 2: 97 cells, expected 96"),
        ] {
            let message = refused(&good.replacen(from, to, 1));
            assert!(message.contains(says) && message.contains("states.csv"), "{to}: {message}");
        }
        let half = good.lines().take(2).map(|l| l.to_owned() + "\n").collect::<String>();
        let torn = refused(&(half.clone() + "17,3,tracking"));
        assert!(torn.contains("line 3: 3 cells"), "{torn}");
        let backwards = refused(&(half.clone() + half.lines().nth(1).unwrap()));
        assert!(backwards.contains("line 3: its stamp is not later than the one before"), "{backwards}");
        assert!(refused("").contains("line 1: "));
        assert!(refused(good.lines().next().unwrap()).contains("no row"));
        let nan = refused(&good.replacen("-0.0025", "NaN", 1));
        assert!(nan.contains("`NaN` is not a finite number"), "{nan}");
    }
}
