//! Rejection of flow that no motion of the camera explains.
//!
//! The rotation between the two frames is predicted from the gyroscope, so two points fix the direction of
//! translation (Troiani et al. 2014): with unit bearings `b` (previous) and `c` (current, turned into the
//! previous frame), `n = b x c` is orthogonal to `t`, and `t ~ n_i x n_j`. A bearing `c` lies off the
//! epipolar plane through `b` and `t` by the angle `e = t . n / |t x b|`. Since the gyroscope's bias may be
//! unknown, the best direction is refined together with a small rotation `dtheta` (five unknowns, a prior on
//! `dtheta`) while the gate closes. At rest every residual is below the gate, whatever `t` is.

use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};
use plumbline_config::{Portable, Random};

/// Random pairs tried: with half of the points wrong, all fail with a probability of 1e-5.
const HYPOTHESES: usize = 40;
/// Gate of the pairs, px: a gyroscope bias of 0.1 rad/s moves pixels by 2.3 px between 20 Hz frames.
const LOOSE_PX: f64 = 4.0;
/// Gates of the refinement, px, one a round.
const ROUND_PX: [f64; 6] = [4.0, 3.0, 2.0, 1.5, 1.0, 1.0];
/// Final gate, px: three standard deviations of a track.
const FINAL_PX: f64 = 1.5;
/// Standard deviation of the predicted rotation, rad: 0.1 rad/s of bias over 50 ms.
const ROTATION_SIGMA_RAD: f64 = 0.005;
/// Standard deviation of a point, px, against which the prior is weighed.
const POINT_SIGMA_PX: f64 = 0.5;
/// Keeps the residual finite where a point lies on the epipole, rad.
const EPIPOLE_RAD: f64 = 0.02;
/// With fewer points nothing can be told.
const MIN_POINTS: usize = 10;
/// Below this share even the best model says nothing, as where the rotation is not known, and no point is rejected.
const HOPELESS_SHARE: f64 = 0.3;

/// A point in two frames: unit bearings, the current one in its own frame.
#[derive(Clone, Copy, Debug)]
struct Pair {
    previous: Vector3<f64>,
    current: Vector3<f64>,
    /// Normal of the plane of the two, once the current one is turned.
    normal: Vector3<f64>,
}

/// A motion: small rotation to be applied to the turned current bearings, and direction of translation.
#[derive(Clone, Copy, Debug)]
struct Motion {
    rotation: UnitQuaternion<f64>,
    direction: Vector3<f64>,
}

impl Motion {
    /// Angle of a point off its epipolar plane.
    fn residual(&self, pair: &Pair) -> f64 {
        let current = self.rotation * pair.current;
        self.direction.dot(&pair.previous.cross(&current)) / plane_norm(&self.direction, &pair.previous)
    }
}

fn plane_norm(direction: &Vector3<f64>, bearing: &Vector3<f64>) -> f64 {
    (direction.cross(bearing).norm_squared() + EPIPOLE_RAD * EPIPOLE_RAD).sqrt()
}

/// Finds the points that contradict the motion of the camera. Preallocated.
#[derive(Clone, Debug)]
pub struct OutlierFilter {
    pairs: Vec<Pair>,
    keep: Vec<bool>,
}

