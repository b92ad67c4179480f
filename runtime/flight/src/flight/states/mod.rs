//! Table of states: all values of an estimate, a row a frame, kept during a flight, written as CSV. The columns
//! are those of [`plumbline_record::columns`].

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
