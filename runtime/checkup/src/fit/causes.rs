//! Which single change of a calibration explains most.
//!
//! With the quadratics of the pieces, freeing some directions of the calibration, for the whole recording or for each of its
//! segments, lowers the cost by `b' H^-1 b`. The change that lowers it most is the cause; what remains then is asked again.

use super::parts::{Course, Part};
use super::rig::{BIASES, CALIBRATION, DELAY, GYRO, Vector};
use super::{Fitted, KEYS};
use nalgebra::{DMatrix, DVector, SMatrix};
use plumbline_config::median;

/// A change is real from so many standard deviations on.
pub(crate) const SIGMAS: f64 = 3.0;
/// Among changes that explain this share of what the best one does, the simplest is the cause: of all, and then of its subject.
const AS_GOOD: (f64, f64) = (0.95, 0.85);
/// Share of what all causes explain that a further one explains at least.
const LEAST_SHARE: f64 = 0.1;
/// Information on a column of a sensor that the noise of a piece alone makes up: of each step between keyframes, by velocity and position.
const ECHO: f64 = 2.0 * (KEYS - 1) as f64;
/// Causes that are looked for.
const MAX_CAUSES: usize = 5;
/// Median of a chi-square of one degree of freedom.
const MEDIAN_CHI2: f64 = 0.455;
/// Offsets of gyroscopes, rad/s, and of accelerometers, m/s^2: data sheets have 20 degrees/s and 80 mg at most, three of these.
const OFFSETS: [f64; 2] = [0.1, 0.3];
/// Information of directions that the data do not hold.
const FAINT: f64 = 1e-6;

/// A change that explains something.
#[derive(Clone, Debug)]
pub(crate) struct Cause {
    /// Place of the part.
    pub(crate) part: usize,
    pub(crate) course: Course,
    /// Share of the cost above that of the best calibration that it explains.
    pub(crate) share: f64,
}

/// Quadratics about the configuration.
pub(crate) struct Causes<'a> {
    parts: &'a [Part],
    /// Slope at the configuration, information, and place in the recording, of each piece.
    pieces: Vec<(Vector, SMatrix<f64, CALIBRATION, CALIBRATION>, f64)>,
    /// By how much squares of the residuals are larger than they say: pieces scatter more.
    pub(crate) dispersion: f64,
}

impl<'a> Causes<'a> {
    pub(crate) fn new(fitted: &Fitted, parts: &'a [Part]) -> Self {
        let slope = |(g, s, at): &(Vector, SMatrix<f64, CALIBRATION, CALIBRATION>, f64)| {
            (g - s * fitted.steps, *s, *at)
        };
        let ratios = fitted.pieces.iter().flat_map(|(gradient, information, _)| {
            (0..BIASES)
                .filter(|k| information[(*k, *k)] > FAINT)
                .map(|k| gradient[k] * gradient[k] / information[(k, k)])
        });
        let dispersion = (median(ratios).unwrap_or(1.0) / MEDIAN_CHI2).max(1.0);
        Self { parts, pieces: fitted.pieces.iter().map(slope).collect(), dispersion }
    }

    fn segments(&self, course: Course) -> usize {
        match course {
            Course::Constant => 1,
            Course::Thirds => 3,
            Course::Pieces => self.pieces.len(),
        }
    }

