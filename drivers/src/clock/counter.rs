//! Counters of devices, which begin anew when they are full.

/// Makes a counter of `bits` bits one that never begins anew: each reading is taken for the nearest to the one before.
#[derive(Clone, Debug)]
pub struct Unwrap {
    bits: u32,
    last: Option<i64>,
}

impl Unwrap {
    /// For counters of 1 to 64 bits.
    pub fn new(bits: u32) -> Self {
        Self { bits: bits.clamp(1, 64), last: None }
    }

    /// Forgets the last reading.
    pub fn clear(&mut self) {
        self.last = None;
    }

    /// The reading on the endless axis, less than the one before when it went back.
    pub fn extend(&mut self, reading: u64) -> i64 {
        let unused = 64 - self.bits;
        let extended = match self.last {
            None => (reading << unused >> unused) as i64,
            // The difference with the sign of the counter's own width.
            Some(last) => last.wrapping_add((reading.wrapping_sub(last as u64) << unused) as i64 >> unused),
        };
        self.last = Some(extended);
        extended
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(bits: u32, readings: &[u64]) -> Vec<i64> {
        let mut counter = Unwrap::new(bits);
        readings.iter().map(|reading| counter.extend(*reading)).collect()
    }

    #[test]
    fn a_full_counter_goes_on() {
        assert_eq!(all(16, &[65_534, 65_535, 0, 1]), [65_534, 65_535, 65_536, 65_537]);
        assert_eq!(all(32, &[u64::from(u32::MAX), 9]), [i64::from(u32::MAX), i64::from(u32::MAX) + 10]);
        assert_eq!(all(8, &[200, 250, 44, 94]), [200, 250, 300, 350]);
    }

    #[test]
    fn one_that_goes_back_is_seen_to() {
        assert_eq!(all(32, &[1000, 990, 1010]), [1000, 990, 1010]);
        assert_eq!(all(64, &[1000, 0]), [1000, 0]);
        assert_eq!(all(64, &[0, u64::MAX])[1], -1);
    }

    #[test]
    fn bits_beyond_its_width_do_not_count() {
        assert_eq!(all(8, &[0x1_0005, 0xFF06]), [5, 6]);
    }
}
