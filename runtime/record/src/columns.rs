//! Estimates as rows of a table (CSV).
//!
//! The names of the columns say quantity, frame and unit: `p_o_b_x_m` is the x component of the position of the body
//! `B` in the odometry frame `O`, in metres; `var_theta_x_rad2` is the variance of the attitude's error about the
//! body's x axis (right perturbation `R Exp(dtheta)`), `cov_p_x_theta_y_m_rad` the covariance of two errors. Quaternions
//! are Hamilton, columns in the order x y z w. A frame without a pose has empty cells where real numbers would stand.

pub mod instants;

use crate::fields::{About, Parts as _, Shape, Value};
use nalgebra::Vector3;
use plumbline_estimator::Estimate;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::Path;

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
/// Variance of the attitude's error about the vertical of `O`, rad²: of the heading.
fn heading_variance(e: &Estimate) -> f64 {
    let up_b = e.pose_o_b.rotation.inverse() * Vector3::z();
    let attitude = e.covariance.fixed_view::<3, 3>(3, 3);
    (up_b.transpose() * attitude * up_b)[0]
}

/// Fields of an estimate with their values, in the order of their columns.
fn fields(e: &Estimate) -> Vec<(&'static About, Value<'_>)> {
    let mut fields: Vec<(&'static About, Value<'_>)> = Vec::new();
    e.visit(&mut |about, value| match value {
        Value::Part(part) => part.visit(&mut |inner, value| fields.push((inner, value))),
        _ => fields.push((about, value)),
    });
    fields.retain(|(about, _)| about.columns.0 > 0);
    fields.sort_by_key(|(about, _)| about.columns.0);
    fields
}

/// Places of the covariances in the matrix, above its diagonal.
fn off_diagonal() -> impl Iterator<Item = (usize, usize)> {
    (0..AXES.len()).flat_map(|row| (row + 1..AXES.len()).map(move |column| (row, column)))
}

/// Names of all columns, in order.
pub fn names() -> Vec<String> {
    let blank = Estimate::default();
    let named = fields(&blank).into_iter().flat_map(|(about, _)| about.columns.1).map(|n| (*n).to_owned());
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

/// Writes estimates to `path` as a table, replacing a file of that name.
///
/// # Errors
/// When the file cannot be written.
pub fn write_states<'a>(path: &Path, rows: impl IntoIterator<Item = &'a Estimate>) -> io::Result<()> {
    write(path, &names(), rows, write_row)
}

/// Writes a table, a line for each row.
fn write<T>(
    path: &Path,
    names: &[String],
    rows: impl IntoIterator<Item = T>,
    write_row: impl Fn(&mut String, T),
) -> io::Result<()> {
    let mut out = BufWriter::new(File::create(path)?);
    writeln!(out, "{}", names.join(","))?;
    let mut line = String::new();
    for row in rows {
        line.clear();
        write_row(&mut line, row);
        writeln!(out, "{line}")?;
    }
    out.flush()
}

/// Appends the cells of a row, without a line end. Numbers come back from them bit for bit.
pub fn write_row(line: &mut String, e: &Estimate) {
    let covariances = || off_diagonal().map(|at| e.covariance[at]);
    for (about, value) in fields(e) {
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