impl OutlierFilter {
    /// A filter for at most `capacity` points.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        Self { pairs: Vec::with_capacity(capacity), keep: Vec::with_capacity(capacity) }
    }

    /// Begins a new frame pair.
    pub fn clear(&mut self) {
        self.pairs.clear();
    }

    /// Adds a point by its normalized coordinates in the previous and the current frame.
    pub fn add(&mut self, xy_previous: &Vector2<f64>, xy_current: &Vector2<f64>) {
        let bearing = |xy: &Vector2<f64>| Vector3::new(xy.x, xy.y, 1.0).normalize();
        let [previous, current] = [xy_previous, xy_current].map(bearing);
        self.pairs.push(Pair { previous, current, normal: Vector3::zeros() });
    }

    /// For each point, in the order of adding, whether to keep it. `rot_prev_cur` takes current to previous
    /// camera coordinates; `focal_px` is the mean focal length, px; `seed` makes the choice of samples.
    pub fn filter(&mut self, rot_prev_cur: &UnitQuaternion<f64>, focal_px: f64, seed: u64) -> &[bool] {
        self.keep.clear();
        self.keep.resize(self.pairs.len(), true);
        if self.pairs.len() < MIN_POINTS {
            return &self.keep;
        }
        for pair in &mut self.pairs {
            pair.current = rot_prev_cur * pair.current;
            pair.normal = pair.previous.cross(&pair.current);
        }
        let mut random = Random::new(seed);
        let best = self.search(focal_px, &mut random);
        if self.count(&best, FINAL_PX / focal_px) as f64 >= HOPELESS_SHARE * self.pairs.len() as f64 {
            self.keep_what_fits(&best, focal_px);
        }
        &self.keep
    }

    fn keep_what_fits(&mut self, motion: &Motion, focal_px: f64) {
        for (keep, pair) in self.keep.iter_mut().zip(&self.pairs) {
            *keep = motion.residual(pair).abs() <= FINAL_PX / focal_px;
        }
    }

    fn count(&self, motion: &Motion, gate: f64) -> usize {
        self.pairs.iter().filter(|p| motion.residual(p).abs() <= gate).count()
    }

    /// Sum of squared residuals of a motion without another rotation, each cut off at the gate (MSAC, Torr and Zisserman 2000), as far as
    /// it is less than `most`.
    fn cost(&self, direction: &Vector3<f64>, gate: f64, most: f64) -> Option<f64> {
        let residual = |p: &Pair| direction.dot(&p.normal) / plane_norm(direction, &p.previous);
        self.pairs.chunks(8).try_fold(0.0, |sum, pairs| {
            let sum = pairs.iter().fold(sum, |sum, p| sum + residual(p).squared().at_most(gate * gate));
            (sum < most).then_some(sum)
        })
    }

    /// The best of many pairs of points, refined.
    fn search(&self, focal_px: f64, random: &mut Random) -> Motion {
        let mut best =
            (Motion { rotation: UnitQuaternion::identity(), direction: Vector3::z() }, f64::INFINITY);
        for _ in 0..HYPOTHESES {
            let [i, j] = [draw(random, self.pairs.len()), draw(random, self.pairs.len())];
            let Some(direction) = self.direction_of(i, j) else { continue };
            if let Some(cost) = self.cost(&direction, LOOSE_PX / focal_px, best.1) {
                best = (Motion { direction, ..best.0 }, cost);
            }
        }
        self.refine_all(best.0, focal_px)
    }

    fn refine_all(&self, start: Motion, focal_px: f64) -> Motion {
        // Weight of the prior on the rotation, in units of the squared angle of a point.
        let prior = (POINT_SIGMA_PX / focal_px / ROTATION_SIGMA_RAD).squared();
        ROUND_PX.iter().fold(start, |motion, gate_px| {
            refine(motion, self.pairs.iter(), gate_px / focal_px, prior).unwrap_or(motion)
        })
    }

    /// The direction of translation that two points agree on.
    fn direction_of(&self, i: usize, j: usize) -> Option<Vector3<f64>> {
        self.pairs[i].normal.cross(&self.pairs[j].normal).try_normalize(1e-12)
    }
}

/// One Gauss-Newton step on the points within the gate: unknowns are `dtheta` and two tangents of `t`.
fn refine<'a>(
    motion: Motion,
    points: impl Iterator<Item = &'a Pair>,
    gate: f64,
    rotation_prior: f64,
) -> Option<Motion> {
    let (u, v) = tangents(&motion.direction);
    let mut hessian = SMatrix::<f64, 5, 5>::zeros();
    let mut gradient = SVector::<f64, 5>::zeros();
    for pair in points {
        let current = motion.rotation * pair.current;
        let norm = plane_norm(&motion.direction, &pair.previous);
        let plane = motion.direction.cross(&pair.previous);
        let normal = pair.previous.cross(&current);
        let residual = motion.direction.dot(&normal) / norm;
        if residual.abs() > gate {
            continue;
        }
        // d (t . (b x Exp(dtheta) c)) = dtheta . (c x (t x b)) + dt . (b x c).
        let by_rotation = current.cross(&plane) / norm;
        let row = SVector::<f64, 5>::new(
            by_rotation.x,
            by_rotation.y,
            by_rotation.z,
            u.dot(&normal) / norm,
            v.dot(&normal) / norm,
        );
        hessian += row * row.transpose();
        gradient += row * residual;
    }
    let angle = motion.rotation.scaled_axis();
    for i in 0..3 {
        hessian[(i, i)] += rotation_prior;
        gradient[i] += rotation_prior * angle[i];
    }
    for i in 3..5 {
        // At rest nothing speaks of the direction: it stays.
        hessian[(i, i)] += rotation_prior * 1e-3;
    }
    let step = -hessian.cholesky()?.solve(&gradient);
    let rotation = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned()) * motion.rotation;
    let direction = (motion.direction + u * step[3] + v * step[4]).try_normalize(1e-12)?;
    Some(Motion { rotation, direction })
}

/// Two unit vectors orthogonal to `direction` and to each other.
fn tangents(direction: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let axis = Matrix3::<f64>::identity().column(direction.iamin()).into_owned();
    let u = direction.cross(&axis).normalize();
    (u, direction.cross(&u))
}

