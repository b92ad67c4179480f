//! A sweep: every setting of some keys of the configuration, on every data set, with every seed.
//!
//! A [`Plan`] numbers the cells. Each is a pure function of files: flown on its own, whichever machine flies it, it
//! comes to the same digest, and [`keep`](cell::keep) writes it to a file of its own. So the cells of one sweep may be
//! flown by threads of one process ([`run::fly_all`]), or by the jobs of an array; a sweep that was interrupted goes
//! on with the cells that are not there yet. The [`table`] sums up what was flown.

pub mod cell;
pub mod folder;
pub mod open_table;
pub mod plan;
pub mod published;
pub mod run;
pub mod side_by_side;
pub mod subject;
pub mod table;

pub use cell::{Cell, CellError, CellFigures, CellResult};
pub use plan::{Plan, SweepAxis};
pub use subject::{Common, NamedTruth, Subject};

use std::path::PathBuf;
use thiserror::Error;

/// Why a sweep cannot go on.
#[derive(Debug, Error)]
pub enum SweepError {
    /// `--set` is not of the form `key=value,value`.
    #[error("--set: '{0}' is not of the form section.key=value,value")]
    BadAxis(String),
    /// A key is swept twice.
    #[error("--set: '{0}' is given twice; give all its values at once, separated by commas")]
    DoubleAxis(String),
    /// The numbers of the cells do not go that far.
    #[error("there is no cell {cell}: this sweep has the cells 0 to {last}; --list prints them")]
    NoSuchCell {
        /// The number asked for.
        cell: usize,
        /// The highest there is.
        last: usize,
    },
    /// A file of a cell cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A file is not that of a cell.
    #[error("{}: not the result of a cell ({reason}); delete it, and fly the cell again", path.display())]
    NotACell {
        /// The file.
        path: PathBuf,
        /// Fault of it.
        reason: String,
    },
    /// The folder holds cells of another sweep.
    #[error(
        "{}: is a cell of another sweep; name another folder with --cells (or another --out), or delete {}",
        path.display(),
        path.parent().unwrap_or(path).display()
    )]
    OtherSweep {
        /// The file.
        path: PathBuf,
    },
    /// There is no data set in a folder.
    #[error(
        "{}: holds no data set with mav0/cam0 and mav0/imu0; unpack the archives of EuRoC or TUM-VI (export euroc) into it",
        path.display()
    )]
    NoDataSets {
        /// The folder.
        path: PathBuf,
    },
    /// The folder holds no cell.
    #[error("{}: contains no cell-K.json; fly the cells first", path.display())]
    NoCells {
        /// The folder.
        path: PathBuf,
    },
}
