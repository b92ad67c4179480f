//! Choice of the client that makes room where all places are taken.

use std::collections::BTreeMap;

/// Number and rank of the entry that gives way: of the owner who has most entries, the one of the highest rank. Entries are
/// numbers with their owner and rank; those without a rank stay.
pub fn gives_way<O: Ord, R: Ord>(
    entries: impl IntoIterator<Item = (usize, O, Option<R>)>,
) -> Option<(usize, R)> {
    let mut owners = BTreeMap::<O, Vec<(Option<R>, usize)>>::new();
    for (number, owner, rank) in entries {
        owners.entry(owner).or_default().push((rank, number));
    }
    let (rank, number) = owners.into_values().max_by_key(Vec::len)?.into_iter().max()?;
    Some((number, rank?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_highest_rank_of_the_most_numerous_gives_way() {
        let entries = [(0, "a", Some(9)), (1, "b", None), (2, "b", Some(3)), (3, "b", Some(2))];
        assert_eq!(gives_way(entries), Some((2, 3)));
        assert_eq!(gives_way([(0, "a", Some(9)), (1, "b", None), (2, "b", None)]), None);
    }
}
