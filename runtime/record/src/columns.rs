//! Estimates as rows of a table (CSV), and back: what is not as it was written is refused with its column.
//!
//! The names of the columns say quantity, frame and unit: `p_o_b_x_m` is the x component of the position of the body
//! `B` in the odometry frame `O`, in metres; `var_theta_x_rad2` is the variance of the attitude's error about the
//! body's x axis (right perturbation `R Exp(dtheta)`), `cov_p_x_theta_y_m_rad` the covariance of two errors. Quaternions
//! are Hamilton, columns in the order x y z w. A frame without a pose has empty cells where real numbers would stand.

pub mod instants;

use crate::fields::{About, Parts as _, Record as _, Shape, Value};
use nalgebra::Vector3;
use plumbline_estimator::Estimate;
use std::fmt::Write as _;

/// Rows and columns of a covariance: names and units.
const AXES: [(&str, &str); 9] = [
    ("p_x", "m"),
    ("p_y", "m"),
    ("p_z", "m"),
    ("theta_x", "rad"),
    ("theta_y", "rad"),
    ("theta_z", "rad"),
    ("v_x", "m_s"),
    ("v_y", "m_s"),
    ("v_z", "m_s"),
];
/// Columns of tables from before there were variances of biases and covariances in them.
const FIRST_COLUMNS: usize = 54;
/// Bound of what is read: a larger number is no measurement, and cannot be drawn.
const MAX_NUMBER: f64 = 1e15;
/// Deviation of a quaternion's length from 1, at most: it is written with all its digits.
const QUATERNION_NORM_TOLERANCE: f64 = 1e-6;

/// Variance of the attitude's error about the vertical of `O`, rad²: of the heading.
#[must_use]
pub fn heading_variance(e: &Estimate) -> f64 {
    let up_b = e.pose_o_b.rotation.inverse() * Vector3::z();
    let attitude = e.covariance.fixed_view::<3, 3>(3, 3);
    (up_b.transpose() * attitude * up_b)[0]
}

/// A field that has columns: its number, and that in the part that the first opens.
type Place = (u32, Option<u32>);

/// Fields of an estimate with their values, in the order of their columns.
fn fields(e: &Estimate) -> Vec<(Place, &'static About, Value<'_>)> {
    let mut fields: Vec<(Place, &'static About, Value<'_>)> = Vec::new();
    e.visit(&mut |about, value| match value {
        Value::Part(part) => part.visit(&mut |inner, value| {
            fields.push(((about.tag, Some(inner.tag)), inner, value));
        }),
        _ => fields.push(((about.tag, None), about, value)),
    });
    fields.retain(|(_, about, _)| about.columns.0 > 0);
    fields.sort_by_key(|(_, about, _)| about.columns.0);
    fields
}

/// Places of the covariances in the matrix, above its diagonal.
fn off_diagonal() -> impl Iterator<Item = (usize, usize)> {
    (0..AXES.len()).flat_map(|row| (row + 1..AXES.len()).map(move |column| (row, column)))
}

/// Names of all columns, in order.
#[must_use]
pub fn names() -> Vec<String> {
    let blank = Estimate::default();
    let named = fields(&blank).into_iter().flat_map(|(_, about, _)| about.columns.1).map(|n| (*n).to_owned());
    named.chain(covariance_names()).collect()
}

fn covariance_names() -> impl Iterator<Item = String> {
    off_diagonal().map(|(row, column)| {
        let [(a, unit_a), (b, unit_b)] = [AXES[row], AXES[column]];
        format!("cov_{a}_{b}_{unit_a}_{unit_b}")
    })
}

/// Name of an enumerator in a table.
fn enumerator(name: &str) -> String {
    name.split_once('_').map_or(name, |(_, name)| name).to_lowercase()
}

/// Appends the cells of a row, without a line end. Numbers come back from them bit for bit.
pub fn write_row(line: &mut String, e: &Estimate) {
    let covariances = || off_diagonal().map(|at| e.covariance[at]);
    for (_, about, value) in fields(e) {
        match (about.shape, value) {
            (Shape::Enumerator(of), value) => {
                let name =
                    usize::try_from(value.whole() + of.first).ok().and_then(|place| of.names.get(place));
                line.push_str(&enumerator(name.unwrap_or(&"")));
                line.push(',');
            }
            (Shape::Covariance, _) => {
                numbers(line, e, e.covariance.diagonal().iter().copied().chain([heading_variance(e)]));
            }
            (_, Value::Floats(runs)) => numbers(line, e, runs.into_iter().flatten().copied()),
            // Writing to a string cannot fail.
            (_, value) => _ = write!(line, "{},", value.whole()),
        }
    }
    numbers(line, e, covariances());
    line.pop();
}

