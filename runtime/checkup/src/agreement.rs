//! Time offset and rotation between camera and IMU, and the focal lengths, by the rotation that images show.
//!
//! Between two images the camera turned by `omega_c`, the mean rate in its own axes; with the configured extrinsics that is
//! `omega_b = R_bc omega_c`. The gyroscope's mean over the same time, moved by `tau`, is `g(tau)`. With its bias `b` and a
//! small rotation `phi` of the extrinsics:
//!
//! `R_bc diag(1 + k, 1 + k, 1) omega_c = g(tau) - b + phi x g(tau) + n`
//!
//! With focal lengths that are too long by the share `k`, images show less turning by it, but about the optical axis.
//! `tau` is sought on a grid, then all eight unknowns by Gauss-Newton with the Cauchy kernel. Their covariance says whether the
//! motion was enough to know them.

use crate::statistics::median;
use crate::verdict::{Fitness, Measure};
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};
use plumbline_config::{Config, ImuSample, Timestamp};
use plumbline_estimator::geometry::skew;

/// Fewest rotations that are judged.
const MIN_TURNS: usize = 60;
/// Reach and step of the grid, s.
pub(crate) const REACH_S: f64 = 0.1;
const STEP_S: f64 = 0.002;
/// Steps after the grid.
const STEPS: usize = 10;
/// Known to this standard deviation they are judged: s, rad.
const KNOWN: (f64, f64) = (0.002, 0.006);
/// What is off by this many standard deviations is judged, however large these are.
const SIGNIFICANT: f64 = 5.0;
/// A rotation beyond its limit is minded from this many standard deviations on.
const GROSS: f64 = 3.0;
/// No mounting is off by more, rad.
const MAX_MOUNTING_RAD: f64 = 0.35;
/// Scatter of the rates about the axis of least turning from which a recording turns about all axes, rad/s.
const ALL_AXES_RAD_S: f64 = 0.1;
/// Residuals of neighbouring images are not independent: standard deviations are taken this much larger.
const INFLATED: f64 = 2.0;
/// Limits of the time offset, as multiples of its configured `sigma`: doubtful beyond the first, bad beyond the second.
/// The third is the least `sigma`, s.
const OFFSET: (f64, f64, f64) = (1.0, 2.0, 0.002);
/// Limits of the rotation, in the order of [`OFFSET`]; the third in rad.
const ROTATION: (f64, f64, f64) = (1.0, 3.0, 0.006);
/// Limits of the focal lengths' error: doubtful beyond the first, bad beyond the second. Gyroscopes have scales that are up to
/// 3 % off.
const FOCAL: (f64, f64) = (0.03, 0.06);
/// Known to this standard deviation the focal lengths are judged.
const KNOWN_FOCAL: f64 = 0.015;
/// Name of the measure of the focal lengths.
pub(crate) const FOCAL_NAME: &str = "focal length";
/// Pieces of the recording that are left out in turn: their scatter is the standard deviation of the focal lengths where that is
/// larger than what the fit says.
const PIECES: usize = 8;
/// Steps with a piece left out.
const PIECE_STEPS: usize = 4;
/// A time offset is one where images and gyroscope disagree by this factor more without it.
const EXPLAINS: f64 = 1.2;
/// Where this share of the scatter is left by the configured extrinsics, they are not those of the rig.
const UNEXPLAINED: f64 = 0.5;
/// Least scatter of the rates that is a motion, rad/s.
const MIN_SCATTER: f64 = 0.05;

/// A rotation that images showed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Stamp of the first image.
    pub from: Timestamp,
    /// Stamp of the second.
    pub to: Timestamp,
    /// Mean rate between, in the left camera's axes, rad/s.
    pub rate_c: Vector3<f64>,
    /// Mean velocity of the camera between, in its axes at the first image, m/s.
    pub velocity_c: Vector3<f64>,
}

/// The gyroscope's rate over time, integrated.
struct Gyro {
    begin: Timestamp,
    times_s: Vec<f64>,
    angles: Vec<Vector3<f64>>,
    rates: Vec<Vector3<f64>>,
}

