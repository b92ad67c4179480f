//! A piece of a recording, a second or two: states at its keyframes, points, and its normal equations.
//!
//! Minimized is the sum of the squared residuals of pixels (Cauchy kernel) and of the inertial samples between keyframes, over the
//! states and the calibration. Points are eliminated first, then the states: what is left is the quadratic of the calibration that
//! this piece holds, `cost(x) = cost + 2 g'x + x'S x`.

use super::integral::{Link, Reading, Sensors, reading_at};
use super::rig::{BIASES, CALIBRATION, Key, OF_KEY, OF_VIEWS, Point, Rig, Sight, Vector};
use nalgebra::{
    Cholesky, DMatrix, DVector, Dyn, Isometry3, Matrix3, Matrix4, SMatrix, SVector, Translation3, Vector2,
    Vector3,
};
use plumbline_estimator::geometry::{exp_so3, rotation_between};

/// Unknowns of the biases of a piece.
const OF_BIASES: usize = 6;
/// Scale of the Cauchy kernel, standard deviations of a pixel.
const KERNEL: f64 = 3.0;
/// Information that holds the frame of a piece: place and heading of its first keyframe.
const HELD: f64 = 1e10;
/// Information on what nothing else determines, small against that of a single pixel.
const FAINT: f64 = 1e-3;
/// Information on the step of an inverse distance for each unit of damping, m²: before the camera has moved, nothing else holds it.
const OF_DEPTH: f64 = 100.0;
/// Steps of the first poses by points that are known, and the widest kernel, px.
const POSE_STEPS: usize = 10;
const WIDE_PX: f64 = 64.0;
/// Fewest points of a pose, and of a piece.
const MIN_POINTS: usize = 10;
/// Inverse distance of a point that one camera has not seen move, 1/m.
const UNKNOWN_INVERSE_M: f64 = 0.2;

/// Pixel of a point at a keyframe of the piece.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    pub(super) key: usize,
    pub(super) camera: usize,
    pub(super) px: Vector2<f64>,
}

/// Standard deviations of the residuals.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Noise {
    pub(crate) px: f64,
    /// Densities of gyroscope and accelerometer.
    pub(crate) gyro: f64,
    pub(crate) accel: f64,
    /// Biases of a piece against those of the recording.
    pub(crate) biases: [f64; 2],
}

impl Noise {
    /// True if no part of it fell by more than `share`.
    pub(super) fn has_settled_from(&self, before: &Self, share: f64) -> bool {
        let parts = |n: &Self| [n.px, n.gyro, n.accel, n.biases[0], n.biases[1]];
        parts(self).iter().zip(parts(before)).all(|(now, before)| *now >= before * (1.0 - share))
    }
}

#[derive(Clone, Debug)]
pub(super) struct Piece {
    pub(super) keys: Vec<Key>,
    points: Vec<(Point, Vec<View>)>,
    pub(super) biases: SVector<f64, OF_BIASES>,
}

/// Residuals of a piece by their kind, without weights.
#[derive(Default)]
pub(super) struct Residuals {
    pub(super) px: Vec<f64>,
    pub(super) gyro: Vec<f64>,
    pub(super) accel: Vec<f64>,
}

/// Whitened rows of points with their right sides, and the roots that whiten them.
type PointRows = (DMatrix<f64>, DVector<f64>, Vec<Matrix3<f64>>);

/// Normal equations of a piece, reduced to the calibration.
pub(super) struct Normal {
    pub(super) information: SMatrix<f64, CALIBRATION, CALIBRATION>,
    pub(super) gradient: Vector,
    pub(super) residuals: Residuals,
    /// Step of the states without, and by, a step of the calibration.
    states: (DVector<f64>, DMatrix<f64>),
    /// Whitened rows of the points.
    points: DMatrix<f64>,
    right: DVector<f64>,
    roots: Vec<Matrix3<f64>>,
}