    /// Lowering of the cost by freeing these parts, with their values and covariance in order; the biases are free.
    pub(crate) fn freed(&self, free: &[(usize, Course)]) -> (f64, DVector<f64>, DMatrix<f64>) {
        let width =
            |(part, course): &(usize, Course)| self.parts[*part].basis.ncols() * self.segments(*course);
        let count = 6 + free.iter().map(width).sum::<usize>();
        let mut h = DMatrix::<f64>::identity(count, count) * FAINT;
        for k in 0..6 {
            h[(count - 6 + k, count - 6 + k)] = OFFSETS[k / 3].powi(-2) * self.dispersion;
        }
        let mut b = DVector::<f64>::zeros(count);
        let mut own = Vec::with_capacity(self.pieces.len());
        for (k, (slope, information, share)) in self.pieces.iter().enumerate() {
            let mut map = DMatrix::<f64>::zeros(CALIBRATION, count);
            for bias in 0..6 {
                map[(BIASES + bias, count - 6 + bias)] = 1.0;
            }
            let mut at = 0;
            for entry in free {
                let basis = &self.parts[entry.0].basis;
                let segment = match entry.1 {
                    Course::Constant => 0,
                    Course::Thirds => ((share * 3.0) as usize).min(2),
                    Course::Pieces => k,
                };
                map.columns_mut(at + segment * basis.ncols(), basis.ncols()).copy_from(basis);
                at += width(entry);
            }
            let (square, right) = (map.transpose() * information * &map, map.transpose() * slope);
            h += &square;
            b += &right;
            own.push((square, right));
        }
        let Some(root) = h.cholesky() else {
            return (0.0, DVector::zeros(count), DMatrix::identity(count, count));
        };
        let step = -root.solve(&b);
        // Pieces that pull to different sides know less than they say: the covariance of clustered residuals.
        let pulls = own.iter().map(|(square, right)| square * &step + right);
        let scatter = pulls
            .map(|pull| &pull * pull.transpose())
            .fold(DMatrix::zeros(count, count), |sum: DMatrix<f64>, one| sum + one);
        let (inverse, others) = (root.inverse(), own.len() as f64 - 1.0);
        let clustered = &inverse * scatter * &inverse * ((others + 1.0) / others.max(1.0) * of_few(others));
        let inverse_diagonal = inverse.diagonal();
        let stated = inverse * self.dispersion;
        let mut covariance = stated.zip_map(&clustered, |a, b| if a.abs() > b.abs() { a } else { b });
        for (k, echo) in self.echoes(free, &inverse_diagonal).enumerate() {
            // It turns no sign, and has pulled by no more than what is missing.
            if (-1.0 - SIGMAS * covariance[(k, k)].sqrt()..0.0).contains(&step[k]) {
                covariance[(k, k)] += echo.min(-step[k]).powi(2);
            }
        }
        (-step.dot(&b), step, covariance)
    }

    /// Columns of a sensor multiply its noise too, which pulls each gain to zero: by no more than this share of it, where variances are
    /// these, and by no more than all.
    fn echoes<'b>(
        &'b self,
        free: &'b [(usize, Course)],
        variances: &'b DVector<f64>,
    ) -> impl Iterator<Item = f64> + 'b {
        let columns = free.iter().flat_map(move |(part, course)| {
            let (basis, segments) = (&self.parts[*part].basis, self.segments(*course));
            let of_sensors = |column| {
                let gains = basis.column(column).rows(GYRO, 18).into_owned();
                [0, 4, 8, 9, 13, 17].map(|k| gains[k] * gains[k]).iter().sum::<f64>()
            };
            let steps = ECHO * self.pieces.len() as f64 / segments as f64;
            (0..segments * basis.ncols()).map(move |k| steps * of_sensors(k % basis.ncols()))
        });
        columns.zip(variances.iter()).map(|(information, variance)| (information * variance).min(1.0))
    }

    /// The causes, that which explains most first.
    pub(crate) fn found(&self) -> Vec<Cause> {
        let mut free: Vec<(usize, Course)> = Vec::new();
        let mut causes = Vec::new();
        let (mut explained, _, _) = self.freed(&[]);
        let none = explained;
        while causes.len() < MAX_CAUSES {
            let mut gains: Vec<(f64, usize, (usize, Course))> = Vec::new();
            for part in 0..self.parts.len() {
                let Part { subject, courses, .. } = self.parts[part];
                for course in courses.iter().copied() {
                    let is_free = free
                        .iter()
                        .any(|(other, before)| self.parts[*other].subject == subject && *before >= course);
                    if is_free {
                        continue;
                    }
                    let (lowered, step, _) = self.freed(&[&[(part, course)], &free[..]].concat());
                    // That is no scale any more, but other columns.
                    if (10..=11).contains(&subject) && self.parts[part].counted == 1 && step[0] < -0.5 {
                        continue;
                    }
                    let count = self.parts[part].basis.ncols() * self.segments(course);
                    let gain = (lowered - explained) / self.dispersion - SIGMAS * SIGMAS * count as f64;
                    gains.push((gain, count, (part, course)));
                }
            }
            let Some(best) = gains.iter().map(|gain| gain.0).max_by(f64::total_cmp) else { break };
            let simplest = |least: f64, subject: Option<usize>| {
                let of_subject = |gain: &&(f64, usize, (usize, Course))| {
                    gain.0 >= least && subject.is_none_or(|subject| self.parts[gain.2.0].subject == subject)
                };
                gains.iter().filter(of_subject).min_by(|a, b| a.1.cmp(&b.1).then(b.0.total_cmp(&a.0)))
            };
            // First the subject, then the simplest change of it.
            let subject = simplest(AS_GOOD.0 * best, None).map(|gain| self.parts[gain.2.0].subject);
            let Some((gain, _, entry)) = simplest(AS_GOOD.1 * best, subject) else { break };
            if *gain <= 0.0 {
                break;
            }
            let lowered = self.freed(&[&free[..], &[*entry]].concat()).0;
            // The rest of a first cause is no second one.
            if !causes.is_empty() && lowered - explained < LEAST_SHARE * (lowered - none) {
                break;
            }
            free.push(*entry);
            causes.push(Cause { part: entry.0, course: entry.1, share: lowered - explained });
            explained = lowered;
        }
        let all = (explained - none).max(f64::MIN_POSITIVE);
        causes.iter_mut().for_each(|cause| cause.share /= all);
        causes
    }

    /// Values of a part, one for each segment of a course, with their standard deviations; causes of other subjects are free.
    pub(crate) fn values(
        &self,
        part: usize,
        course: Course,
        causes: &[Cause],
    ) -> Vec<(DVector<f64>, DVector<f64>)> {
        let subject = self.parts[part].subject;
        // A delay that comes with another part would be free twice.
        let is_delay = self.parts[part].basis[(DELAY, 0)] != 0.0;
        let others = causes.iter().filter(|cause| {
            let other = &self.parts[cause.part];
            other.subject != subject && !(is_delay && other.counted < other.basis.ncols())
        });
        let free: Vec<(usize, Course)> =
            [(part, course)].into_iter().chain(others.map(|c| (c.part, c.course))).collect();
        let (_, step, covariance) = self.freed(&free);
        let count = self.parts[part].basis.ncols();
        let sigmas = covariance.diagonal().map(f64::sqrt);
        let counted = self.parts[part].counted;
        let of = |k: usize| {
            (step.rows(k * count, counted).into_owned(), sigmas.rows(k * count, counted).into_owned())
        };
        (0..self.segments(course)).map(of).collect()
    }
}

