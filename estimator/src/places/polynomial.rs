//! Real roots of small polynomials within an interval, by bracketing between the roots of the derivative: no case
//! distinctions, no trigonometric functions, the same bits everywhere.

/// Largest degree.
pub const MAX_DEGREE: usize = 4;
/// Steps of a bracketed Newton iteration; bisection alone would narrow the interval by 2^-60.
const MAX_STEPS: usize = 60;

/// Roots found, ascending.
#[derive(Clone, Copy, Debug, Default)]
pub struct Roots {
    values: [f64; MAX_DEGREE],
    count: usize,
}

impl Roots {
    /// The roots.
    pub fn as_slice(&self) -> &[f64] {
        &self.values[..self.count]
    }

    fn push(&mut self, value: f64) {
        if self.count < MAX_DEGREE {
            self.values[self.count] = value;
            self.count += 1;
        }
    }
}

/// Roots of `sum c_i x^i` in `[low, high]`; double roots that do not cross zero may be missed.
pub fn real_roots(coefficients: [f64; MAX_DEGREE + 1], low: f64, high: f64) -> Roots {
    roots_of(&coefficients, low, high)
}

fn roots_of(c: &[f64], low: f64, high: f64) -> Roots {
    let mut roots = Roots::default();
    if c.len() < 2 || c.iter().any(|x| !x.is_finite()) {
        return roots;
    }
    let mut derivative = [0.0; MAX_DEGREE];
    for (i, d) in derivative.iter_mut().enumerate().take(c.len() - 1) {
        *d = (i + 1) as f64 * c[i + 1];
    }
    let turns = roots_of(&derivative[..c.len() - 1], low, high);
    let mut from = low;
    for &to in turns.as_slice().iter().chain(&[high]) {
        if let Some(root) = bracketed(c, &derivative[..c.len() - 1], from, to) {
            roots.push(root);
        }
        from = to;
    }
    roots
}

fn value(c: &[f64], x: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// The root between two places of different sign, where the polynomial is monotonic.
fn bracketed(c: &[f64], derivative: &[f64], mut low: f64, mut high: f64) -> Option<f64> {
    let (at_low, at_high) = (value(c, low), value(c, high));
    if at_low == 0.0 {
        return (low < high).then_some(low);
    }
    if at_low.is_sign_negative() == at_high.is_sign_negative() {
        return None;
    }
    let rising = at_low < 0.0;
    let mut x = 0.5 * (low + high);
    for _ in 0..MAX_STEPS {
        let y = value(c, x);
        if (y < 0.0) == rising {
            low = x;
        } else {
            high = x;
        }
        let newton = x - y / value(derivative, x);
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - x).abs() <= 1e-14 * x.abs() {
            return Some(next);
        }
        x = next;
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_roots_of_a_product_are_found() {
        // (x - 0.5)(x - 1)(x - 2)(x + 3)
        let c = [-3.0, 9.5, -7.0, -0.5, 1.0];
        let roots = real_roots(c, -10.0, 10.0);
        for (root, expected) in roots.as_slice().iter().zip([-3.0, 0.5, 1.0, 2.0]) {
            assert!((root - expected).abs() < 1e-12);
        }
        assert_eq!(roots.as_slice().len(), 4);
        assert_eq!(real_roots(c, 0.0, 1.5).as_slice().len(), 2);
    }

    #[test]
    fn nonsense_has_no_roots() {
        assert!(real_roots([1.0, 0.0, 1.0, 0.0, 0.0], -5.0, 5.0).as_slice().is_empty());
        assert!(real_roots([f64::NAN; 5], -5.0, 5.0).as_slice().is_empty());
        assert!(real_roots([0.0; 5], -5.0, 5.0).as_slice().len() <= MAX_DEGREE);
    }
}