impl Piece {
    /// First guess of a piece by its images, with the attitude by gravity; `None` where they do not hold together.
    pub(super) fn new(
        rig: &Rig,
        readings: &[Reading],
        mut keys: Vec<Key>,
        tracks: Vec<Vec<View>>,
        is_pair: bool,
    ) -> Option<Self> {
        let sensors = Sensors::of(rig, &SVector::zeros());
        let (begin_s, end_s) = (rig.imu_time_s(keys.first()?), rig.imu_time_s(keys.last()?));
        let middle_s = 0.5 * (keys.first()?.t_s + keys.last()?.t_s);
        keys.iter_mut().for_each(|key| key.within_s = key.t_s - middle_s);
        let within =
            readings.partition_point(|r| r.t_s < begin_s)..readings.partition_point(|r| r.t_s < end_s);
        let force: Vector3<f64> = readings.get(within)?.iter().take(100).map(|r| sensors.force(r)).sum();
        let level = rotation_between(&force.try_normalize(1e-6)?, &Vector3::z());
        keys[0].pose_w_b = Isometry3::from_parts(Translation3::identity(), level);
        for k in 1..keys.len() {
            let [from_s, to_s] = [k - 1, k].map(|k| rig.imu_time_s(&keys[k]));
            let middle = reading_at(readings, 0.5 * (from_s + to_s))?;
            let turn = exp_so3(&(sensors.rate(&middle) * (keys[k].t_s - keys[k - 1].t_s)));
            keys[k].pose_w_b = keys[k - 1].pose_w_b;
            keys[k].pose_w_b.rotation *= turn;
        }
        let points =
            tracks.into_iter().map(|views| (Point { direction: Vector3::z(), inverse_m: 0.0 }, views));
        let mut piece = Self { keys, points: points.collect(), biases: SVector::zeros() };
        if is_pair {
            piece.find_poses(rig)?;
        }
        let keys = &piece.keys;
        piece.points.retain_mut(|(point, views)| {
            let found = triangulated(rig, keys, views.iter(), is_pair);
            found.is_some_and(|found| {
                *point = found;
                true
            })
        });
        for k in 0..piece.keys.len() {
            let (a, b) = (&piece.keys[k.saturating_sub(1)], &piece.keys[(k + 1).min(piece.keys.len() - 1)]);
            let moved = b.pose_w_b.translation.vector - a.pose_w_b.translation.vector;
            piece.keys[k].v_w = moved / (b.t_s - a.t_s);
        }
        (piece.points.len() >= MIN_POINTS).then_some(piece)
    }

    /// Poses one after another, by points that earlier keyframes have placed.
    fn find_poses(&mut self, rig: &Rig) -> Option<()> {
        let mut step = Isometry3::identity();
        for k in 1..self.keys.len() {
            let placed: Vec<(Point, View)> = self
                .points
                .iter()
                .flat_map(|(_, views)| {
                    let known = views.iter().filter(|view| view.key < k);
                    let point = triangulated(rig, &self.keys, known, true);
                    let now = views.iter().filter(move |view| view.key == k);
                    now.filter_map(move |view| Some((point.clone()?, *view)))
                })
                .collect();
            let before = self.keys[k - 1].pose_w_b;
            self.keys[k].pose_w_b = before * step;
            if placed.len() < MIN_POINTS {
                return None;
            }
            for round in 0..POSE_STEPS {
                let kernel_px = (WIDE_PX * 0.5_f64.powi(round as i32)).max(2.0);
                let (mut h, mut g) = (SMatrix::<f64, 6, 6>::identity() * FAINT, SVector::<f64, 6>::zeros());
                for (point, view) in &placed {
                    let Some(sight) = rig.sight(&self.keys[k], point, view.camera, &view.px) else {
                        continue;
                    };
                    let weight = 1.0 / (1.0 + (sight.residual_px / kernel_px).norm_squared());
                    let by = sight.by.fixed_columns::<6>(0);
                    h += by.transpose() * by * weight;
                    g += by.transpose() * sight.residual_px * weight;
                }
                self.keys[k] = self.keys[k].moved(&-h.cholesky()?.solve(&g).fixed_resize::<OF_KEY, 1>(0.0));
            }
            step = before.inverse() * self.keys[k].pose_w_b;
        }
        Some(())
    }