impl Gyro {
    fn new(samples: &[ImuSample]) -> Option<Self> {
        let begin = samples.first()?.stamp;
        let (mut times_s, mut angles, mut rates) = (Vec::new(), Vec::new(), Vec::<Vector3<f64>>::new());
        let mut angle = Vector3::zeros();
        for sample in samples {
            let time_s = sample.stamp.seconds_since(begin);
            if let (Some(last_s), Some(rate)) = (times_s.last(), rates.last()) {
                let dt_s: f64 = time_s - last_s;
                if dt_s <= 0.0 {
                    continue;
                }
                angle += (rate + sample.gyro) * (0.5 * dt_s);
            }
            times_s.push(time_s);
            angles.push(angle);
            rates.push(sample.gyro);
        }
        Some(Self { begin, times_s, angles, rates })
    }

    /// Integrated angle and rate at a time; `None` outside the samples.
    fn at(&self, time_s: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let after = self.times_s.partition_point(|t| *t <= time_s);
        let k = after.checked_sub(1).filter(|_| after < self.times_s.len())?;
        let dt_s = time_s - self.times_s[k];
        let share = dt_s / (self.times_s[k + 1] - self.times_s[k]);
        let rate = self.rates[k].lerp(&self.rates[k + 1], share);
        Some((self.angles[k] + (self.rates[k] + rate) * (0.5 * dt_s), rate))
    }

    /// Mean rate during a turn moved by `tau_s`, and its derivative by that.
    fn during(&self, turn: &Turn, tau_s: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let from_s = turn.from.seconds_since(self.begin) + tau_s;
        let to_s = turn.to.seconds_since(self.begin) + tau_s;
        let ((angle_a, rate_a), (angle_b, rate_b)) = (self.at(from_s)?, self.at(to_s)?);
        let dt_s = to_s - from_s;
        Some(((angle_b - angle_a) / dt_s, (rate_b - rate_a) / dt_s))
    }
}

/// What agrees best.
#[derive(Clone, Copy, Debug)]
pub struct Agreement {
    /// `t_imu = t_camera + offset`, s, and its standard deviation.
    pub offset_s: (f64, f64),
    /// Rotation that the configured extrinsics lack, in the body's axes, rad, and the standard deviation of the worst axis.
    pub rotation_b: (Vector3<f64>, f64),
    /// Share by which the configured focal lengths are too long, and its standard deviation.
    pub focal: (f64, f64),
    /// Disagreement that is left without a change of the time offset, over that with it (all else fit in both).
    pub offset_gain: f64,
    /// What the configured extrinsics leave at the best offset, rad/s, median.
    pub residual_rad_s: f64,
    /// Scatter of the rates, rad/s.
    pub scatter_rad_s: f64,
    /// Scatter of the rates about the axis of least turning, rad/s.
    pub least_scatter_rad_s: f64,
}

type Normal = (SMatrix<f64, 8, 8>, SVector<f64, 8>, f64, f64);

struct Problem<'a> {
    turns: &'a [Turn],
    gyro: &'a Gyro,
    rot_b_c: UnitQuaternion<f64>,
}

