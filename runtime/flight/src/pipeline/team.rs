//! The threads beside the caller's that do pieces of one frame: points beside lines, left beside right.

use crate::alloc;
use plumbline_estimator::{Fork, InTurn};
use rayon_core::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use std::sync::atomic::{AtomicU64, Ordering};

/// A pool of threads, or none.
#[derive(Debug, Default)]
pub struct Team {
    pool: Option<ThreadPool>,
    allocations: AtomicU64,
}

impl Team {
    /// `threads` threads, the caller's included; up to 1 there is no pool. Each begins with `enter`.
    ///
    /// # Errors
    /// When the system refuses a thread.
    pub fn new(
        threads: usize,
        enter: impl Fn() + Send + Sync + 'static,
    ) -> Result<Self, ThreadPoolBuildError> {
        let pool = (threads > 1).then(|| {
            ThreadPoolBuilder::new()
                .num_threads(threads)
                .thread_name(|k| format!("team-{k}"))
                .start_handler(move |_| enter())
                .build()
        });
        Ok(Self { pool: pool.transpose()?, allocations: AtomicU64::new(0) })
    }

    /// Runs `work` where its forks find the team.
    pub fn lead<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// Allocations and frees on other threads than those that led.
    pub fn allocations(&self) -> u64 {
        self.allocations.load(Ordering::Relaxed)
    }
}

impl Fork for Team {
    fn join(&self, a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
        if self.pool.is_none() {
            return InTurn.join(a, b);
        }
        let leader = std::thread::current().id();
        rayon_core::join(a, || {
            let counting = (std::thread::current().id() != leader).then(alloc::Count::begin);
            b();
            self.allocations.fetch_add(counting.map_or(0, alloc::Count::end), Ordering::Relaxed);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_pieces_are_done_with_and_without_threads() {
        for threads in [1, 3] {
            let team = Team::new(threads, || {}).unwrap();
            let (mut a, mut b) = (0, 0);
            team.lead(|| {
                for _ in 0..100 {
                    team.join(&mut || a += 1, &mut || b += 2);
                }
            });
            assert_eq!((a, b), (100, 200));
        }
    }
}