    fn states(&self) -> usize {
        OF_KEY * self.keys.len() + OF_BIASES
    }

    /// Normal equations at the present states; `damping` is added to the diagonal of these, as a share of it.
    pub(super) fn normal(
        &self,
        rig: &Rig,
        readings: &[Reading],
        gravity_w: &Vector3<f64>,
        noise: &Noise,
        damping: f64,
    ) -> Option<Normal> {
        let (states, all) = (self.states(), self.states() + CALIBRATION);
        let mut h = DMatrix::<f64>::zeros(all, all);
        let mut g = DVector::<f64>::zeros(all);
        let mut residuals = Residuals::default();
        self.add_links(rig, readings, gravity_w, noise, (&mut h, &mut g), &mut residuals);
        let (points, right, roots) =
            self.add_views(rig, (noise, damping), (&mut h, &mut g), &mut residuals)?;
        h -= points.transpose() * &points;
        g -= points.transpose() * &right;
        self.add_priors(noise, (&mut h, &mut g));
        for k in 0..states {
            h[(k, k)] += damping * h[(k, k)].max(0.0) + FAINT;
        }
        let own: Cholesky<f64, Dyn> = h.view((0, 0), (states, states)).into_owned().cholesky()?;
        let cross = h.view((0, states), (states, CALIBRATION)).into_owned();
        let (alone, by_rig) = (own.solve(&g.rows(0, states).into_owned()), own.solve(&cross));
        let information = h.view((states, states), (CALIBRATION, CALIBRATION)) - cross.transpose() * &by_rig;
        let gradient = g.rows(states, CALIBRATION) - cross.transpose() * &alone;
        Some(Normal {
            information: information.fixed_view::<CALIBRATION, CALIBRATION>(0, 0).into_owned(),
            gradient: gradient.fixed_rows::<CALIBRATION>(0).into_owned(),
            residuals,
            states: (-alone, -by_rig),
            points,
            right,
            roots,
        })
    }

    fn add_links(
        &self,
        rig: &Rig,
        readings: &[Reading],
        gravity_w: &Vector3<f64>,
        noise: &Noise,
        (h, g): (&mut DMatrix<f64>, &mut DVector<f64>),
        residuals: &mut Residuals,
    ) {
        let sensors = Sensors::of(rig, &self.biases);
        let states = self.states();
        for (k, keys) in self.keys.windows(2).enumerate() {
            let pair = [&keys[0], &keys[1]];
            let Some(link) = Link::new(rig, &sensors, readings, pair, gravity_w) else { continue };
            let root_s = link.dt_s.sqrt();
            residuals.gyro.extend((0..3).map(|i| link.residual[i].abs() / root_s));
            residuals.accel.extend((3..6).map(|i| link.residual[i].abs() / root_s));
            let weight = link_weight(link.dt_s, noise);
            let biases = link.by_rig.fixed_columns::<OF_BIASES>(BIASES - OF_VIEWS).into_owned();
            let mut by = SMatrix::<f64, 9, { 2 * OF_KEY + OF_BIASES + CALIBRATION - OF_VIEWS }>::zeros();
            by.fixed_columns_mut::<9>(0).copy_from(&link.by_keys[0]);
            by.fixed_columns_mut::<9>(9).copy_from(&link.by_keys[1]);
            by.fixed_columns_mut::<6>(18).copy_from(&biases);
            by.fixed_columns_mut::<{ CALIBRATION - OF_VIEWS }>(24).copy_from(&link.by_rig);
            // Where these columns lie among all unknowns.
            let at = |column: usize| match column {
                0..18 => OF_KEY * k + column,
                18..24 => states - OF_BIASES + column - 18,
                _ => states + OF_VIEWS + column - 24,
            };
            add(h, g, at, &by, &(by.transpose() * weight), &link.residual);
        }
    }

