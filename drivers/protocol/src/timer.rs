//! A timer of few bits to nanoseconds.

/// Nanoseconds of a second.
const SECOND_NS: u64 = 1_000_000_000;

/// Makes nanoseconds that never begin anew of a timer of 32 bits that does. It has to be read at least once in half its
/// round: 12 s at 170 MHz.
#[derive(Clone, Copy, Debug)]
pub struct Timer {
    hertz: u32,
    ticks: u64,
}

impl Timer {
    /// A timer of so many ticks a second (1 where 0 is given).
    #[must_use]
    pub const fn new(hertz: u32) -> Self {
        Self { hertz: if hertz == 0 { 1 } else { hertz }, ticks: 0 }
    }

    /// The time of a reading, ns. A reading a little before the last one, as of an interrupt that was stamped earlier, is
    /// taken as such.
    pub const fn nanos(&mut self, reading: u32) -> u64 {
        let ahead = reading.wrapping_sub(self.ticks as u32) as i32;
        let ticks = self.ticks.saturating_add_signed(ahead as i64);
        if ahead > 0 {
            self.ticks = ticks;
        }
        let hertz = self.hertz as u64;
        (ticks / hertz) * SECOND_NS + (ticks % hertz) * SECOND_NS / hertz
    }
}
