//! Tables of comma-separated values, as they come back from a drone: with Windows line ends, torn last
//! lines, swapped rows and worse.
//!
//! Rows that cannot be read are skipped and counted, rows out of order are sorted and counted, and of
//! rows with one stamp the first is kept. A table of which little can be read is refused.

use super::order::{Order, not_stamped};
use crate::DriverError;
use crate::text_lines::{Line, Lines};
use crate::tum::GZIP_MAGIC;
use flate2::read::MultiGzDecoder;
use plumbline_config::{Timestamp, median_by};
use std::fmt;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// One row in this many may be corrupt (10 %); beyond that the file is not worth flying by.
const CORRUPT_ROWS_ONE_IN: u64 = 10;
/// Stamps further than a day from the median are corrupt digits, not a flight.
const MAX_SPAN_NS: i64 = 24 * 3600 * 1_000_000_000;

/// Longest part of a bad line that a message quotes, characters.
const MAX_QUOTED_CHARS: usize = 60;

/// Defects of a row. Columns count from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RowFault {
    /// The line is too long, or not text.
    Unreadable,
    /// The first column is no whole number of nanoseconds.
    Stamp,
    /// The first column is a number with a point: seconds.
    Seconds,
    /// The row ends before this column.
    Missing(usize),
    /// This column is no finite number.
    NotANumber(usize),
    /// The numbers cannot be what the columns stand for; why, and what to do.
    Impossible(&'static str),
}

impl RowFault {
    /// The fault of the row `text`, in words that show where it is.
    fn describe(self, text: &str) -> String {
        let column = |number: usize| {
            text.split(',').nth(number.saturating_sub(1)).map_or_else(String::new, |c| quoted(c.trim()))
        };
        // A row without commas has one column, whatever else separates its numbers; so has its beginning where commas are the
        // points of its numbers.
        let separator = [(';', "semicolons"), ('\t', "tabs"), (' ', "spaces")];
        let first = text.split(',').next().unwrap_or_default().trim();
        let other = separator.into_iter().find(|(sign, _)| first.contains(*sign));
        match (self, other) {
            (Self::Unreadable, _) => "is longer than any row, or not text".into(),
            (_, Some((_, name))) => {
                let points = if text.contains(',') { ", and write points in its numbers" } else { "" };
                format!("{} is separated by {name}; separate its columns by commas{points}", quoted(text))
            }
            _ if is_after_an_index(text) => format!(
                "{} has a column before the time, as of row numbers; write the table without it",
                quoted(text)
            ),
            (Self::Seconds, _) if first.contains(['e', 'E']) => format!(
                "the time {} is written with an exponent, which rounds it; write all digits of the nanoseconds",
                column(1)
            ),
            (Self::Seconds, _) => format!(
                "the time {} is not a whole number of nanoseconds; if it is in seconds, multiply it by 1e9",
                column(1)
            ),
            (Self::Stamp, _) => format!("the time {} is not a whole number of nanoseconds", column(1)),
            (Self::Missing(number), _) => format!("{} ends before column {number}", quoted(text)),
            (Self::NotANumber(number), _) => {
                format!("column {number} is {}, no finite number", column(number))
            }
            (Self::Impossible(why), _) => why.into(),
        }
    }
}

/// Largest number of a row; a time in nanoseconds is larger from the first second on.
const MAX_ROW_NUMBER: i64 = 100_000_000;

/// True if the second column looks like the time, and the first like the number of the row.
fn is_after_an_index(text: &str) -> bool {
    let mut columns = text.split(',').map(|column| column.trim().parse::<i64>());
    let (Some(Ok(number)), Some(Ok(time))) = (columns.next(), columns.next()) else { return false };
    (0..MAX_ROW_NUMBER).contains(&number) && time > 10 * MAX_ROW_NUMBER
}

/// The beginning of `text` in quotes, without control characters.
fn quoted(text: &str) -> String {
    let mut shown: String = text.chars().filter(|c| !c.is_control()).take(MAX_QUOTED_CHARS).collect();
    if shown.chars().count() < text.chars().count() {
        shown.push_str("...");
    }
    format!("'{shown}'")
}

/// The first row that could not be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct BadRow {
    line: usize,
    why: String,
    is_in_seconds: bool,
}

impl fmt::Display for BadRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.why)
    }
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
    pub(crate) first_bad: Option<BadRow>,
}

impl<T: Stamped> Table<T> {
    /// `rows` in order, of which `corrupt` more could not be read.
    pub(crate) fn of(rows: Vec<T>, corrupt: u64) -> Self {
        let mut table = Self { rows, corrupt, order: Order::default(), first_bad: None };
        let unstamped = drop_far_stamps(&mut table);
        put_in_order(&mut table, unstamped);
        table
    }
}

