//! Flights of a batch: so many at a time, one thread each.

use super::SweepError;
use super::cell::{Cell, CellResult, keep};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Calls `fly` with each of the `items`, on `jobs` threads, and returns what it gives in the order of the items.
pub fn fly_each<T: Sync, R: Send>(items: &[T], jobs: usize, fly: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let work = || {
        let take = || {
            let index = next.fetch_add(1, Ordering::Relaxed);
            items.get(index).map(|item| (index, item))
        };
        std::iter::from_fn(take).map(|(index, item)| (index, fly(item))).collect::<Vec<_>>()
    };
    let mut flown: Vec<(usize, R)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs.min(items.len())).map(|_| scope.spawn(work)).collect();
        let join = |worker: std::thread::ScopedJoinHandle<'_, _>| {
            worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        workers.into_iter().flat_map(join).collect()
    });
    flown.sort_by_key(|(index, _)| *index);
    flown.into_iter().map(|(_, flown)| flown).collect()
}

/// Flies the `cells`, `jobs` at a time, and keeps each in `folder` as it lands. `landed` is told of each. The results
/// do not depend on `jobs`. When `stop` is set, flights under way are given up; what has landed stays.
///
/// # Errors
/// When a result cannot be kept; no further flight is begun then.
pub fn fly_all(
    cells: &[Cell],
    folder: &Path,
    jobs: usize,
    stop: &Arc<AtomicBool>,
    landed: &(dyn Fn(&CellResult) + Sync),
) -> Result<(), SweepError> {
    // A folder that is full ends the flights without ending the process.
    let give_up = AtomicBool::new(false);
    let fly = |cell: &Cell| {
        if stop.load(Ordering::Relaxed) || give_up.load(Ordering::Relaxed) {
            return Ok(());
        }
        let Some(result) = cell.fly(stop) else { return Ok(()) };
        keep(&result, folder).inspect_err(|_| give_up.store(true, Ordering::Relaxed))?;
        landed(&result);
        Ok(())
    };
    fly_each(cells, jobs, fly).into_iter().collect()
}