impl Problem<'_> {
    /// Residuals `omega_b - (g - b + phi x g)` at `x = (phi, b, tau, k)` with their derivatives.
    fn residuals(&self, x: &SVector<f64, 8>) -> Vec<(Vector3<f64>, SMatrix<f64, 3, 8>)> {
        let (phi, bias) = (x.fixed_rows::<3>(0).into_owned(), x.fixed_rows::<3>(3).into_owned());
        let residual = |turn: &Turn| {
            let (rate, by_tau) = self.gyro.during(turn, x[6])?;
            let across_c = Vector3::new(turn.rate_c.x, turn.rate_c.y, 0.0);
            let r = self.rot_b_c * (turn.rate_c + across_c * x[7]) - (rate - bias + phi.cross(&rate));
            let mut jacobian = SMatrix::<f64, 3, 8>::zeros();
            jacobian.fixed_columns_mut::<3>(0).copy_from(&skew(&rate));
            jacobian.fixed_columns_mut::<3>(3).copy_from(&Matrix3::identity());
            jacobian.fixed_columns_mut::<1>(6).copy_from(&-(by_tau + phi.cross(&by_tau)));
            jacobian.fixed_columns_mut::<1>(7).copy_from(&(self.rot_b_c * across_c));
            Some((r, jacobian))
        };
        self.turns.iter().filter_map(residual).collect()
    }

    /// Bias and cost (median of the residuals' norms) for no rotation and this offset.
    fn cost(&self, tau_s: f64) -> Option<(f64, Vector3<f64>)> {
        let mut x = SVector::<f64, 8>::zeros();
        x[6] = tau_s;
        let residuals = self.residuals(&x);
        if residuals.len() < MIN_TURNS {
            return None;
        }
        let axis = |k: usize| median(&residuals.iter().map(|(r, _)| r[k]).collect::<Vec<_>>());
        let middle = Vector3::new(axis(0), axis(1), axis(2));
        let sizes: Vec<f64> = residuals.iter().map(|(r, _)| (r - middle).norm()).collect();
        Some((median(&sizes), -middle))
    }

    /// Normal equations, the scale of the residuals, and the sum of weights.
    fn linearize(&self, x: &SVector<f64, 8>) -> Normal {
        let residuals = self.residuals(x);
        let sizes: Vec<f64> = residuals.iter().map(|(r, _)| r.norm()).collect();
        let scale = (2.0 * median(&sizes)).max(1e-4);
        let mut sums: Normal = (SMatrix::zeros(), SVector::zeros(), 0.0, 0.0);
        for (r, jacobian) in &residuals {
            let weight = 1.0 / (1.0 + r.norm_squared() / (scale * scale));
            sums.0 += jacobian.transpose() * jacobian * weight;
            sums.1 += jacobian.transpose() * r * weight;
            sums.2 += weight * r.norm_squared() / 3.0;
            sums.3 += weight;
        }
        sums
    }
}

impl Problem<'_> {
    /// Solution after some steps from `x`, with the time offset of `x` where that is fixed.
    fn solved(&self, mut x: SVector<f64, 8>, steps: usize, is_offset_fixed: bool) -> Option<SVector<f64, 8>> {
        for _ in 0..steps {
            let (mut h, mut b, ..) = self.linearize(&x);
            if is_offset_fixed {
                h.fixed_rows_mut::<1>(6).fill(0.0);
                h.fixed_columns_mut::<1>(6).fill(0.0);
                (h[(6, 6)], b[6]) = (1.0, 0.0);
            }
            x -= h.cholesky()?.solve(&b);
        }
        Some(x)
    }

    /// Median of the residuals' norms.
    fn disagreement(&self, x: &SVector<f64, 8>) -> f64 {
        median(&self.residuals(x).iter().map(|(r, _)| r.norm()).collect::<Vec<_>>())
    }

    /// Standard deviation of the focal lengths' error by the scatter of solutions with a piece of the recording left out. It holds for
    /// residuals that depend on each other, which the covariance of the fit takes for independent.
    fn focal_sigma(&self, x: &SVector<f64, 8>) -> Option<f64> {
        let piece = self.turns.len().div_ceil(PIECES);
        let without = |k: usize| {
            let (from, to) = (k * piece, ((k + 1) * piece).min(self.turns.len()));
            let turns = [self.turns.get(..from)?, self.turns.get(to..)?].concat();
            Problem { turns: &turns, gyro: self.gyro, rot_b_c: self.rot_b_c }.solved(*x, PIECE_STEPS, false)
        };
        let found = (0..PIECES).map(|k| Some(without(k)?[7])).collect::<Option<Vec<f64>>>()?;
        let mean = found.iter().sum::<f64>() / PIECES as f64;
        let squares: f64 = found.iter().map(|share| (share - mean) * (share - mean)).sum();
        Some((squares * (PIECES as f64 - 1.0) / PIECES as f64).sqrt())
    }
}

