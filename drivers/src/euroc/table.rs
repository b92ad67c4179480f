//! Tables of comma-separated values, as they come back from a drone: with Windows line ends, torn last
//! lines, swapped rows and worse.
//!
//! Rows that cannot be read are skipped and counted, rows out of order are sorted and counted, and of
//! rows with one stamp the first is kept. A table of which little can be read is refused.

use super::order::{Order, not_stamped};
use crate::DriverError;
use crate::text_lines::{BoundedLines, unpacked};
use plumbline_config::{Timestamp, median_by};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// One row in this many may be corrupt (10 %); beyond that the file is not worth flying by.
const CORRUPT_ROWS_ONE_IN: u64 = 10;
/// Stamps further than a day from the median are corrupt digits, not a flight.
const MAX_SPAN_NS: i64 = 24 * 3600 * 1_000_000_000;

/// Longest line that is still looked at; a row of any known format is below 500 bytes.
const MAX_LINE_BYTES: usize = 4096;
/// Longest part of a bad line that a message quotes, characters.
const MAX_QUOTED_CHARS: usize = 60;

/// Columns of a row, without blanks and the quotation marks that some programs set.
pub(crate) type Row = csv::StringRecord;

/// Defects of a row. Columns count from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RowFault {
    /// The line is too long, or not text.
    Unreadable,
    /// The first column is no whole number of nanoseconds.
    Stamp,
    /// The first column is a number with a point: seconds.
    Seconds,
    /// The row ends before its last column.
    Short,
    /// This column is no finite number.
    NotANumber(usize),
    /// The numbers cannot be what the columns stand for; why, and what to do.
    Impossible(&'static str),
}

impl RowFault {
    /// The fault of a row, in words that show where it is.
    fn describe(self, row: &Row) -> String {
        let column = |number: usize| quoted(row.get(number.saturating_sub(1)).unwrap_or_default());
        match self {
            Self::Unreadable => "is longer than any row, or not text".into(),
            Self::Seconds => format!(
                "the time {} is not a whole number of nanoseconds; if it is in seconds, multiply it by 1e9",
                column(1)
            ),
            Self::Stamp => {
                format!(
                    "the time {} is not a whole number of nanoseconds; commas separate columns",
                    column(1)
                )
            }
            Self::Short => {
                let text = row.iter().collect::<Vec<_>>().join(",");
                format!("{} ends before column {}", quoted(&text), row.len() + 1)
            }
            Self::NotANumber(number) => format!("column {number} is {}, no finite number", column(number)),
            Self::Impossible(why) => why.into(),
        }
    }
}

/// The beginning of `text` in quotes, without control characters.
fn quoted(text: &str) -> String {
    let mut shown: String = text.chars().filter(|c| !c.is_control()).take(MAX_QUOTED_CHARS).collect();
    if shown.chars().count() < text.chars().count() {
        shown.push_str("...");
    }
    format!("'{shown}'")
}

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
    /// Order in which the rows were written.
    pub(crate) order: Order,
    /// The first row that could not be read.
    pub(crate) first_bad: Option<String>,
}

impl<T: Stamped> Table<T> {
    /// `rows` in order, of which `corrupt` more could not be read.
    pub(crate) fn of(rows: Vec<T>, corrupt: u64) -> Self {
        let mut table = Self { rows, corrupt, order: Order::default(), first_bad: None };
        drop_far_stamps(&mut table);
        put_in_order(&mut table);
        table
    }
}

/// Reads the table at `path`, plain or gzip, whose columns are `columns`; `parse` takes one row.
pub(crate) fn read_table<T: Stamped>(
    path: &Path,
    columns: &str,
    parse: impl Fn(&Row) -> Result<T, RowFault>,
) -> Result<Table<T>, DriverError> {
    let file = File::open(path).map_err(|e| DriverError::io(path, e))?;
    read_rows(path, columns, unpacked(BufReader::new(file)).map_err(|e| DriverError::io(path, e))?, parse)
}

/// Reads the table from `reader`; `path` names it in messages.
pub(crate) fn read_rows<T: Stamped>(
    path: &Path,
    columns: &str,
    reader: impl Read,
    parse: impl Fn(&Row) -> Result<T, RowFault>,
) -> Result<Table<T>, DriverError> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .quoting(false)
        .terminator(csv::Terminator::Any(b'\n'))
        .from_reader(BoundedLines::new(reader));
    let mut table = Table { rows: Vec::new(), corrupt: 0, order: Order::default(), first_bad: None };
    let (mut at_top, mut bytes) = (true, csv::ByteRecord::new());
    while reader.read_byte_record(&mut bytes).map_err(|e| DriverError::io(path, e.into()))? {
        let text = row_of(&bytes);
        let row = text.as_ref().ok_or(RowFault::Unreadable).and_then(&parse);
        let text = text.unwrap_or_default();
        let first = text.get(0).unwrap_or_default();
        if first.starts_with('#') || first.is_empty() && text.len() == 1 {
            continue;
        }
        match row {
            Ok(row) => table.rows.push(row),
            Err(_) if at_top && is_header(first) => {}
            Err(fault) => {
                table.corrupt += 1;
                let line = bytes.position().map_or(0, |position| position.line());
                table.first_bad.get_or_insert_with(|| format!("line {line}: {}", fault.describe(&text)));
            }
        }
        at_top = false;
    }
    drop_far_stamps(&mut table);
    check_share(path, columns, &table)?;
    put_in_order(&mut table);
    if let ([row], true) = (table.rows.as_slice(), table.order.is_constant()) {
        let message = not_stamped("the table", "rows", table.order.rows, row.stamp());
        return Err(DriverError::refused(path, message));
    }
    Ok(table)
}

