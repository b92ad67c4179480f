//! Seeded draws: every value is a pure function of a seed and of where it is used, so that nothing
//! depends on the order in which frames, cameras or threads come.

use plumbline_config::Random;

/// Mixes 64 bits.
pub(crate) const fn mix(value: u64) -> u64 {
    Random::new(value).next_bits()
}

/// Purpose of a stream of random numbers; keeps streams of one seed apart. Another number is another stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub(crate) enum Purpose {
    Layout = 1,
    Texture = 2,
    Bias = 3,
    ImuNoise = 4,
    Vibration = 5,
    ImageNoise = 6,
    Flicker = 7,
    Drop = 8,
    Hand = 9,
    Wander = 12,
    ForceError = 13,
    SensorAxes = 14,
    Calibration = 16,
    Lean = 17,
    Intrinsics = 18,
    People = 21,
    Injected = 22,
}

/// A stream of draws.
#[derive(Clone, Debug)]
pub(crate) struct Draws(Random);

impl Draws {
    /// The stream of `seed` for `purpose`, number `index`. The first draw is left out.
    pub(crate) const fn new(seed: u64, purpose: Purpose, index: u64) -> Self {
        let mut random = Random::new(mix(mix(mix(seed) ^ purpose as u64) ^ index));
        random.next_bits();
        Self(random)
    }

    /// 64 random bits.
    pub(crate) const fn bits(&mut self) -> u64 {
        self.0.next_bits()
    }

    /// Uniform in `[0, 1)`.
    pub(crate) const fn unit(&mut self) -> f64 {
        self.0.unit()
    }

    /// Uniform in `[low, high)`.
    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in `0..count`.
    pub(crate) const fn index(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// Standard normal (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.unit())).sqrt();
        radius * libm::cos(std::f64::consts::TAU * self.unit())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_by_seed_purpose_and_index() {
        let first = |seed, purpose, index| Draws::new(seed, purpose, index).bits();
        let reference = first(1, Purpose::Bias, 0);
        assert_eq!(reference, first(1, Purpose::Bias, 0));
        assert_ne!(reference, first(2, Purpose::Bias, 0));
        assert_ne!(reference, first(1, Purpose::Drop, 0));
        assert_ne!(reference, first(1, Purpose::Bias, 1));
    }
}
