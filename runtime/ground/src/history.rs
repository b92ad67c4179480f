//! A bounded history whose entries are numbered, so that each reader goes on where it left off.

use std::collections::VecDeque;

/// Entries in the order in which they came, of which the oldest go.
#[derive(Clone, Debug)]
pub struct History<T> {
    entries: VecDeque<T>,
    total: u64,
}

impl<T> Default for History<T> {
    fn default() -> Self {
        Self { entries: VecDeque::new(), total: 0 }
    }
}

impl<T> History<T> {
    /// A history of these entries, of which the newest `most` are kept.
    pub fn of(mut entries: Vec<T>, most: usize) -> Self {
        entries.drain(..entries.len().saturating_sub(most));
        Self { total: entries.len() as u64, entries: entries.into() }
    }

    /// Adds an entry; the newest `most` are kept.
    pub fn push(&mut self, entry: T, most: usize) {
        self.entries.push_back(entry);
        self.total += 1;
        while self.entries.len() > most {
            self.pop_oldest();
        }
    }

    /// Forgets the oldest entry.
    pub fn pop_oldest(&mut self) -> Option<T> {
        self.entries.pop_front()
    }

    /// Entries so far, those no longer kept included: the number of the next one.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Number of the oldest entry that is kept.
    pub fn first(&self) -> u64 {
        self.total - self.entries.len() as u64
    }

    /// Entries from number `from` on; those no longer kept are left out.
    pub fn since(&self, from: u64) -> impl ExactSizeIterator<Item = &T> {
        let skip = usize::try_from(from.saturating_sub(self.first())).unwrap_or(usize::MAX);
        self.entries.range(skip.min(self.entries.len())..)
    }

    /// All of them, the oldest first.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &T> {
        self.entries.iter()
    }

    /// The oldest.
    pub fn oldest(&self) -> Option<&T> {
        self.entries.front()
    }

    /// The newest.
    pub fn newest(&self) -> Option<&T> {
        self.entries.back()
    }

    /// Number of entries that are kept.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// True if none is kept.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_keep_their_numbers_when_the_oldest_go() {
        let mut history = History::default();
        (0..3).for_each(|k| history.push(k, 2));
        assert_eq!((history.len(), history.first(), history.total()), (2, 1, 3));
        let since = |from: u64| history.since(from).copied().collect::<Vec<_>>();
        assert_eq!([since(0), since(2), since(9)], [vec![1, 2], vec![2], vec![]]);
    }
}