/// Time offset and rotation that agree best; `None` without enough motion that images and gyroscope saw.
#[must_use]
pub fn agreement(turns: &[Turn], samples: &[ImuSample], config: &Config) -> Option<Agreement> {
    let rot_b_c = config.camera.first()?.pose_b_c().rotation;
    let gyro = Gyro::new(samples)?;
    let problem = Problem { turns, gyro: &gyro, rot_b_c };
    let (_, scatter) = crate::statistics::mean_and_spread(turns.iter().map(|turn| turn.rate_c));
    let moved = turns.len() >= MIN_TURNS && scatter >= MIN_SCATTER;
    if !moved {
        return None;
    }
    let mut best: Option<(f64, f64, Vector3<f64>)> = None;
    let steps = (REACH_S / STEP_S).round() as i32;
    for k in -steps..=steps {
        let tau_s = config.rig.time_offset_s + f64::from(k) * STEP_S;
        if let Some((cost, bias)) = problem.cost(tau_s)
            && best.is_none_or(|(least, ..)| cost < least)
        {
            best = Some((cost, tau_s, bias));
        }
    }
    let (cost, tau_s, bias) = best?;
    let mut x = SVector::<f64, 8>::zeros();
    x.fixed_rows_mut::<3>(3).copy_from(&bias);
    x[6] = tau_s;
    x = problem.solved(x, STEPS, false)?;
    let mut as_configured = x;
    as_configured[6] = config.rig.time_offset_s;
    let as_configured = problem.solved(as_configured, STEPS, true)?;
    let (h, _, squares, weights) = problem.linearize(&x);
    let variance = squares / weights.max(1.0);
    let covariance = h.cholesky()?.inverse() * (variance * INFLATED * INFLATED);
    let rotation = covariance.fixed_view::<3, 3>(0, 0).into_owned().symmetric_eigenvalues().max();
    Some(Agreement {
        offset_s: (x[6], covariance[(6, 6)].max(0.0).sqrt()),
        rotation_b: (x.fixed_rows::<3>(0).into_owned(), rotation.max(0.0).sqrt()),
        focal: (x[7], covariance[(7, 7)].max(0.0).sqrt().max(problem.focal_sigma(&x)?)),
        offset_gain: problem.disagreement(&as_configured) / problem.disagreement(&x).max(1e-6),
        residual_rad_s: cost,
        scatter_rad_s: scatter,
        least_scatter_rad_s: least_scatter(turns),
    })
}

/// Scatter of the rates about the axis of least turning, rad/s.
fn least_scatter(turns: &[Turn]) -> f64 {
    let (mean, _) = crate::statistics::mean_and_spread(turns.iter().map(|turn| turn.rate_c));
    let squares = |turn: &Turn| (turn.rate_c - mean) * (turn.rate_c - mean).transpose();
    let covariance = turns.iter().map(squares).sum::<Matrix3<f64>>() / turns.len().max(1) as f64;
    covariance.symmetric_eigenvalues().min().max(0.0).sqrt()
}

