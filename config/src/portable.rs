//! Arithmetic that has the same bits on every processor where that of `std` leaves a choice.
//!
//! `f64::max` and `f64::min` may return either of two zeros of unlike sign, and `f64::powi` may round as the platform
//! likes. What is here is a comparison or a product, so there is nothing to choose. In vectors too it is one
//! instruction, or two.

/// Floating-point operations with one result on every processor: no choice between zeros of unlike sign, none in
/// rounding.
pub trait Portable: Copy {
    /// The number, or `limit` where that is not less. Of a number that is NaN, `limit`.
    #[must_use]
    fn at_least(self, limit: Self) -> Self;

    /// The number, or `limit` where that is not greater. Of a number that is NaN, `limit`.
    #[must_use]
    fn at_most(self, limit: Self) -> Self;

    /// The number times itself.
    #[must_use]
    fn squared(self) -> Self;
}

macro_rules! portable {
    ($($float:ty),*) => {$(
        impl Portable for $float {
            #[inline]
            fn at_least(self, limit: Self) -> Self {
                if self > limit { self } else { limit }
            }

            #[inline]
            fn at_most(self, limit: Self) -> Self {
                if self < limit { self } else { limit }
            }

            #[inline]
            fn squared(self) -> Self {
                self * self
            }
        }
    )*};
}

portable!(f32, f64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_zeros_the_limit_is_taken() {
        assert_eq!((-0.0_f64).at_least(0.0).to_bits(), 0.0_f64.to_bits());
        assert_eq!(0.0_f64.at_least(-0.0).to_bits(), (-0.0_f64).to_bits());
        assert_eq!(0.0_f32.at_most(-0.0).to_bits(), (-0.0_f32).to_bits());
        assert_eq!((-0.0_f32).at_most(0.0).to_bits(), 0.0_f32.to_bits());
    }

    #[test]
    fn what_is_no_number_becomes_the_limit() {
        assert_eq!(f64::NAN.at_least(1.0), 1.0);
        assert_eq!(f32::NAN.at_most(1.0), 1.0);
    }

    #[test]
    fn numbers_are_kept_within_limits() {
        assert_eq!([1.0, 2.0, 3.0].map(|x: f64| x.at_least(2.0)), [2.0, 2.0, 3.0]);
        assert_eq!([1.0, 2.0, 3.0].map(|x: f64| x.at_most(2.0)), [1.0, 2.0, 2.0]);
        assert_eq!((-3.0_f32).squared(), 9.0);
    }
}