/// By how much a variance that was measured with `freedom` degrees of freedom counts for more, so that [`SIGMAS`] of it are as rare as of one
/// that is known: Student's t by the normal distribution (Wallace 1959).
fn of_few(freedom: f64) -> f64 {
    let freedom = freedom.max(1.0);
    let z = SIGMAS * (8.0 * freedom + 3.0) / (8.0 * freedom + 1.0);
    freedom * ((z * z / freedom).exp() - 1.0) / (SIGMAS * SIGMAS)
}

#[cfg(test)]
mod tests {
    use super::super::parts::parts;
    use super::super::rig::ACCEL;
    use super::*;
    use plumbline_config::Config;

    #[test]
    fn a_column_of_a_sensor_that_noise_alone_shows_is_not_known() {
        let parts = parts(&Config::preset("sim").unwrap());
        let axes = parts.iter().position(|part| part.name == "accelerometer axes").unwrap();
        let sigma_of = |information_of_piece: f64| {
            let (mut slope, mut information) = (Vector::zeros(), SMatrix::zeros());
            // By its slope the column is zero.
            (slope[ACCEL + 4], information[(ACCEL + 4, ACCEL + 4)]) =
                (information_of_piece, information_of_piece);
            let pieces = vec![(slope, information, 0.5); 10];
            let causes = Causes { parts: &parts, pieces, dispersion: 1.0 };
            causes.values(axes, Course::Constant, &[])[0].1[4]
        };
        assert!(sigma_of(5.0) >= 1.0 && sigma_of(1e5) < 0.01, "{} {}", sigma_of(5.0), sigma_of(1e5));
    }

    #[test]
    fn what_few_pieces_say_counts_as_students_t_has_it() {
        // Quantiles of 0.99865, which three standard deviations have (Abramowitz and Stegun, table 26.10, interpolated).
        for (freedom, t, within) in [(5.0, 5.51, 0.1), (10.0, 3.96, 0.05), (1000.0, 3.0, 0.01)] {
            assert!((SIGMAS * of_few(freedom).sqrt() / t - 1.0).abs() < within, "{freedom}");
        }
    }
}