/// Appends real numbers; empty cells while there is no pose.
fn numbers(line: &mut String, e: &Estimate, values: impl Iterator<Item = f64>) {
    for value in values {
        let _ = if e.has_pose() { write!(line, "{value},") } else { write!(line, ",") };
    }
}

/// Checks the first line of a table.
///
/// # Errors
/// When it is none: what is wrong, in words.
pub fn check_header(line: &str) -> Result<(), String> {
    let names = names();
    let count = line.split(',').count();
    let expected = if count == FIRST_COLUMNS { FIRST_COLUMNS } else { names.len() };
    let mut found = line.split(',');
    for (index, expected) in names[..expected].iter().enumerate() {
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

    fn whole(&mut self, shape: Shape) -> Result<i64, String> {
        let (index, cell) = self.next();
        let (kind, number) = match shape {
            Shape::Enumerator(of) => {
                let place = of.names.iter().position(|name| enumerator(name) == cell);
                ("a state of the estimator", place.map(|place| place as i64 - of.first).filter(|n| *n >= 0))
            }
            Shape::Uint32 => ("a count", cell.parse::<u32>().ok().map(i64::from)),
            Shape::Uint64 => ("a count", cell.parse::<u64>().ok().map(|number| number as i64)),
            Shape::Flag => ("0 or 1", cell.parse().ok().filter(|number| (0..=1).contains(number))),
            Shape::Sint32 => ("a quality of -1 to 100", cell.parse::<i8>().ok().map(i64::from)),
            _ => ("a time in nanoseconds", cell.parse().ok()),
        };
        number.ok_or_else(|| wrong(index, cell, kind))
    }

    fn numbers(&mut self, count: usize) -> Result<Vec<f64>, String> {
        let number = |_| {
            let (index, cell) = self.next();
            let value = cell.parse().ok().filter(|value: &f64| value.abs() <= MAX_NUMBER);
            value.ok_or_else(|| wrong(index, cell, "a finite number"))
        };
        (0..count).map(number).collect()
    }

    fn skip(&mut self, count: usize) {
        (0..count).for_each(|_| _ = self.next());
    }
}

/// Names a cell that cannot be used.
fn wrong(index: usize, cell: &str, kind: &str) -> String {
    let names = names();
    let name = names.get(index).map_or("", String::as_str);
    format!("column {} ({name}): `{cell}` is not {kind}", index + 1)
}

/// Estimate of a row below a header of `count` columns.
///
/// # Errors
/// When the row is not as it was written: what is wrong, in words.
pub fn parse_row(line: &str, count: usize) -> Result<Estimate, String> {
    let found = line.split(',').count();
    if found != count {
        return Err(format!("{found} cells, expected {count}"));
    }
    let mut cells = Cells { cells: line.split(',').enumerate() };
    let (blank, mut e) = (Estimate::default(), Estimate::default());
    for (place, about, value) in fields(&blank) {
        let is_first = about.columns.0 <= 26;
        if count == FIRST_COLUMNS && !is_first {
            continue;
        }
        match (about.shape, value) {
            (_, Value::Floats(_)) if !e.has_pose() => cells.skip(about.columns.1.len()),
            (Shape::Covariance, _) => {
                e.covariance.set_diagonal(&nalgebra::SVector::from_vec(cells.numbers(AXES.len())?));
                // That of the heading follows.
                cells.skip(1);
            }
            (_, Value::Floats(_)) => {
                let numbers = cells.numbers(about.columns.1.len())?;
                check_quaternion(&numbers)?;
                put(&mut e, place, Value::floats(&numbers))?;
            }
            (shape, _) => put(&mut e, place, Value::Whole(cells.whole(shape)?))?,
        }
    }
    if count > FIRST_COLUMNS && e.has_pose() {
        for (row, column) in off_diagonal() {
            let [value] = cells.numbers(1)?[..] else { continue };
            (e.covariance[(row, column)], e.covariance[(column, row)]) = (value, value);
        }
    }
    Ok(e)
}

/// Refuses a pose whose rotation is none.
fn check_quaternion(numbers: &[f64]) -> Result<(), String> {
    let [_, _, _, x, y, z, w] = *numbers else { return Ok(()) };
    let norm = (x * x + y * y + z * z + w * w).sqrt();
    let is_unit = (norm - 1.0).abs() <= QUATERNION_NORM_TOLERANCE;
    if is_unit { Ok(()) } else { Err(format!("a quaternion has length {norm}")) }
}

fn put(e: &mut Estimate, (tag, inner): Place, value: Value<'_>) -> Result<(), String> {
    match inner {
        None => e.put(tag, value)?,
        Some(inner) => {
            let field = Estimate::FIELDS.iter().find(|field| field.about.tag == tag);
            if let Some(part) = field.and_then(|field| (field.open)(e)) {
                part.put(inner, value)?;
            }
        }
    }
    Ok(())
}
