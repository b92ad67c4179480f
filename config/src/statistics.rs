//! Order statistics of a few numbers.

use std::cmp::Ordering;

/// The middle one of `values`, which it reorders, by `compare`; of an even number the upper one. `None` of none.
pub fn median_by<T: Copy>(values: &mut [T], compare: impl FnMut(&T, &T) -> Ordering) -> Option<T> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, compare).1)
}

/// The median of numbers; of an even number of them the upper one. `None` of none.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    median_by(&mut values, f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_an_even_number_is_the_upper_one() {
        assert_eq!(median([3.0, 1.0, 2.0, 4.0]), Some(3.0));
        assert_eq!(median_by(&mut [9, 1, 5], Ord::cmp), Some(5));
        assert_eq!(median([]), None);
    }
}
