//! Share of the configured work for a frame, and the threads that do it.
//!
//! Both are given from outside. The budget is an input of the estimate, like a sample; the [`Fork`] decides
//! on which threads the work is done, and has no say in its outcome.

/// Share of the configured work for one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorkBudget {
    /// Share of the configured points, line segments and pixel visits, percent.
    pub features_percent: u32,
    /// Track lines.
    pub lines: bool,
    /// Solver iterations, at most; the configuration may allow fewer.
    pub max_iterations: usize,
}

impl WorkBudget {
    /// Work in full, as configured.
    pub const FULL: Self = Self { features_percent: 100, lines: true, max_iterations: usize::MAX };

    /// The share of `count` that this budget allows.
    pub fn share_of(&self, count: usize) -> usize {
        count * self.features_percent.min(100) as usize / 100
    }
}

/// Does two pieces of work, side by side where there are cores for it. Neither sees the other's outcome.
pub trait Fork: Sync {
    /// Returns when both are done.
    fn join(&self, a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send));
}

/// One piece of work after the other, on the caller's thread.
#[derive(Clone, Copy, Debug, Default)]
pub struct InTurn;

impl Fork for InTurn {
    fn join(&self, a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
        a();
        b();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_never_allows_more_than_the_configuration() {
        let twice = WorkBudget { features_percent: 200, ..WorkBudget::FULL };
        assert_eq!((twice.share_of(120), WorkBudget::FULL.share_of(120)), (120, 120));
        assert_eq!(WorkBudget { features_percent: 60, ..WorkBudget::FULL }.share_of(120), 72);
    }
}
