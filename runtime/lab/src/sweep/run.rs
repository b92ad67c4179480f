//! Flying the cells of a sweep in one process: so many flights at a time, one thread each.

use super::SweepError;
use super::cell::{Cell, CellResult, keep};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Flies the `cells`, `jobs` at a time, and keeps each in `folder` as it lands. `landed` is told of each. The results
/// do not depend on `jobs`. When `stop` is set, flights under way are given up; what has landed stays.
///
/// # Errors
/// When a result cannot be kept; the flights under way are given up then.
pub fn fly_all(
    cells: &[Cell],
    folder: &Path,
    jobs: usize,
    stop: &Arc<AtomicBool>,
    landed: &(dyn Fn(&CellResult) + Sync),
) -> Result<(), SweepError> {
    let next = AtomicUsize::new(0);
    let failed: Mutex<Option<SweepError>> = Mutex::new(None);
    // A folder that is full ends the flights without ending the process.
    let give_up = Arc::new(AtomicBool::new(false));
    let work = || {
        while !stop.load(Ordering::Relaxed) && !give_up.load(Ordering::Relaxed) {
            let Some(cell) = cells.get(next.fetch_add(1, Ordering::Relaxed)) else { return };
            let Some(result) = cell.fly(stop) else { return };
            match keep(&result, folder) {
                Ok(()) => landed(&result),
                Err(error) => {
                    give_up.store(true, Ordering::Relaxed);
                    failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                }
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..jobs.min(cells.len()) {
            scope.spawn(work);
        }
    });
    let failed = failed.into_inner().unwrap_or_else(PoisonError::into_inner);
    failed.map_or(Ok(()), Err)
}
