//! Extension module of the Python package `plumbline`: what its `plumbline/*.py` is made on.
//!
//! - [`estimator`] is the estimator itself, with [`image`] for what it is lent;
//! - [`replay`] flies what [`opening`] opens, [`recording`] hands out its samples, [`log`] reads flight logs, [`evaluate`]
//!   compares trajectories, [`connection`] reads the local socket of a flight;
//! - [`config`] is the configuration, [`errors`] makes exceptions of errors, [`arrays`] and [`table`] make arrays.
//!
//! No call holds the interpreter's lock while it works or waits. Each object has a lock of its own, which a call tries and
//! never waits for: two threads in one object are an error, and no deadlock.

mod arrays;
mod config;
mod connection;
mod errors;
mod estimator;
mod evaluate;
mod image;
mod log;
mod opening;
mod recording;
mod replay;
mod table;

use plumbline_estimator::HealthBits;
use plumbline_flight::alloc::CountingAllocator;
use pyo3::prelude::*;

/// As of the command: `hot_path_allocations` of a report means the same.
#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Bits of `Estimate.health` with their names.
#[pyfunction]
fn health_bits() -> Vec<(u32, &'static str)> {
    HealthBits::NAMES.iter().map(|(bit, name)| (bit.0, *name)).collect()
}

/// Native part of the package `plumbline`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::{
        config::PyConfig, connection::Connection, estimator::PyEstimator, evaluate::evaluate_trajectories,
        evaluate::read_trajectory, health_bits, log::read_log, recording::Recording, replay::replay,
    };

    /// Version of the package.
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