/// Reads the table at `path`, plain or gzip, whose columns are `columns`; `parse` takes one row without line end.
pub(crate) fn read_table<T: Stamped>(
    path: &Path,
    columns: &str,
    parse: impl Fn(&str) -> Result<T, RowFault>,
) -> Result<Table<T>, DriverError> {
    let mut reader = BufReader::new(File::open(path).map_err(|e| DriverError::io(path, e))?);
    let start = reader.fill_buf().map_err(|e| DriverError::io(path, e))?;
    if start.starts_with(&GZIP_MAGIC) {
        return read_rows(path, columns, BufReader::new(MultiGzDecoder::new(reader)), parse);
    }
    read_rows(path, columns, reader, parse)
}

/// Reads the table from `reader`; `path` names it in messages.
pub(crate) fn read_rows<T: Stamped>(
    path: &Path,
    columns: &str,
    reader: impl BufRead,
    parse: impl Fn(&str) -> Result<T, RowFault>,
) -> Result<Table<T>, DriverError> {
    let mut lines = Lines::new(reader);
    let mut table = Table { rows: Vec::new(), corrupt: 0, order: Order::default(), first_bad: None };
    let (mut at_top, mut number) = (true, 0);
    while let Some(line) = lines.next_line().map_err(|e| DriverError::io(path, e))? {
        number += 1;
        let (text, row) = match line {
            Line::Text(text) if text.is_empty() || text.starts_with('#') => continue,
            Line::Text(text) => (text, parse(text)),
            Line::Unreadable => ("", Err(RowFault::Unreadable)),
        };
        match row {
            Ok(row) => table.rows.push(row),
            Err(_) if at_top && is_header(text) => {}
            Err(fault) => {
                table.corrupt += 1;
                let is_in_seconds = fault == RowFault::Seconds;
                table.first_bad.get_or_insert_with(|| BadRow {
                    line: number,
                    why: fault.describe(text),
                    is_in_seconds,
                });
            }
        }
        at_top = false;
    }
    let unstamped = drop_far_stamps(&mut table);
    check_share(path, columns, &table)?;
    put_in_order(&mut table, unstamped);
    if let ([row], true) = (table.rows.as_slice(), table.order.is_constant()) {
        let message = not_stamped("the table", "rows", table.order.rows, row.stamp());
        return Err(DriverError::malformed(path, message));
    }
    Ok(table)
}

/// A first line of column names without `#`, or in quotation marks.
fn is_header(text: &str) -> bool {
    text.trim_start_matches(['"', '\'', '#', ' ']).starts_with(|c: char| c.is_ascii_alphabetic())
}

fn check_share<T>(path: &Path, columns: &str, table: &Table<T>) -> Result<(), DriverError> {
    let (good, corrupt) = (table.rows.len() as u64, table.corrupt);
    let example = table.first_bad.as_ref().map_or_else(String::new, |bad| format!("; the first is {bad}"));
    let expected = format!("expected columns: {columns}");
    // Another unit is another file than the one that is meant; torn rows are a file that has suffered.
    let error = |message: String| match &table.first_bad {
        Some(BadRow { is_in_seconds: true, .. }) => DriverError::refused(path, message),
        _ => DriverError::malformed(path, message),
    };
    if good == 0 {
        let what = match corrupt {
            0 => format!("has no rows; {expected}"),
            1 => format!("its only row is not readable{example}; {expected}"),
            _ => format!("none of {corrupt} rows is readable{example}; {expected}"),
        };
        return Err(error(what));
    }
    // One torn line, as a recorder leaves it when the power goes, is no reason to refuse a short file.
    if corrupt > 1 && corrupt * CORRUPT_ROWS_ONE_IN > good + corrupt {
        let message = format!("{corrupt} of {} rows are corrupt{example}; {expected}", good + corrupt);
        return Err(error(message));
    }
    Ok(())
}

/// Drops rows whose stamps are no times of the recording, and returns how many of them have the stamp 0.
fn drop_far_stamps<T: Stamped>(table: &mut Table<T>) -> u64 {
    let mut stamps: Vec<Timestamp> = table.rows.iter().map(Stamped::stamp).collect();
    let Some(median) = median_by(&mut stamps, Ord::cmp) else { return 0 };
    let is_far = |stamp: Timestamp| stamp.nanos_since(median).saturating_abs() > MAX_SPAN_NS;
    let unstamped = stamps.iter().filter(|stamp| stamp.as_nanos() == 0 && is_far(**stamp)).count();
    let before = table.rows.len();
    table.rows.retain(|row| !is_far(row.stamp()));
    table.corrupt += (before - table.rows.len()) as u64;
    unstamped as u64
}

