//! What all factors have in common: the request for Jacobians, and the robust kernel.
//!
//! A factor is one function. It gives the residual at the present states and, on request, the Jacobians at the
//! states of linearization, which are others under first-estimates Jacobians (Huang et al. 2009).

/// A request for the Jacobians of a factor.
#[derive(Debug)]
pub struct Linearization<'a, P, J> {
    /// The states at which they are taken.
    pub at: P,
    /// Where they are put.
    pub jacobians: &'a mut J,
}

/// Cauchy's kernel `c²/2 ln(1 + s/c²)`: cost and weight of the squared residual `s` (in squared standard
/// deviations) for the kernel's `scale` `c` (in standard deviations).
#[must_use]
pub fn cauchy(squared: f64, scale: f64) -> (f64, f64) {
    let c2 = scale * scale;
    let ratio = squared / c2;
    (0.5 * c2 * libm::log1p(ratio), 1.0 / (1.0 + ratio))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weight_is_twice_the_derivative_of_the_cost() {
        for squared in [0.0, 0.3, 4.0, 900.0] {
            let h = 1e-6 * (1.0 + squared);
            let slope = (cauchy(squared + h, 2.0).0 - cauchy((squared - h).max(0.0), 2.0).0)
                / (squared + h - (squared - h).max(0.0));
            assert!((2.0 * slope - cauchy(squared, 2.0).1).abs() < 1e-5, "{squared}");
        }
    }

    #[test]
    fn small_residuals_cost_what_least_squares_would_and_large_ones_little() {
        assert!((cauchy(1e-6, 2.0).0 - 0.5e-6).abs() < 1e-12);
        assert!(cauchy(1e8, 2.0).0 < 40.0);
    }
}
