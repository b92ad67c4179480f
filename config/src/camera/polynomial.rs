//! Sign of a polynomial by its Bernstein coefficients. It lies within their hull; the interval is halved until the sign is certain.
//!
//! Source: Farouki, "The Bernstein polynomial basis: a centennial retrospective", Computer Aided Geometric Design 29 (2012).

/// Halvings of the interval: a thousandth of it is told apart. What is still undecided counts as not positive.
const HALVINGS: usize = 10;

/// True if `c[0] + c[1] u + c[2] u² + ...` is positive for all `u` from 0 to `end`.
#[inline]
pub(super) fn is_positive<const N: usize>(c: &[f64; N], end: f64) -> bool {
    let mut b = *c;
    let (mut power, mut binomial) = (1.0, 1.0);
    for (i, b) in b.iter_mut().enumerate() {
        *b = *b * power / binomial;
        power *= end;
        binomial = binomial * (N - 1 - i) as f64 / (i + 1) as f64;
    }
    for from in 1..N {
        for j in (from..N).rev() {
            b[j] += b[j - 1];
        }
    }
    is_positive_bernstein(&b, HALVINGS)
}

fn is_positive_bernstein<const N: usize>(b: &[f64; N], halvings: usize) -> bool {
    if b.iter().all(|b| *b > 0.0) {
        return true;
    }
    // The first and the last coefficient are values of the polynomial. No number compares as greater.
    let ends_are_positive = b[0] > 0.0 && b[N - 1] > 0.0;
    if !ends_are_positive || halvings == 0 {
        return false;
    }
    let (mut left, mut right) = (*b, *b);
    for (i, left) in left.iter_mut().enumerate().skip(1) {
        for j in 0..N - i {
            right[j] = 0.5 * (right[j] + right[j + 1]);
        }
        *left = right[0];
    }
    is_positive_bernstein(&left, halvings - 1) && is_positive_bernstein(&right, halvings - 1)
}

#[cfg(test)]
mod tests {
    use super::is_positive;

    #[test]
    fn a_polynomial_is_positive_up_to_its_first_root() {
        // (1 - u)(2 - u), and the same with u².
        for end in [0.0, 0.5, 0.99] {
            assert!(is_positive(&[2.0, -3.0, 1.0], end), "{end}");
            assert!(is_positive(&[2.0, 0.0, -3.0, 0.0, 1.0], end), "{end}");
        }
        for end in [1.0, 1.5, 2.5, 1e6, f64::INFINITY, f64::NAN] {
            assert!(!is_positive(&[2.0, -3.0, 1.0], end), "{end}");
        }
        assert!(!is_positive(&[f64::NAN, 1.0], 0.5));
    }

    /// `(u - 0.3)² + 1e-4` comes near to zero and stays positive.
    #[test]
    fn a_shallow_valley_is_no_root() {
        assert!(is_positive(&[0.09 + 1e-4, -0.6, 1.0], 10.0));
        assert!(!is_positive(&[0.09 - 1e-4, -0.6, 1.0], 10.0));
    }
}