fn put_in_order<T: Stamped>(table: &mut Table<T>, unstamped: u64) {
    let stamps: Vec<Timestamp> = table.rows.iter().map(Stamped::stamp).collect();
    table.order = Order { unstamped, ..Order::of(&stamps) };
    table.rows.sort_by_key(Stamped::stamp);
    table.rows.dedup_by_key(|row| row.stamp());
}

/// The columns of a row, read from left to right.
pub(crate) struct Row<'a> {
    columns: std::iter::Peekable<std::str::Split<'a, char>>,
    read: usize,
}

impl<'a> Row<'a> {
    /// Columns of one line.
    pub(crate) fn new(text: &'a str) -> Self {
        Self { columns: text.split(',').peekable(), read: 0 }
    }

    /// The next column, without blanks and the quotation marks that some programs set.
    pub(crate) fn text(&mut self) -> Option<&'a str> {
        self.read += 1;
        let unquoted = |column: &'a str| {
            let inner = column.strip_prefix('"').and_then(|column| column.strip_suffix('"'));
            inner.unwrap_or(column).trim()
        };
        self.columns.next().map(|column| unquoted(column.trim()))
    }

    /// True if all further columns are empty.
    pub(crate) fn is_at_end(&mut self) -> bool {
        while self.columns.next_if(|column| column.trim().is_empty()).is_some() {
            self.read += 1;
        }
        self.columns.peek().is_none()
    }

    /// The stamp in the next column, integer nanoseconds.
    pub(crate) fn stamp(&mut self) -> Result<Timestamp, RowFault> {
        let column = self.text().unwrap_or_default();
        column.parse().map(Timestamp::from_nanos).map_err(|_| match column.parse::<f64>() {
            Ok(_) => RowFault::Seconds,
            Err(_) => RowFault::Stamp,
        })
    }

    /// The next `N` columns as finite numbers.
    pub(crate) fn numbers<const N: usize>(&mut self) -> Result<[f64; N], RowFault> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            let column = self.text().ok_or(RowFault::Missing(self.read))?;
            let finite = column.parse().ok().filter(|x: &f64| x.is_finite());
            *number = finite.ok_or(RowFault::NotANumber(self.read))?;
        }
        Ok(numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::euroc::imu::parse_imu_row;

    fn why(row: &str) -> String {
        parse_imu_row(row).unwrap_err().describe(row)
    }

    #[test]
    fn a_bad_row_is_told_with_the_column_and_the_cure() {
        for (row, words) in [
            (
                "1403636579.758,1,2,3,4,5,6",
                "'1403636579.758' is not a whole number of nanoseconds; if it is in seconds",
            ),
            ("x,1,2,3,4,5,6", "the time 'x' is not a whole number"),
            ("5;1;2;3;4;5;6", "separated by semicolons"),
            ("5 1 2 3 4 5 6", "separated by spaces"),
            (
                "5;0,1;0,2;0,3;9,8;0;0",
                "separated by semicolons; separate its columns by commas, and write points",
            ),
            ("1.40363658e+18,1,2,3,4,5,6", "'1.40363658e+18' is written with an exponent, which rounds it"),
            ("17,1403636579758000000,1,2,3,4,5", "has a column before the time"),
            ("5,1,2,3,4", "ends before column 6"),
            ("5,1,2,3,4,abc,6", "column 6 is 'abc'"),
            ("5,1,2,3,4,inf,6", "column 6 is 'inf'"),
            ("5,1e9,2,3,4,5,6", "beyond"),
        ] {
            assert!(why(row).contains(words), "{row}: {}", why(row));
        }
    }

    #[test]
    fn columns_in_quotation_marks_are_read_with_their_header() {
        let rows = "\"#timestamp\",\"w_x\"\n\"5\", \"1\",2,3,4,5,\"6\"\n\"6\",1,2,3,4,5,6\n";
        let table = read_rows(Path::new("data.csv"), "", rows.as_bytes(), parse_imu_row).unwrap();
        assert_eq!((table.rows.len(), table.corrupt), (2, 0));
        assert!(parse_imu_row("\"5,1,2,3,4,5,6").is_err());
    }

    #[test]
    fn a_quotation_is_short_and_holds_no_control_characters() {
        let long = quoted(&("a\u{1b}".to_owned() + &"b".repeat(500)));
        assert!(long.len() < 80 && !long.contains('\u{1b}') && long.ends_with("...'"), "{long}");
    }
}
