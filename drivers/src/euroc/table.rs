//! Tables of comma-separated values, as they come back from a drone: with Windows line ends, torn last
//! lines, swapped rows and worse.
//!
//! Rows that cannot be read are skipped and counted, rows out of order are sorted and counted, and of
//! rows with one stamp the first is kept. A table of which little can be read is refused.

use crate::DriverError;
use crate::text_lines::{Line, Lines};
use plumbline_config::Timestamp;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// One row in this many may be corrupt (10 %); beyond that the file is not worth flying by.
const CORRUPT_ROWS_ONE_IN: u64 = 10;
/// Stamps further than a day from the median are corrupt digits, not a flight.
const MAX_SPAN_NS: i64 = 24 * 3600 * 1_000_000_000;

/// A row that has a time.
pub(crate) trait Stamped {
    /// Time of the row.
    fn stamp(&self) -> Timestamp;
}

/// Rows in strictly increasing order of time, and what was wrong with the file.
#[derive(Debug)]
pub(crate) struct Table<T> {
    /// The rows.
    pub(crate) rows: Vec<T>,
    /// Rows that could not be read or held impossible values.
    pub(crate) corrupt: u64,
    /// Rows out of order, put right, or of a stamp that was there already, dropped.
    pub(crate) disordered: u64,
}

/// Reads the table at `path`; `parse` takes one row without line end, `None` for a corrupt one.
pub(super) fn read_table<T: Stamped>(
    path: &Path,
    parse: impl Fn(&str) -> Option<T>,
) -> Result<Table<T>, DriverError> {
    let file = File::open(path).map_err(|e| DriverError::io(path, e))?;
    read_rows(path, BufReader::new(file), parse)
}

/// Reads the table from `reader`; `path` names it in messages.
pub(crate) fn read_rows<T: Stamped>(
    path: &Path,
    reader: impl BufRead,
    parse: impl Fn(&str) -> Option<T>,
) -> Result<Table<T>, DriverError> {
    let mut lines = Lines::new(reader);
    let mut table = Table { rows: Vec::new(), corrupt: 0, disordered: 0 };
    let mut at_top = true;
    while let Some(line) = lines.next_line().map_err(|e| DriverError::io(path, e))? {
        let text = match line {
            Line::Text(text) if text.is_empty() || text.starts_with('#') => continue,
            Line::Text(text) => text,
            Line::Unreadable => "",
        };
        match parse(text) {
            Some(row) => table.rows.push(row),
            None if at_top && is_header(text) => {}
            None => table.corrupt += 1,
        }
        at_top = false;
    }
    drop_far_stamps(&mut table);
    check_share(path, &table)?;
    put_in_order(&mut table);
    Ok(table)
}

/// A first line of column names without `#`.
fn is_header(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic())
}

fn check_share<T>(path: &Path, table: &Table<T>) -> Result<(), DriverError> {
    let (good, corrupt) = (table.rows.len() as u64, table.corrupt);
    if good == 0 {
        let what =
            if corrupt == 0 { "has no rows".into() } else { format!("none of {corrupt} rows is readable") };
        return Err(DriverError::malformed(path, format!("{what}; copy the data set again")));
    }
    // One torn line, as a recorder leaves it when the power goes, is no reason to refuse a short file.
    if corrupt > 1 && corrupt * CORRUPT_ROWS_ONE_IN > good + corrupt {
        let message = format!("{corrupt} of {} rows are corrupt; copy the data set again", good + corrupt);
        return Err(DriverError::malformed(path, message));
    }
    Ok(())
}

fn drop_far_stamps<T: Stamped>(table: &mut Table<T>) {
    let mut stamps: Vec<Timestamp> = table.rows.iter().map(Stamped::stamp).collect();
    if stamps.is_empty() {
        return;
    }
    let middle = stamps.len() / 2;
    let median = *stamps.select_nth_unstable(middle).1;
    let before = table.rows.len();
    table.rows.retain(|row| row.stamp().nanos_since(median).saturating_abs() <= MAX_SPAN_NS);
    table.corrupt += (before - table.rows.len()) as u64;
}

fn put_in_order<T: Stamped>(table: &mut Table<T>) {
    let mut latest = Timestamp::MIN;
    for row in &table.rows {
        table.disordered += u64::from(row.stamp() < latest);
        latest = latest.max(row.stamp());
    }
    table.rows.sort_by_key(Stamped::stamp);
    let before = table.rows.len();
    table.rows.dedup_by_key(|row| row.stamp());
    table.disordered += (before - table.rows.len()) as u64;
}

/// The fields of a row, trimmed.
pub(super) fn fields(row: &str) -> impl Iterator<Item = &str> {
    row.split(',').map(str::trim)
}

/// The stamp in the first field, integer nanoseconds.
pub(super) fn stamp_field<'a>(fields: &mut impl Iterator<Item = &'a str>) -> Option<Timestamp> {
    fields.next()?.parse().ok().map(Timestamp::from_nanos)
}

/// The next `N` fields as finite numbers.
pub(super) fn number_fields<'a, const N: usize>(
    fields: &mut impl Iterator<Item = &'a str>,
) -> Option<[f64; N]> {
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        *number = fields.next()?.parse().ok().filter(|x: &f64| x.is_finite())?;
    }
    Some(numbers)
}
