//! Noise for pixels.

use crate::random::{Draws, Purpose};

/// Normal values drawn ahead; runs of noise are pieces of this table.
const TABLE: usize = 1 << 15;
/// Pixels that take one piece of the table.
pub(crate) const NOISE_RUN: usize = 32;

/// Table of normal values, of a seed.
#[derive(Clone, Debug)]
pub(crate) struct NoiseTable {
    values: Vec<f32>,
    seed: u64,
}

impl NoiseTable {
    pub(crate) fn new(seed: u64) -> Self {
        let mut draws = Draws::new(seed, Purpose::ImageNoise, u64::MAX);
        Self { values: (0..TABLE + NOISE_RUN).map(|_| draws.normal() as f32).collect(), seed }
    }

    /// Runs of noise of unit variance for the image of `camera` in frame `sequence`.
    pub(crate) fn runs(&self, sequence: u64, camera: usize) -> impl Iterator<Item = &[f32]> {
        let mut draws = Draws::new(self.seed, Purpose::ImageNoise, 2 * sequence + camera as u64);
        std::iter::repeat_with(move || &self.values[draws.index(TABLE)..][..NOISE_RUN])
    }
}