/// An index below `limit`, the same on every run.
fn draw(random: &mut Random, limit: usize) -> usize {
    (random.next_bits() % limit.max(1) as u64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOCAL: f64 = 458.0;

    /// A scene of 150 points seen before and after a motion, a share of them moved elsewhere.
    struct Scene {
        motion: (UnitQuaternion<f64>, Vector3<f64>),
        wrong: f64,
        noise_px: f64,
        /// Error of the rotation that the filter is told.
        gyro_error: Vector3<f64>,
    }

    /// Shares of the good and of the bad points that were kept.
    fn run(scene: &Scene, seed: u64) -> (f64, f64) {
        let mut random = Random::new(seed);
        let mut filter = OutlierFilter::new(150);
        let mut is_wrong = Vec::new();
        filter.clear();
        for _ in 0..150 {
            let depth = random.range(1.0, 15.0);
            let p = Vector3::new(random.range(-0.8, 0.8), random.range(-0.5, 0.5), 1.0) * depth;
            let q = scene.motion.0.inverse() * (p - scene.motion.1);
            let noise = |random: &mut Random| {
                Vector2::new(random.gaussian(), random.gaussian()) * scene.noise_px / FOCAL
            };
            let mut current = q.xy() / q.z + noise(&mut random);
            let wrong = random.unit() < scene.wrong;
            if wrong {
                // Ten to forty pixels away, in any direction.
                let angle = random.range(0.0, std::f64::consts::TAU);
                current += Vector2::new(angle.cos(), angle.sin()) * random.range(10.0, 40.0) / FOCAL;
            }
            filter.add(&(p.xy() / p.z), &current);
            is_wrong.push(wrong);
        }
        let told = scene.motion.0 * UnitQuaternion::from_scaled_axis(scene.gyro_error);
        let keep = filter.filter(&told, FOCAL, seed);
        let share = |of_wrong: bool| {
            let all = is_wrong.iter().filter(|&&w| w == of_wrong).count().max(1);
            keep.iter().zip(&is_wrong).filter(|&(&k, &w)| k && w == of_wrong).count() as f64 / all as f64
        };
        (share(false), share(true))
    }

    #[test]
    fn thirty_percent_outliers_go_and_the_others_stay() {
        for seed in 0..20 {
            let motion =
                (UnitQuaternion::from_euler_angles(0.02, -0.03, 0.01), Vector3::new(0.08, 0.01, 0.05));
            let scene = Scene { motion, wrong: 0.3, noise_px: 0.3, gyro_error: Vector3::zeros() };
            let (good, bad) = run(&scene, seed);
            // An outlier along its epipolar line cannot be seen from two views: 1.5 px of 10 to 40.
            assert!(good > 0.96 && bad < 0.22, "seed {seed}: {good} {bad}");
        }
    }

    #[test]
    fn an_unknown_gyro_bias_costs_nothing() {
        for seed in 0..20 {
            let motion =
                (UnitQuaternion::from_euler_angles(0.02, -0.03, 0.01), Vector3::new(0.08, 0.01, 0.05));
            let scene =
                Scene { motion, wrong: 0.3, noise_px: 0.3, gyro_error: Vector3::new(0.004, -0.003, 0.004) };
            let (good, bad) = run(&scene, seed);
            assert!(good > 0.96 && bad < 0.22, "seed {seed}: {good} {bad}");
        }
    }

    #[test]
    fn a_rotation_that_is_off_by_degrees_is_found_again() {
        for seed in 0..20 {
            let motion = (UnitQuaternion::identity(), Vector3::new(0.1, 0.02, 0.05));
            let scene =
                Scene { motion, wrong: 0.1, noise_px: 0.3, gyro_error: Vector3::new(0.03, -0.02, 0.03) };
            let (good, _) = run(&scene, seed);
            assert!(good > 0.8, "seed {seed}: {good}");
        }
    }

    #[test]
    fn at_rest_everything_stays() {
        for seed in 0..20 {
            for gyro_error in [Vector3::zeros(), Vector3::new(-0.001, 0.001, 0.004)] {
                let motion = (UnitQuaternion::identity(), Vector3::zeros());
                let scene = Scene { motion, wrong: 0.0, noise_px: 0.15, gyro_error };
                assert_eq!(run(&scene, seed).0, 1.0, "seed {seed}");
            }
        }
    }

    #[test]
    fn few_points_are_never_judged() {
        let mut filter = OutlierFilter::new(16);
        for i in 0..5 {
            filter.add(&Vector2::new(0.1 * f64::from(i), 0.0), &Vector2::new(0.0, 0.1 * f64::from(i)));
        }
        assert!(filter.filter(&UnitQuaternion::identity(), FOCAL, 1).iter().all(|&k| k));
    }
}
