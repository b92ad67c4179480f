//! Bits of 16-bit images that a camera fills.
//!
//! A camera of 10, 12 or 14 bits delivers numbers to 1023, 4095 or 16383, and many drivers store them so. The upper eight of
//! the sixteen bits are then nearly black. What a recording's largest value is says how many bits there are.

/// Bits that cameras fill.
const BITS: [u32; 5] = [8, 10, 12, 14, 16];

/// Number of the lower bits in use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Depth(u32);

impl Default for Depth {
    fn default() -> Self {
        Self::FULL
    }
}

impl Depth {
    /// All sixteen bits.
    pub(crate) const FULL: Self = Self(16);

    /// Depth of images whose largest value this is. Black images say nothing.
    pub(crate) fn of_largest(largest: u16) -> Self {
        let holds = |bits: &u32| u32::from(largest) < 1 << bits;
        if largest == 0 { Self::FULL } else { Self(BITS.into_iter().find(holds).unwrap_or(16)) }
    }

    /// The eight upper bits of those in use; what is above them is white.
    pub(crate) fn grey(self, value: u16) -> u8 {
        u8::try_from(value >> (self.0 - 8)).unwrap_or(u8::MAX)
    }
}
