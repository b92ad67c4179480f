//! White noise and bias walk of one axis, from its Allan variance.
//!
//! The model is `sigma²(tau) = N² / tau + K² tau / 3`. An Allan variance of `f` degrees of freedom is spread about the true one
//! as a chi-square over `f`: its maximum of likelihood is found by Fisher scoring, which is weighted least squares with
//! the weights `f / (2 sigma⁴)` of the model. Averages shorter than [`SHORTEST_S`] are left out: a sensor's own filter
//! and the steps of its converter colour them.

use super::allan::AllanPoint;

/// Averages count from here on, s.
const SHORTEST_S: f64 = 0.05;
/// Steps of the search; it settles within ten.
const STEPS: usize = 60;
/// The random walk is significant if it exceeds this many of its standard deviations.
const SEEN_SIGMAS: f64 = 3.0;
/// Overlapping averages of neighbouring octaves share samples, so that their variances are not independent: by this much
/// the standard deviations of the fit grow (measured over simulated sensors, see the tests).
const SHARED_SAMPLES: f64 = 1.4;

/// A number with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// The number.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// Finds about one axis.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisNoise {
    /// White noise density: unit of the rate / sqrt(Hz).
    pub density: Measured,
    /// Bias walk: unit of the rate / s / sqrt(Hz); `None` when it is hidden by the white noise.
    pub walk: Option<Measured>,
    /// The walk is below this, with a confidence of 97.5 percent.
    pub walk_at_most: f64,
    /// Mean square of the misfit over what the model expects; well above 1 the noise is of another kind too.
    pub misfit: f64,
    /// The lowest Allan deviation, in the unit of the rate, and its averaging time, s: where the bias is as stable as
    /// it gets.
    pub floor: (f64, f64),
    /// The Allan variance.
    pub points: Vec<AllanPoint>,
}

impl AxisNoise {
    /// The variance that was fitted, at an averaging time.
    #[must_use]
    pub fn model(&self, tau_s: f64) -> f64 {
        let walk = self.walk.map_or(0.0, |walk| walk.value);
        self.density.value.powi(2) / tau_s + walk.powi(2) * tau_s / 3.0
    }
}

/// Fits an axis; `None` where there are too few averages or no noise at all.
#[must_use]
pub fn fit(points: Vec<AllanPoint>) -> Option<AxisNoise> {
    let used: Vec<AllanPoint> = points.iter().copied().filter(|p| p.tau_s >= SHORTEST_S).collect();
    if used.len() < 3 || used.iter().any(|p| !(p.variance.is_finite() && p.variance > 0.0)) {
        return None;
    }
    let both = score(&used, true);
    let fitted = if both.walk2 > 0.0 { both } else { score(&used, false) };
    let misfit = fitted.misfit(&used);
    // Where the model does not hold the numbers are less certain than it says.
    let spread = SHARED_SAMPLES * misfit.max(1.0).sqrt();
    let (density, walk) = (fitted.white2.sqrt(), fitted.walk2.max(0.0).sqrt());
    let sigmas = [both.sigmas[0] * spread, both.sigmas[1] * spread];
    let is_seen = fitted.walk2 > SEEN_SIGMAS * sigmas[1];
    let floor = used.iter().min_by(|a, b| a.variance.total_cmp(&b.variance))?;
    Some(AxisNoise {
        density: Measured { value: density, sigma: sigmas[0] / (2.0 * density) },
        walk: is_seen.then(|| Measured { value: walk, sigma: sigmas[1] / (2.0 * walk) }),
        walk_at_most: (fitted.walk2.max(0.0) + 2.0 * sigmas[1]).sqrt(),
        misfit,
        floor: (floor.deviation(), floor.tau_s),
        points,
    })
}

/// Squares of density and walk, and the standard deviations of these squares.
#[derive(Clone, Copy, Debug)]
struct Fitted {
    white2: f64,
    walk2: f64,
    sigmas: [f64; 2],
}

impl Fitted {
    fn variance(&self, tau_s: f64) -> f64 {
        self.white2 / tau_s + self.walk2.max(0.0) * tau_s / 3.0
    }

    /// Degrees of freedom of `point`, by the kind of noise that rules there.
    fn freedom(&self, point: &AllanPoint) -> f64 {
        let white = self.white2 / point.tau_s / self.variance(point.tau_s);
        white * point.freedom_white + (1.0 - white) * point.freedom_walk
    }