/// Judges all three.
#[must_use]
pub fn judge(turns: &[Turn], samples: &[ImuSample], config: &Config) -> Vec<Measure> {
    const NAMES: [&str; 3] = ["time offset", "camera-IMU rotation", FOCAL_NAME];
    const CURE: &str =
        "turn the vehicle by hand about all three axes for ten seconds, in front of something with texture";
    let Some(found) = agreement(turns, samples, config) else {
        let seen = turns.len();
        let why = match seen < MIN_TURNS {
            true => {
                format!("images show the rotation between {seen} pairs of frames, and {MIN_TURNS} are needed")
            }
            false => {
                format!("the vehicle hardly turned in the {seen} pairs of frames whose rotation images show")
            }
        };
        return NAMES.map(|name| Measure::missing(name, &why, CURE)).to_vec();
    };
    // Of axes that are another's, or of images that show another motion, nothing is explained.
    let is_beyond = (found.offset_s.0 - config.rig.time_offset_s).abs() > REACH_S + STEP_S;
    if found.residual_rad_s > UNEXPLAINED * found.scatter_rad_s || is_beyond {
        let value = format!(
            "images and gyroscope turn differently: {:.3} of {:.3} rad/s remain",
            found.residual_rad_s, found.scatter_rad_s
        );
        let cure = "look at `camera.pose_b_c` (axes, or its inverse), at the order of the cameras, at units of the gyroscope, at lens \
                    model and focal lengths, and at stamps that are late by more than 0.1 s";
        let figures = [("residual_rad_s", found.residual_rad_s), ("scatter_rad_s", found.scatter_rad_s)];
        return NAMES.map(|name| Measure::new(name, Fitness::NotFit, value.clone(), cure, &figures)).to_vec();
    }
    let (mut offset, rotation, mut focal) = (
        offset(NAMES[0], &found, config, CURE),
        rotation(NAMES[1], &found, config, CURE),
        focal(NAMES[2], &found, CURE),
    );
    // Delay, rotation and focal length are traded against each other: none is advised while another is not known.
    if offset.verdict > Fitness::Good && (focal.verdict != Fitness::Good || found.offset_gain < EXPLAINS) {
        let cure = "look at focal lengths and lens model first, then measure again: lenses that are off look like a delay";
        offset = Measure { verdict: Fitness::Uncertain, cure: cure.to_owned(), ..offset };
    }
    let is_rotation_known = found.rotation_b.1 <= KNOWN.1 && rotation.verdict != Fitness::NotFit;
    if focal.verdict == Fitness::Good && (!is_rotation_known || offset.verdict == Fitness::Uncertain) {
        let cure =
            format!("{CURE}: while time offset or rotation is not known, the focal length is not either");
        focal = Measure { verdict: Fitness::Uncertain, cure, ..focal };
    }
    vec![offset, rotation, focal]
}

fn focal(name: &'static str, found: &Agreement, more: &str) -> Measure {
    let (share, sigma) = found.focal;
    let (size, direction) = (100.0 * share.abs(), if share > 0.0 { "less" } else { "more" });
    let value =
        format!("images turn by {size:.1} % {direction} than the gyroscope, within {:.1}", 100.0 * sigma);
    let figures = [("too_long_percent", 100.0 * share), ("sigma_percent", 100.0 * sigma)];
    let noise = 2.0 * sigma;
    let verdict = Fitness::within(share.abs(), FOCAL.0 + noise, FOCAL.1 + noise);
    let is_known = sigma <= KNOWN_FOCAL || verdict > Fitness::Good && share.abs() > SIGNIFICANT * sigma;
    if !is_known {
        return Measure::new(name, Fitness::Uncertain, value, more, &figures);
    }
    let length = if share > 0.0 { "long" } else { "short" };
    let cure = format!(
        "calibrate the cameras again (`plumbline calibrate rig`): the focal lengths of `camera` are {size:.0} % too {length}, or its lens \
         model is another's; a gyroscope's scale that is so far off does the same"
    );
    Measure::new(name, verdict, value, cure, &figures)
}

fn offset(name: &'static str, found: &Agreement, config: &Config, more: &str) -> Measure {
    let (offset_s, sigma_s) = found.offset_s;
    let off_s = (offset_s - config.rig.time_offset_s).abs();
    let prior_s = config.rig.time_offset_sigma_s.max(OFFSET.2);
    let noise_s = 2.0 * sigma_s;
    let value = format!(
        "{:.1} ms within {:.1}, where `rig.time_offset_s` says {:.1} ms",
        1e3 * offset_s,
        1e3 * sigma_s,
        1e3 * config.rig.time_offset_s
    );
    let figures = [("offset_ms", 1e3 * offset_s), ("sigma_ms", 1e3 * sigma_s), ("off_ms", 1e3 * off_s)];
    let verdict = Fitness::within(off_s, OFFSET.0 * prior_s + noise_s, OFFSET.1 * prior_s + noise_s);
    let is_known = sigma_s <= KNOWN.0 || verdict > Fitness::Good && off_s > SIGNIFICANT * sigma_s;
    if !is_known {
        return Measure::new(name, Fitness::Uncertain, value, more, &figures);
    }
    if verdict > Fitness::Good && is_turned(found, config) {
        let cure = "correct the camera-IMU rotation first: while the vehicle turns about one axis, turned axes look like a delay";
        return Measure::new(name, Fitness::Uncertain, value, cure, &figures);
    }
    let cure = format!("set `rig.time_offset_s = {offset_s:.4}`, or find out which stamp is of the arrival");
    Measure::new(name, verdict, value, cure, &figures)
}