/// The columns of a line; `None` where it is longer than any row can be, or not text.
fn row_of(bytes: &csv::ByteRecord) -> Option<Row> {
    let unquoted = |column: &[u8]| {
        let column = str::from_utf8(column).ok()?.trim();
        let inner = column.strip_prefix('"').and_then(|column| column.strip_suffix('"'));
        Some(inner.unwrap_or(column).trim().to_owned())
    };
    let length = bytes.as_slice().len() + bytes.len();
    (length <= MAX_LINE_BYTES).then(|| bytes.iter().map(unquoted).collect())?
}

/// A first line of column names without `#`, or in quotation marks.
fn is_header(text: &str) -> bool {
    text.trim_start_matches(['"', '\'', '#', ' ']).starts_with(|c: char| c.is_ascii_alphabetic())
}

fn check_share<T>(path: &Path, columns: &str, table: &Table<T>) -> Result<(), DriverError> {
    let (good, corrupt) = (table.rows.len() as u64, table.corrupt);
    let example = table.first_bad.as_ref().map_or_else(String::new, |bad| format!("; the first is {bad}"));
    let expected = format!("expected columns: {columns}");
    if good == 0 {
        let what = match corrupt {
            0 => format!("has no rows; {expected}"),
            1 => format!("its only row is not readable{example}; {expected}"),
            _ => format!("none of {corrupt} rows is readable{example}; {expected}"),
        };
        return Err(DriverError::refused(path, what));
    }
    // One torn line, as a recorder leaves it when the power goes, is no reason to refuse a short file.
    if corrupt > 1 && corrupt * CORRUPT_ROWS_ONE_IN > good + corrupt {
        let message = format!("{corrupt} of {} rows are corrupt{example}; {expected}", good + corrupt);
        return Err(DriverError::refused(path, message));
    }
    Ok(())
}

/// Drops rows whose stamps are no times of the recording.
fn drop_far_stamps<T: Stamped>(table: &mut Table<T>) {
    let mut stamps: Vec<Timestamp> = table.rows.iter().map(Stamped::stamp).collect();
    let Some(median) = median_by(&mut stamps, Ord::cmp) else { return };
    let is_far = |stamp: Timestamp| stamp.nanos_since(median).saturating_abs() > MAX_SPAN_NS;
    let before = table.rows.len();
    table.rows.retain(|row| !is_far(row.stamp()));
    table.corrupt += (before - table.rows.len()) as u64;
}

fn put_in_order<T: Stamped>(table: &mut Table<T>) {
    let stamps: Vec<Timestamp> = table.rows.iter().map(Stamped::stamp).collect();
    table.order = Order::of(&stamps);
    table.rows.sort_by_key(Stamped::stamp);
    table.rows.dedup_by_key(|row| row.stamp());
}

/// The stamp in the first column, integer nanoseconds.
pub(crate) fn stamp(row: &Row) -> Result<Timestamp, RowFault> {
    let column = row.get(0).unwrap_or_default();
    column.parse().map(Timestamp::from_nanos).map_err(|_| match column.parse::<f64>() {
        Ok(_) => RowFault::Seconds,
        Err(_) => RowFault::Stamp,
    })
}

/// `N` columns as finite numbers, of which the first has this index from 0.
pub(crate) fn numbers<const N: usize>(row: &Row, from: usize) -> Result<[f64; N], RowFault> {
    let mut numbers = [0.0; N];
    for (index, number) in (from..).zip(&mut numbers) {
        let column = row.get(index).ok_or(RowFault::Short)?;
        let finite = column.parse().ok().filter(|x: &f64| x.is_finite());
        *number = finite.ok_or(RowFault::NotANumber(index + 1))?;
    }
    Ok(numbers)
}

/// True if the columns from this index on are empty.
pub(crate) fn ends_before(row: &Row, index: usize) -> bool {
    row.iter().skip(index).all(str::is_empty)
}

/// The columns of a line.
#[cfg(test)]
pub(crate) fn row(text: &str) -> Row {
    row_of(&csv::ByteRecord::from(text.split(',').collect::<Vec<_>>())).unwrap()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::euroc::imu::parse_imu_row;

    #[test]
    fn columns_in_quotation_marks_are_read_with_their_header() {
        let rows = "\"#timestamp\",\"w_x\"\n\"5\", \"1\",2,3,4,5,\"6\"\n\"6\",1,2,3,4,5,6\n";
        let table = read_rows(Path::new("data.csv"), "", rows.as_bytes(), parse_imu_row).unwrap();
        assert_eq!((table.rows.len(), table.corrupt), (2, 0));
        assert!(parse_imu_row(&row("\"5,1,2,3,4,5,6")).is_err());
    }

    #[test]
    fn lines_are_counted_with_comments_empty_ones_and_the_ends_of_windows() {
        let rows = "\u{feff}#t,w\r\n\r\n5,1,2,3,4,5,6\r\n6,x,2,3,4,5,6\r\n7,1,2,3,4,5,6";
        let table = read_rows(Path::new("data.csv"), "", rows.as_bytes(), parse_imu_row).unwrap();
        assert_eq!((table.rows.len(), table.corrupt), (2, 1));
        let bad = table.first_bad.unwrap().to_string();
        assert!(bad.starts_with("line 4: column 2 is 'x'"), "{bad}");
    }

    #[test]
    fn a_quotation_is_short_and_holds_no_control_characters() {
        let long = quoted(&("a\u{1b}".to_owned() + &"b".repeat(500)));
        assert!(long.len() < 80 && !long.contains('\u{1b}') && long.ends_with("...'"), "{long}");
    }
}
