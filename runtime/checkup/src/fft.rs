//! The power spectrum of a real series (Cooley and Tukey 1965, radix 2, in place).

use std::f64::consts::PI;

/// Power of the frequencies `0..=n/2` of `series`, whose length `n` is a power of two: `|sum x_k e^(-2 pi i j k / n)|²`.
pub(crate) fn power(series: &[f64]) -> Vec<f64> {
    let n = series.len();
    debug_assert!(n.is_power_of_two(), "length {n}");
    let bits = n.trailing_zeros();
    let mut z: Vec<(f64, f64)> = vec![(0.0, 0.0); n];
    for (k, x) in series.iter().enumerate() {
        let at = if bits == 0 { 0 } else { k.reverse_bits() >> (usize::BITS - bits) };
        z[at] = (*x, 0.0);
    }
    let mut half = 1;
    while half < n {
        for start in (0..n).step_by(2 * half) {
            for k in 0..half {
                let (sin, cos) = (-PI * k as f64 / half as f64).sin_cos();
                let (a, b) = (z[start + k], z[start + k + half]);
                let turned = (b.0 * cos - b.1 * sin, b.0 * sin + b.1 * cos);
                z[start + k] = (a.0 + turned.0, a.1 + turned.1);
                z[start + k + half] = (a.0 - turned.0, a.1 - turned.1);
            }
        }
        half *= 2;
    }
    z[..=n / 2].iter().map(|(re, im)| re * re + im * im).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_sum_that_defines_it() {
        let series: Vec<f64> = (0..32).map(|k| ((k * k) % 13) as f64 - 0.3 * k as f64).collect();
        for (j, power) in power(&series).into_iter().enumerate() {
            let (mut re, mut im) = (0.0, 0.0);
            for (k, x) in series.iter().enumerate() {
                let angle = -2.0 * PI * (j * k) as f64 / 32.0;
                re += x * angle.cos();
                im += x * angle.sin();
            }
            assert!((power - (re * re + im * im)).abs() < 1e-9 * (1.0 + power), "{j}");
        }
    }
}