    /// Adds what is seen; returns the whitened rows of the points, which are still to be subtracted.
    fn add_views(
        &self,
        rig: &Rig,
        (noise, damping): (&Noise, f64),
        (h, g): (&mut DMatrix<f64>, &mut DVector<f64>),
        residuals: &mut Residuals,
    ) -> Option<PointRows> {
        let states = self.states();
        let mut rows = DMatrix::<f64>::zeros(3 * self.points.len(), h.ncols());
        let mut right = DVector::<f64>::zeros(3 * self.points.len());
        let mut roots = Vec::with_capacity(self.points.len());
        for (row, (point, views)) in self.points.iter().enumerate() {
            let mut own = (
                Matrix3::from_diagonal(&Vector3::new(FAINT, FAINT, FAINT + OF_DEPTH * damping)),
                Vector3::zeros(),
            );
            let mut across = DMatrix::<f64>::zeros(3, h.ncols());
            for view in views {
                let key = &self.keys[view.key];
                let Some(sight) = rig.sight(key, point, view.camera, &view.px) else { continue };
                residuals.px.push(sight.residual_px.norm());
                let weight = weight_of(&sight, noise);
                let by_point = sight.by_point.transpose() * weight;
                own.0 += by_point * sight.by_point;
                own.1 += by_point * sight.residual_px;
                let at = |column: usize| match column {
                    0..OF_KEY => OF_KEY * view.key + column,
                    _ => states + column - OF_KEY,
                };
                for (k, column) in (by_point * sight.by).column_iter().enumerate() {
                    let mut sum = across.fixed_columns_mut::<1>(at(k));
                    sum += column;
                }
                add(h, g, at, &sight.by, &(sight.by.transpose() * weight), &sight.residual_px);
            }
            let root = own.0.cholesky()?.l().try_inverse()?;
            rows.rows_mut(3 * row, 3).copy_from(&(root * &across));
            right.fixed_rows_mut::<3>(3 * row).copy_from(&(root * own.1));
            roots.push(root);
        }
        Some((rows, right, roots))
    }

    fn add_priors(&self, noise: &Noise, (h, g): (&mut DMatrix<f64>, &mut DVector<f64>)) {
        let first = &self.keys[0];
        let up_b = first.pose_w_b.rotation.inverse() * Vector3::z();
        let mut heading = h.fixed_view_mut::<3, 3>(0, 0);
        heading += up_b * up_b.transpose() * HELD;
        let at = self.states() - OF_BIASES;
        for k in 0..3 {
            h[(3 + k, 3 + k)] += HELD;
            g[3 + k] += HELD * first.pose_w_b.translation.vector[k];
            for (sensor, sigma) in noise.biases.iter().enumerate() {
                let k = 3 * sensor + k;
                h[(at + k, at + k)] += sigma.powi(-2);
                g[at + k] += self.biases[k] * sigma.powi(-2);
            }
        }
    }

    /// Applies the step of states and points that goes with a step of the calibration.
    pub(super) fn apply(&mut self, normal: &Normal, step: &Vector) {
        let states = &normal.states.0 + &normal.states.1 * step;
        let mut all = states.clone().resize_vertically(self.states() + CALIBRATION, 0.0);
        all.fixed_rows_mut::<CALIBRATION>(self.states()).copy_from(step);
        let rows = &normal.right + &normal.points * all;
        for (k, (point, _)) in self.points.iter_mut().enumerate() {
            let delta = -(normal.roots[k].transpose() * rows.fixed_rows::<3>(3 * k));
            let [a, b] = point.tangents();
            let reach = delta.xy().norm().max(1.0);
            point.direction = (point.direction + (a * delta.x + b * delta.y) / reach).normalize();
            point.inverse_m = (point.inverse_m + delta.z).max(0.0);
        }
        for (k, key) in self.keys.iter_mut().enumerate() {
            *key = key.moved(&states.fixed_rows::<OF_KEY>(OF_KEY * k).into_owned());
        }
        self.biases += states.fixed_rows::<OF_BIASES>(self.states() - OF_BIASES);
    }
}

