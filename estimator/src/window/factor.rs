//! Common parts of all factors: the request for Jacobians, and the robust kernel.
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

/// The costs of residuals by Cauchy's kernel `c²/2 ln(1 + s/c²)`, summed over their squares `s` (in squared standard
/// deviations) for a `scale` `c`: a product takes the place of most of the logarithms.
#[derive(Clone, Debug)]
pub struct RobustSum {
    squared_scale: f64,
    product: f64,
    logarithms: f64,
}

impl RobustSum {
    /// Nothing yet; `scale` is that of the kernel, in standard deviations.
    pub fn new(scale: f64) -> Self {
        Self { squared_scale: scale * scale, product: 1.0, logarithms: 0.0 }
    }

    /// Adds the cost of a squared residual (in squared standard deviations); returns its weight.
    #[inline]
    pub fn add(&mut self, squared: f64) -> f64 {
        let factor = 1.0 + squared / self.squared_scale;
        let product = self.product * factor;
        if product.is_finite() {
            self.product = product;
        } else {
            self.logarithms += libm::log(factor);
        }
        1.0 / factor
    }

    /// The sum.
    pub fn cost(&self) -> f64 {
        0.5 * self.squared_scale * (self.logarithms + libm::log(self.product))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cost and weight of one squared residual.
    fn cauchy(squared: f64, scale: f64) -> (f64, f64) {
        let mut sum = RobustSum::new(scale);
        let weight = sum.add(squared);
        (sum.cost(), weight)
    }

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
    fn a_sum_is_that_of_the_costs_however_large_they_are() {
        for count in [0, 1, 2000] {
            let mut sum = RobustSum::new(1.7);
            let mut costs = 0.0;
            for k in 0..count {
                let squared = [0.0, 1e-7, 0.3, 12.0, 1e9, 1e200, f64::MAX][k % 7];
                costs += 0.5 * 1.7 * 1.7 * (squared / (1.7 * 1.7)).ln_1p();
                sum.add(squared);
            }
            assert!((sum.cost() - costs).abs() <= 1e-12 * costs, "{} instead of {costs}", sum.cost());
        }
        let mut sum = RobustSum::new(1.0);
        sum.add(f64::INFINITY);
        assert!(!sum.cost().is_finite());
        sum.add(f64::NAN);
        assert!(sum.cost().is_nan());
    }

    #[test]
    fn small_residuals_cost_what_least_squares_would_and_large_ones_little() {
        assert!((cauchy(1e-6, 2.0).0 - 0.5e-6).abs() < 1e-12);
        assert!(cauchy(1e8, 2.0).0 < 40.0);
    }
}
