//! Ground truth of a data set: `state_groundtruth_estimate0/data.csv`, or the table of a motion capture.

use super::table::{Row, RowFault, Stamped, ends_before, numbers, read_table, stamp};
use crate::text_lines::BoundedLines;
use crate::tum::unit_quaternion;
use crate::{DriverError, TruthState, open_regular};
use nalgebra::{Isometry3, Translation3, Vector3};
use plumbline_config::Timestamp;
use std::path::{Path, PathBuf};

/// Folders of the tables of the truth, best first: the batch estimate of EuRoC, the motion captures of TUM-VI and EuRoC, and
/// EuRoC's laser tracker, which measures positions alone.
const FOLDERS: [&str; 4] = ["state_groundtruth_estimate0", "mocap0", "vicon0", POSITIONS];
const POSITIONS: &str = "leica0";

/// The table of the truth of the data set at `path`: the directory that holds `mav0`, or `mav0` itself.
pub fn ground_truth_table(path: &Path) -> Option<PathBuf> {
    let nested = path.join("mav0");
    let root = if nested.is_dir() { &nested } else { path };
    FOLDERS.iter().map(|folder| root.join(folder).join("data.csv")).find(|table| table.is_file())
}

/// True if a table of the ground truth holds positions without attitudes.
pub fn is_of_positions(table: &Path) -> bool {
    table.parent().is_some_and(|folder| folder.ends_with(POSITIONS)) || begins_with_a_position(table)
}

/// Lines of a table of which one is its first row.
const BEGINNING: usize = 16;

/// True if the first row of a table has a time and a position, and no more.
fn begins_with_a_position(table: &Path) -> bool {
    let Ok(file) = open_regular(table) else { return false };
    let mut reader =
        csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(BoundedLines::new(file));
    let is_row = |row: &Row| row.get(0).is_some_and(|time| time.trim().parse::<i64>().is_ok());
    let first = reader.records().take(BEGINNING).flatten().find(is_row);
    first.is_some_and(|mut row| {
        row.trim();
        numbers::<3>(&row, 1).is_ok() && ends_before(&row, 4)
    })
}

impl Stamped for TruthState {
    fn stamp(&self) -> Timestamp {
        self.stamp
    }
}

/// Reads a ground truth table in order of time; rows that cannot be read are left out.
///
/// # Errors
/// When the file cannot be read, or too much of it is corrupt.
pub fn read_ground_truth(path: &Path) -> Result<Vec<TruthState>, DriverError> {
    read_table(path, TRUTH_COLUMNS, parse_truth_row).map(|table| table.rows)
}

/// Columns of the table (17); velocity and biases may be left out: zero then.
pub(crate) const TRUTH_COLUMNS: &str = "timestamp [ns], p x y z [m], q w x y z, v x y z [m/s], gyro bias x y z [rad/s], accel bias x y z [m/s^2]";

/// A row of [`TRUTH_COLUMNS`].
pub(crate) fn parse_truth_row(row: &Row) -> Result<TruthState, RowFault> {
    let stamp = stamp(row)?;
    let ([x, y, z], [qw, qx, qy, qz]) = (numbers(row, 1)?, numbers(row, 4)?);
    let rotation = unit_quaternion(qw, qx, qy, qz)
        .ok_or(RowFault::Impossible("the quaternion is not of length 1; write it as w x y z"))?;
    let vector_or_zero = |from| match ends_before(row, from) {
        true => Ok(Vector3::zeros()),
        false => numbers::<3>(row, from).map(Vector3::from),
    };
    Ok(TruthState {
        stamp,
        pose_w_b: Isometry3::from_parts(Translation3::new(x, y, z), rotation),
        v_w_b: vector_or_zero(8)?,
        bias_gyro: vector_or_zero(11)?,
        bias_accel: vector_or_zero(14)?,
    })
}

#[cfg(test)]
mod tests {
    use super::super::table::row;
    use super::*;

    #[test]
    fn columns_are_scalar_first() {
        let state = parse_truth_row(&row("7, 1,2,3, 0,0,0,1, 4,5,6, 7,8,9, 10,11,12")).unwrap();
        assert_eq!(state.stamp.as_nanos(), 7);
        assert_eq!(state.pose_w_b.rotation.coords.z, 1.0);
        assert_eq!(state.v_w_b, Vector3::new(4.0, 5.0, 6.0));
        assert_eq!(state.bias_gyro.x, 7.0);
        assert_eq!(state.bias_accel.z, 12.0);
    }

    #[test]
    fn tables_of_positions_are_known_by_their_first_row() {
        let folder = tempfile::tempdir().unwrap();
        let table = folder.path().join("data.csv");
        for (text, is_of) in [
            ("#t,x,y,z\n5,1.0,2.0,3.0\n", true),
            ("timestamp,x,y,z\n5,1,2,3,\n", true),
            ("#t\n5,1,2,3,1,0,0,0\n", false),
            ("#t\n", false),
            ("5,1,2\n", false),
        ] {
            std::fs::write(&table, text).unwrap();
            assert_eq!(is_of_positions(&table), is_of, "{text}");
        }
    }

    #[test]
    fn a_pose_alone_will_do_and_half_a_vector_will_not() {
        assert_eq!(parse_truth_row(&row("7,1,2,3,1,0,0,0")).unwrap().v_w_b, Vector3::zeros());
        for text in ["7,1,2,3,1,0,0", "7,1,2,3,1,0,0,0,1,2", "7,1,nan,3,1,0,0,0", "7,1,2,3,0,0,0,0"] {
            assert!(parse_truth_row(&row(text)).is_err(), "{text}");
        }
    }
}
