//! A-contrario validation: would so many aligned pixels in a row appear by chance?
//!
//! Source: Grompone von Gioi et al., "LSD: a line segment detector", IPOL 2012, section 2.4: a segment of
//! `n` pixels of which `k` are aligned has the number of false alarms `N B(n, k, p)`, with `B` the tail of
//! the binomial distribution and `N` the number of segments that the image could hold.

/// Probability that the gradient of a pixel of noise is aligned with a given edge: 1/8 by the tolerance of
/// [`super::growth`] (22.5 degrees to either side), and more as the steepest of three pixels is taken.
pub const ALIGNED_BY_CHANCE: f64 = 0.2;
/// Probability of alignment by chance for a first test at half the resolution: on half the pixels, and without losses.
pub const ALIGNED_BY_CHANCE_AT_HALF: f64 = 0.1;
/// Longest segment that is judged by its true length, px; a longer one is judged as this long.
const MAX_LENGTH: usize = 1024;

/// Judges segments of images of one size.
#[derive(Clone, Debug)]
pub struct Validation {
    /// Natural logarithms of factorials.
    ln_factorial: Vec<f64>,
    /// Logarithm of the number of segments that the image could hold.
    ln_tests: f64,
    /// Ratio of the probabilities that a pixel of noise is aligned and that it is not, and their logarithms.
    odds: f64,
    ln_chances: [f64; 2],
}

impl Validation {
    /// For images of `width` x `height`; a pixel of noise is aligned with the probability `chance`.
    pub fn new(width: usize, height: usize, chance: f64) -> Self {
        let mut ln_factorial = vec![0.0; MAX_LENGTH + 1];
        for n in 1..=MAX_LENGTH {
            ln_factorial[n] = ln_factorial[n - 1] + libm::log(n as f64);
        }
        // From any pixel to any other; segments grown here have one width, where LSD counts several.
        let ln_tests = 2.0 * libm::log((width * height) as f64);
        let ln_chances = [chance, 1.0 - chance].map(libm::log);
        Self { ln_factorial, ln_tests, odds: chance / (1.0 - chance), ln_chances }
    }

    /// True if `aligned` of `length` pixels mean an edge: fewer than one false alarm an image.
    pub fn is_meaningful(&self, length: usize, aligned: usize) -> bool {
        let n = length.min(MAX_LENGTH);
        let k = (aligned * n).div_ceil(length.max(1)).min(n);
        self.ln_tests + self.ln_tail(n, k) < 0.0
    }

    /// Logarithm of the probability of `k` or more aligned pixels among `n`.
    fn ln_tail(&self, n: usize, k: usize) -> f64 {
        let ln_choose = self.ln_factorial[n] - self.ln_factorial[k] - self.ln_factorial[n - k];
        let [aligned, other] = self.ln_chances;
        let first = ln_choose + k as f64 * aligned + (n - k) as f64 * other;
        // Terms fall at least geometrically beyond the mean: their sum, relative to the first.
        let (mut sum, mut term) = (1.0, 1.0);
        for i in k..n {
            term *= (n - i) as f64 / (i + 1) as f64 * self.odds;
            sum += term;
            if term < 1e-3 * sum {
                break;
            }
        }
        first + libm::log(sum)
    }
}