/// Adds residuals with their derivatives, also weighted ones, by the unknowns of these places.
fn add<const R: usize, const C: usize>(
    h: &mut DMatrix<f64>,
    g: &mut DVector<f64>,
    at: impl Fn(usize) -> usize,
    by: &SMatrix<f64, R, C>,
    weighted: &SMatrix<f64, C, R>,
    residual: &SVector<f64, R>,
) {
    let (square, slope) = (weighted * by, weighted * residual);
    for i in 0..C {
        g[at(i)] += slope[i];
        for j in 0..C {
            h[(at(i), at(j))] += square[(i, j)];
        }
    }
}

fn weight_of(sight: &Sight, noise: &Noise) -> f64 {
    let relative = (sight.residual_px / noise.px).norm_squared() / (KERNEL * KERNEL);
    noise.px.powi(-2) / (1.0 + relative)
}

/// Information of the residuals of a link: white noise of both sensors, whose integral moves velocity and position together.
fn link_weight(dt_s: f64, noise: &Noise) -> SMatrix<f64, 9, 9> {
    let (gyro, accel) = (noise.gyro.powi(-2), noise.accel.powi(-2));
    let mut weight = SMatrix::zeros();
    for k in 0..3 {
        weight[(k, k)] = gyro / dt_s;
        weight[(3 + k, 3 + k)] = 4.0 * accel / dt_s;
        weight[(6 + k, 6 + k)] = 12.0 * accel / dt_s.powi(3);
        weight[(3 + k, 6 + k)] = -6.0 * accel / dt_s.powi(2);
        weight[(6 + k, 3 + k)] = -6.0 * accel / dt_s.powi(2);
    }
    weight
}

/// The point that lies on the rays of these views.
fn triangulated<'a>(
    rig: &Rig,
    keys: &[Key],
    views: impl Iterator<Item = &'a View>,
    is_pair: bool,
) -> Option<Point> {
    let (mut square, mut rays) = (Matrix4::zeros(), Vec::new());
    for view in views {
        let key = &keys[view.key];
        let (ray, centre) = rig.ray_b(key, view.camera, &view.px)?;
        let pose = &key.pose_w_b;
        let ray = (pose.rotation * ray).normalize();
        let centre = (pose * nalgebra::Point3::from(centre)).coords;
        let plane = Matrix3::identity() - ray * ray.transpose();
        let mut rows = SMatrix::<f64, 3, 4>::zeros();
        rows.fixed_columns_mut::<3>(0).copy_from(&plane);
        rows.set_column(3, &(-plane * centre));
        square += rows.transpose() * rows;
        rays.push((ray, centre));
    }
    let first = rays.first()?;
    if !is_pair {
        return Some(Point { direction: first.0, inverse_m: UNKNOWN_INVERSE_M });
    }
    if rays.len() < 2 {
        return None;
    }
    let eigen = square.symmetric_eigen();
    let best = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let (direction, inverse) = (best.fixed_rows::<3>(0).into_owned(), best[3]);
    let side =
        rays.iter().map(|(ray, centre)| ray.dot(&(direction - centre * inverse)).signum()).sum::<f64>();
    let length = direction.norm() * side.signum();
    let point = Point { direction: direction / length, inverse_m: (inverse / length).max(0.0) };
    (length.abs() > 1e-3).then_some(point)
}
