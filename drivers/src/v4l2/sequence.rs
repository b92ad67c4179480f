//! Numbers that a driver gives its images: 32 bits that wrap, start anew with the stream, and in some drivers never move.

/// A jump of more than this is no loss, but a driver that counts anew.
const MAX_LOST: u32 = 10_000;

/// Follows the numbers of one stream.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sequence {
    last: Option<(u32, u64)>,
}

impl Sequence {
    /// The number of an image counted from the first of the stream on, without wrapping, and how many are missing
    /// before it. A number that does not move, or moves back, counts as the next.
    pub(crate) fn next(&mut self, number: u32) -> (u64, u64) {
        let (count, lost) = match self.last {
            None => (u64::from(number), 0),
            Some((last, count)) => {
                let step = number.wrapping_sub(last);
                let lost = if (2..=MAX_LOST).contains(&step) { u64::from(step - 1) } else { 0 };
                (count + 1 + lost, lost)
            }
        };
        self.last = Some((number, count));
        (count, lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn followed(numbers: &[u32]) -> Vec<(u64, u64)> {
        let mut sequence = Sequence::default();
        numbers.iter().map(|number| sequence.next(*number)).collect()
    }

    #[test]
    fn gaps_are_counted_across_the_end_of_the_range() {
        assert_eq!(followed(&[7, 8, 11]), [(7, 0), (8, 0), (11, 2)]);
        let top = u64::from(u32::MAX);
        assert_eq!(followed(&[u32::MAX - 1, u32::MAX, 1]), [(top - 1, 0), (top, 0), (top + 2, 1)]);
    }

    #[test]
    fn numbers_that_stand_still_or_start_anew_lose_nothing() {
        assert_eq!(followed(&[0, 0, 0]), [(0, 0), (1, 0), (2, 0)]);
        assert_eq!(followed(&[900_000, 0, 1, 4]), [(900_000, 0), (900_001, 0), (900_002, 0), (900_005, 2)]);
    }
}