/// Verdict on the rotation by its size alone.
fn size_of_rotation(found: &Agreement, config: &Config) -> Fitness {
    let (phi, sigma) = found.rotation_b;
    let prior = config.rig.camera_imu_rotation_sigma_rad.max(ROTATION.2);
    Fitness::within(phi.norm(), ROTATION.0 * prior + sigma, ROTATION.1 * prior + sigma)
}

/// True if camera and gyroscope turn about different axes by an angle that is not known well.
fn is_turned(found: &Agreement, config: &Config) -> bool {
    let (phi, sigma) = found.rotation_b;
    sigma > KNOWN.1 && phi.norm() > GROSS * sigma && size_of_rotation(found, config) > Fitness::Good
}

fn rotation(name: &'static str, found: &Agreement, config: &Config, more: &str) -> Measure {
    let (phi, sigma) = found.rotation_b;
    let angle = phi.norm();
    let value = format!(
        "off by {:.2} degrees within {:.2} (about the body's axes {:.2} {:.2} {:.2})",
        angle.to_degrees(),
        sigma.to_degrees(),
        phi.x.to_degrees(),
        phi.y.to_degrees(),
        phi.z.to_degrees()
    );
    let figures = [("off_deg", angle.to_degrees()), ("sigma_deg", sigma.to_degrees())];
    let verdict = size_of_rotation(found, config);
    if verdict == Fitness::NotFit && angle > MAX_MOUNTING_RAD && angle > GROSS * sigma {
        let cure = "this is more than any mounting error: look at columns and signs of the gyroscope, and at the axes \
                    of `camera.pose_b_c`";
        return Measure::new(name, verdict, value, cure, &figures);
    }
    // What is off by far more than it is uncertain needs no better measurement.
    let is_known = sigma <= KNOWN.1 || verdict > Fitness::Good && angle > SIGNIFICANT * sigma;
    if !is_known && found.least_scatter_rad_s > ALL_AXES_RAD_S {
        let value = format!("{value}, though the vehicle turned about all axes");
        let cure = "more turning will not help: look at principal points (`camera.centre_px`), focal lengths and lens model, and \
                    calibrate again";
        let verdict = if verdict == Fitness::Good { Fitness::Uncertain } else { Fitness::Mind };
        return Measure::new(name, verdict, value, cure, &figures);
    }
    let focal_px = config.camera.first().map_or(0.0, |camera| camera.focal_px[0]);
    let cure = format!(
        "calibrate camera against IMU again (`plumbline calibrate rig`): `camera.pose_b_c` is turned, or the principal points \
         (`camera.centre_px`) are off by {:.0} px",
        focal_px * angle.tan()
    );
    if !is_known {
        let is_turned = is_turned(found, config);
        let (verdict, cure) =
            if is_turned { (Fitness::Mind, cure.as_str()) } else { (Fitness::Uncertain, more) };
        return Measure::new(name, verdict, value, cure, &figures);
    }
    Measure::new(name, verdict, value, cure, &figures)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Verdict and words for a rotation that is off by so much within this standard deviation, degrees.
    fn judged(off_deg: f64, sigma_deg: f64, least_scatter_rad_s: f64) -> (Fitness, String) {
        let found = Agreement {
            offset_s: (0.0, 0.001),
            rotation_b: (Vector3::new(off_deg.to_radians(), 0.0, 0.0), sigma_deg.to_radians()),
            focal: (0.0, 0.001),
            offset_gain: 1.0,
            residual_rad_s: 0.05,
            scatter_rad_s: 0.5,
            least_scatter_rad_s,
        };
        let measure = rotation("camera-IMU rotation", &found, &Config::preset("sim").unwrap(), "turn more");
        (measure.verdict, measure.cure)
    }

    /// Turns about all axes as a camera shows them whose configured focal lengths are too long by a share; a gyroscope with this scale.
    fn seen(too_long: f64, gyro_scale: f64) -> (Vec<Turn>, Vec<ImuSample>, Config) {
        let config = Config::preset("sim").unwrap().into_inner();
        let rot_c_b = config.camera[0].pose_b_c().rotation.inverse();
        let rate_b = |t_s: f64| Vector3::new((1.3 * t_s).sin(), (1.7 * t_s).cos(), 0.6 * (0.9 * t_s).sin());
        let at = |t_s: f64| Timestamp::from_nanos((t_s * 1e9) as i64);
        let sample = |k: i32| {
            let t_s = f64::from(k) / 200.0;
            ImuSample { stamp: at(t_s), gyro: rate_b(t_s) * gyro_scale, accel: Vector3::zeros() }
        };
        let turn = |k: i32| {
            let t_s = 0.5 + f64::from(k) / 20.0;
            let mut rate_c = rot_c_b * rate_b(t_s + 0.025);
            rate_c.x /= 1.0 + too_long;
            rate_c.y /= 1.0 + too_long;
            Turn { from: at(t_s), to: at(t_s + 0.05), rate_c, velocity_c: Vector3::zeros() }
        };
        ((0..160).map(turn).collect(), (0..2_000).map(sample).collect(), config)
    }

    #[test]
    fn focal_lengths_that_are_off_are_told_with_their_size() {
        let verdicts = |too_long: f64| {
            let (turns, samples, config) = seen(too_long, 1.0);
            judge(&turns, &samples, &config)
        };
        for (too_long, verdict, words) in [
            (0.0, Fitness::Good, ""),
            (0.01, Fitness::Good, ""),
            (0.05, Fitness::Mind, "5 % too long"),
            (0.1, Fitness::NotFit, "10 % too long"),
            (-0.1, Fitness::NotFit, "10 % too short"),
        ] {
            let measures = verdicts(too_long);
            let focal = measures.iter().find(|measure| measure.name == "focal length").unwrap();
            assert!(focal.verdict == verdict && focal.cure.contains(words), "{too_long}: {measures:?}");
            let others = measures.iter().filter(|measure| measure.name != "focal length");
            assert!(others.clone().all(|measure| measure.verdict == Fitness::Good), "{measures:?}");
        }
        let (turns, samples, config) = seen(0.0, 1.08);
        let measures = judge(&turns, &samples, &config);
        assert!(
            measures[2].verdict > Fitness::Good && measures[2].cure.contains("gyroscope's scale"),
            "{measures:?}"
        );
    }

    #[test]
    fn a_rotation_beyond_any_mounting_error_is_not_fit_however_uncertain() {
        let (verdict, cure) = judged(30.9, 6.9, 0.05);
        assert!(verdict == Fitness::NotFit && cure.contains("columns and signs of the gyroscope"), "{cure}");
        assert_eq!(judged(30.9, 15.0, 0.05).0, Fitness::Uncertain);
    }

    #[test]
    fn a_rotation_that_turning_about_all_axes_leaves_uncertain_points_at_the_lens() {
        let (verdict, cure) = judged(8.41, 2.86, 0.3);
        assert!(
            verdict == Fitness::Mind
                && cure.contains("focal lengths and lens model")
                && cure.contains("centre_px"),
            "{cure}"
        );
        assert_eq!(judged(8.41, 2.86, 0.05), (Fitness::Uncertain, "turn more".to_owned()));
    }
}
