//! Bits of the coded data: first the highest of each byte, a zero after each 0xFF left out, a marker the end.

use super::JpegDamage;

/// Least number of bits available after [`Bits::fill`].
const FILLED: u32 = 32;

pub(super) struct Bits<'a> {
    data: &'a [u8],
    at: usize,
    /// The next bits, from the highest down.
    window: u64,
    count: u32,
    /// Bits beyond the end that were made up.
    made_up: u32,
}

impl<'a> Bits<'a> {
    pub(super) fn new(data: &'a [u8]) -> Self {
        Self { data, at: 0, window: 0, count: 0, made_up: 0 }
    }

    /// Whether bits were taken that there are not.
    pub(super) fn is_past_end(&self) -> bool {
        self.made_up > self.count
    }

    /// Makes sure of 32 bits: a code of 16 and a number of 15. Everything below is to be called after it.
    #[inline]
    pub(super) fn fill(&mut self) {
        if self.count < FILLED {
            self.fill_up();
        }
    }

    /// The next 16 bits.
    #[inline]
    pub(super) fn peek16(&self) -> u32 {
        (self.window >> 48) as u32
    }

    /// Takes up to 16 bits.
    #[inline]
    pub(super) fn take(&mut self, bits: u32) {
        self.window <<= bits;
        self.count = self.count.saturating_sub(bits);
    }

    /// Takes a number of up to 15 bits, where those that begin with 0 are negative (T.81, F.2.2.1).
    #[inline]
    pub(super) fn signed(&mut self, bits: u32) -> i32 {
        if bits == 0 {
            return 0;
        }
        let value = (self.window >> (64 - bits)) as i32;
        self.take(bits);
        let half = 1 << (bits - 1);
        if value < half { value - 2 * half + 1 } else { value }
    }

    /// Goes on behind the next restart marker, which has to be here.
    pub(super) fn restart(&mut self) -> Result<(), JpegDamage> {
        if self.is_past_end() {
            return Err(JpegDamage::Short);
        }
        (self.window, self.count, self.made_up) = (0, 0, 0);
        // A marker may have more than one 0xFF before it.
        while let Some([0xff, 0xff]) = self.data.get(self.at..self.at + 2) {
            self.at += 1;
        }
        match self.data.get(self.at..self.at + 2) {
            Some([0xff, 0xd0..=0xd7]) => self.at += 2,
            Some(_) => return Err(JpegDamage::Code),
            None => return Err(JpegDamage::Short),
        }
        Ok(())
    }

    fn fill_up(&mut self) {
        if let Some(next) = self.data[self.at..].first_chunk::<8>()
            && !next.contains(&0xff)
        {
            let bytes = (64 - self.count) / 8;
            let next = u64::from_be_bytes(*next);
            // With no byte to add nothing is shifted by 64.
            self.window |= next >> self.count & u64::MAX << (64 - self.count - 8 * bytes);
            self.count += 8 * bytes;
            self.at += bytes as usize;
            return;
        }
        while self.count <= 56 {
            let byte = self.next_byte();
            self.window |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    /// The next byte of data; zeros at a marker or at the end.
    fn next_byte(&mut self) -> u8 {
        match *self.data.get(self.at..).unwrap_or_default() {
            [0xff, 0, ..] => {
                self.at += 2;
                0xff
            }
            [0xff, ..] | [] => {
                self.made_up = self.made_up.saturating_add(8);
                0
            }
            [byte, ..] => {
                self.at += 1;
                byte
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads all as numbers of so many bits, as they are.
    fn all(data: &[u8], bits: u32) -> Vec<u32> {
        let mut reader = Bits::new(data);
        let mut read = Vec::new();
        loop {
            reader.fill();
            let value = reader.peek16() >> (16 - bits);
            reader.take(bits);
            if reader.is_past_end() {
                return read;
            }
            read.push(value);
        }
    }

    #[test]
    fn bits_come_from_the_highest_down_however_they_are_cut() {
        let data: Vec<u8> = (0..200u32).map(|n| (n * 37 % 255) as u8).collect();
        let bit = |n: usize| u32::from(data[n / 8] >> (7 - n % 8) & 1);
        for bits in [1u32, 3, 7, 8, 13, 16] {
            let read = all(&data, bits);
            assert_eq!(read.len(), data.len() * 8 / bits as usize, "{bits}");
            for (i, value) in read.iter().enumerate() {
                let expected = (0..bits as usize).fold(0, |v, k| v << 1 | bit(i * bits as usize + k));
                assert_eq!(*value, expected, "{bits} bits, number {i}");
            }
        }
    }

    #[test]
    fn a_zero_after_ff_is_left_out_and_a_marker_ends_the_data() {
        assert_eq!(all(&[0x12, 0xff, 0x00, 0x34, 0xff, 0xd9, 0x56], 8), [0x12, 0xff, 0x34]);
        assert_eq!(all(&[0xff], 8), [0u32; 0]);
        assert_eq!(all(&[], 4), [0u32; 0]);
    }

    #[test]
    fn numbers_that_begin_with_a_zero_are_negative() {
        let mut bits = Bits::new(&[0b0101_1011, 0b0000_0000]);
        bits.fill();
        assert_eq!((bits.signed(1), bits.signed(1), bits.signed(0)), (-1, 1, 0));
        assert_eq!((bits.signed(3), bits.signed(3)), (-4, -4));
    }

    #[test]
    fn restarts_are_where_they_have_to_be() {
        let mut bits = Bits::new(&[0x80, 0xff, 0xff, 0xd3, 0x40]);
        bits.fill();
        assert_eq!(bits.signed(1), 1);
        assert_eq!(bits.restart(), Ok(()));
        bits.fill();
        assert_eq!(bits.peek16(), 0x4000);
        assert_eq!(bits.restart(), Err(JpegDamage::Short));
        let mut bits = Bits::new(&[0x12, 0x34, 0x56]);
        assert_eq!(bits.restart(), Err(JpegDamage::Code));
    }
}