    fn misfit(&self, points: &[AllanPoint]) -> f64 {
        let square =
            |p: &AllanPoint| 0.5 * self.freedom(p) * (p.variance / self.variance(p.tau_s) - 1.0).powi(2);
        points.iter().map(square).sum::<f64>() / (points.len() - 2) as f64
    }
}

/// Fisher scoring, with the walk or without one.
fn score(points: &[AllanPoint], with_walk: bool) -> Fitted {
    let first = &points[0];
    let mut fitted = Fitted { white2: first.variance * first.tau_s, walk2: 0.0, sigmas: [0.0; 2] };
    for _ in 0..STEPS {
        let (mut h, mut b) = ([[0.0; 2]; 2], [0.0; 2]);
        for point in points {
            let by = [1.0 / point.tau_s, if with_walk { point.tau_s / 3.0 } else { 0.0 }];
            let weight = fitted.freedom(point) / (2.0 * fitted.variance(point.tau_s).powi(2));
            for i in 0..2 {
                b[i] += weight * by[i] * point.variance;
                for j in 0..2 {
                    h[i][j] += weight * by[i] * by[j];
                }
            }
        }
        if !with_walk {
            let white2 = b[0] / h[0][0];
            fitted = Fitted { white2, walk2: 0.0, sigmas: [h[0][0].recip().sqrt(), 0.0] };
            continue;
        }
        let determinant = h[0][0] * h[1][1] - h[0][1] * h[1][0];
        let white2 = (h[1][1] * b[0] - h[0][1] * b[1]) / determinant;
        let walk2 = (h[0][0] * b[1] - h[1][0] * b[0]) / determinant;
        let sigmas = [(h[1][1] / determinant).sqrt(), (h[0][0] / determinant).sqrt()];
        // A density of nothing has no weights: the search stays above.
        fitted = Fitted { white2: white2.max(1e-3 * fitted.white2), walk2, sigmas };
    }
    fitted
}

#[cfg(test)]
mod tests {
    use super::super::allan::allan_variance;
    use super::*;

    /// Points that lie on the model.
    fn exact(density: f64, walk: f64) -> Vec<AllanPoint> {
        let point = |octave: i32| {
            let tau_s = 0.01 * 2.0_f64.powi(octave);
            let variance = density.powi(2) / tau_s + walk.powi(2) * tau_s / 3.0;
            let freedom = 1e6 / 2.0_f64.powi(octave);
            AllanPoint {
                tau_s,
                samples: 1 << octave,
                variance,
                freedom_white: freedom,
                freedom_walk: freedom,
            }
        };
        (0..17).map(point).collect()
    }

    #[test]
    fn points_on_the_model_give_the_model_back() {
        for (density, walk) in [(1.7e-4, 1.9e-5), (2e-3, 3e-3), (1e-2, 1e-4)] {
            let found = fit(exact(density, walk)).unwrap();
            assert!((found.density.value / density - 1.0).abs() < 1e-9, "{found:?}");
            assert!((found.walk.unwrap().value / walk - 1.0).abs() < 1e-6, "{found:?}");
            assert!(found.misfit < 1e-6);
        }
    }

    #[test]
    fn a_walk_that_white_noise_hides_is_bounded_and_not_named() {
        let found = fit(exact(1e-2, 0.0)).unwrap();
        assert!((found.density.value / 1e-2 - 1.0).abs() < 1e-9);
        assert_eq!(found.walk, None);
        assert!(found.walk_at_most > 0.0 && found.walk_at_most < 1e-4, "{found:?}");
    }

    #[test]
    fn noise_of_another_kind_shows_as_a_misfit() {
        let mut points = exact(1e-3, 1e-5);
        // A floor that neither white noise nor walk can make.
        points.iter_mut().for_each(|p| p.variance += 1e-6);
        assert!(fit(points).unwrap().misfit > 4.0);
    }

    #[test]
    fn what_has_no_noise_or_is_too_short_is_not_fitted() {
        assert_eq!(fit(allan_variance(&[1.0; 4000], 0.005)), None);
        assert_eq!(fit(allan_variance(&[1.0, 2.0, 1.0, 3.0, 1.0, 2.0, 4.0, 0.0], 0.005)), None);
    }
}
