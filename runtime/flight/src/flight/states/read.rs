//! Reading a table of states back, strictly: what is not as it was written is refused with its line and column.

use super::columns::{self, FRAME, STATE, TRACKING};
use super::{RowState, StateRow};
use nalgebra::{Isometry3, Quaternion, SVector, Translation3, UnitQuaternion, Vector3};
use plumbline_config::Timestamp;
use plumbline_estimator::{FrameFigures, HealthBits};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The longest line that is read, bytes; a real one has about 700.
const MAX_LINE_BYTES: u64 = 1 << 14;
/// How far a quaternion may be from length 1: it is written with all its digits.
/// What is larger is no measurement, and cannot be drawn.
const MAX_NUMBER: f64 = 1e15;
const QUATERNION_NORM_TOLERANCE: f64 = 1e-6;

/// Why a table of states cannot be read.
#[derive(Debug, Error)]
pub enum StatesError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A line is not one that was written by `--states`.
    #[error("{}: line {line}: {reason}; give a table that `plumbline replay --states` wrote", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
    },
}

/// Whether the first line of the file at `path` is that of a table of states, so that other tables can be told apart.
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
pub fn read_states(path: &Path) -> Result<Vec<StateRow>, StatesError> {
    let io = |source| StatesError::Io { path: path.into(), source };
    let refuse = |line, reason| StatesError::Malformed { path: path.into(), line, reason };
    let mut file = BufReader::new(File::open(path).map_err(io)?);
    let mut rows: Vec<StateRow> = Vec::new();
    let mut text = String::new();
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
            continue;
        }
        if read == 0 {
            break;
        }
        let row = parse_row(line).map_err(|reason| refuse(number, reason))?;
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

fn check_header(line: &str) -> Result<(), String> {
    let mut found = line.split(',');
    for (index, expected) in columns::names().enumerate() {
        let name = found.next().unwrap_or_default();
        if name != expected {
            return Err(format!("column {} is `{name}`, expected `{expected}`", index + 1));
        }
    }
    found.next().map_or(Ok(()), |more| Err(format!("has a column `{more}` too many")))
}

/// The cells of a line, taken one after the other.
struct Cells<'a> {
    cells: std::iter::Enumerate<std::str::Split<'a, char>>,
}

impl<'a> Cells<'a> {
    fn next(&mut self) -> (usize, &'a str) {
        // The number of cells was checked.
        self.cells.next().unwrap_or((0, ""))
    }

    fn parse<T: std::str::FromStr>(&mut self, kind: &str) -> Result<T, String> {
        let (index, cell) = self.next();
        cell.parse().map_err(|_| wrong(index, cell, kind))
    }

    fn number(&mut self) -> Result<f64, String> {
        let (index, cell) = self.next();
        let value = cell.parse().ok().filter(|value: &f64| value.abs() <= MAX_NUMBER);
        value.ok_or_else(|| wrong(index, cell, "a finite number"))
    }

    fn vector(&mut self) -> Result<Vector3<f64>, String> {
        Ok(Vector3::new(self.number()?, self.number()?, self.number()?))
    }

    fn pose(&mut self) -> Result<Isometry3<f64>, String> {
        let position = self.vector()?;
        let (x, y, z, w) = (self.number()?, self.number()?, self.number()?, self.number()?);
        let q = Quaternion::new(w, x, y, z);
        if (q.norm() - 1.0).abs() > QUATERNION_NORM_TOLERANCE {
            return Err(format!("a quaternion has length {}", q.norm()));
        }
        // As it was: normalising would change bits.
        Ok(Isometry3::from_parts(Translation3::from(position), UnitQuaternion::new_unchecked(q)))
    }

    fn variances(&mut self) -> Result<SVector<f64, 9>, String> {
        let mut variances = SVector::<f64, 9>::zeros();
        for variance in variances.iter_mut() {
            *variance = self.number()?;
        }
        Ok(variances)
    }
}

/// Names a cell that cannot be used.
fn wrong(index: usize, cell: &str, kind: &str) -> String {
    let name = columns::names().nth(index).unwrap_or_default();
    format!("column {} ({name}): `{cell}` is not {kind}", index + 1)
}

fn parse_row(line: &str) -> Result<StateRow, String> {
    let expected = columns::names().count();
    let found = line.split(',').count();
    if found != expected {
        return Err(format!("{found} cells, expected {expected}"));
    }
    let mut cells = Cells { cells: line.split(',').enumerate() };
    let stamp = Timestamp::from_nanos(cells.parse("a time in nanoseconds")?);
    let frame_sequence = cells.parse("a count")?;
    let (index, name) = cells.next();
    let tracking = TRACKING.iter().find(|(_, known)| *known == name).map(|(state, _)| *state);
    Ok(StateRow {
        stamp,
        frame_sequence,
        tracking: tracking.ok_or_else(|| wrong(index, name, "a state of the estimator"))?,
        quality: cells.parse("a quality of -1 to 100")?,
        health: HealthBits(cells.parse("a set of bits")?),
        reset_counter: cells.parse("a count")?,
        nav: parse_nav(&mut cells, line)?,
        figures: parse_figures(&mut cells)?,
    })
}

fn parse_nav(cells: &mut Cells<'_>, line: &str) -> Result<Option<RowState>, String> {
    if line.split(',').skip(FRAME.len()).take(STATE.len()).all(str::is_empty) {
        STATE.iter().for_each(|_| _ = cells.next());
        return Ok(None);
    }
    Ok(Some(RowState {
        pose_o_b: cells.pose()?,
        v_o_b: cells.vector()?,
        bias_gyro: cells.vector()?,
        bias_accel: cells.vector()?,
        variances: cells.variances()?,
        heading_variance: cells.number()?,
        time_offset_s: cells.number()?,
        time_offset_sigma_s: cells.number()?,
        pose_b_c0: cells.pose()?,
    }))
}

fn parse_figures(cells: &mut Cells<'_>) -> Result<FrameFigures, String> {
    let mut counts = FrameFigures::default().values();
    for count in &mut counts {
        *count = cells.parse("a count")?;
    }
    Ok(FrameFigures::of_values(counts))
}
