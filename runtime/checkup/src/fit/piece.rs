//! A piece of a recording, a second or two: states at its keyframes, points, and its normal equations.
//!
//! Minimized is the sum of the squared residuals of pixels (Cauchy kernel) and of the inertial samples between keyframes, over the
//! states and the calibration. Points are eliminated first, then the states: what is left is the quadratic of the calibration that
//! this piece holds, `cost(x) = cost + 2 g'x + x'S x`.

use super::integral::{Link, OF_BIASES, OF_SAMPLES, Reading, Sensors, reading_at};
use super::rig::{CALIBRATION, Key, OF_KEY, OF_VIEWS, Point, Rig, Vector};
use nalgebra::{
    Cholesky, DMatrix, DVector, Dim, Dyn, Isometry3, Matrix, Matrix3, Matrix4, OMatrix, SMatrix, SVector,
    Storage, Translation3, Vector2, Vector3,
};
use plumbline_estimator::geometry::{exp_so3, rotation_between};

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
    pub(super) points: Vec<(Point, Vec<View>)>,
    pub(super) biases: SVector<f64, OF_BIASES>,
}

/// Residuals of a piece without weights: of pixels, gyroscope and accelerometer.
type Residuals = [Vec<f64>; 3];

/// Normal equations of a piece, reduced to the calibration.
pub(super) struct Normal {
    pub(super) information: SMatrix<f64, CALIBRATION, CALIBRATION>,
    pub(super) gradient: Vector,
    pub(super) residuals: Residuals,
    /// Step of the states by a step of the calibration and a one.
    states: DMatrix<f64>,
    /// Whitened rows of the points by states, calibration and a one, as columns, and the roots that whiten them.
    points: DMatrix<f64>,
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

    /// Normal equations at the present states; `damping` is added to the diagonal of these, as a share of it. Their last column is the slope.
    pub(super) fn normal(
        &self,
        rig: &Rig,
        readings: &[Reading],
        noise: &Noise,
        damping: f64,
    ) -> Option<Normal> {
        let (states, all) = (self.states(), self.states() + CALIBRATION + 1);
        let mut h = DMatrix::<f64>::zeros(all, all);
        let mut residuals = Residuals::default();
        self.add_links(rig, readings, noise, &mut h, &mut residuals);
        let (points, roots) = self.add_views(rig, noise, damping, &mut h, &mut residuals)?;
        // Half of their square is enough, and of a keyframe the points that begin before it.
        for k in 0..=self.keys.len() {
            let is_state = k < self.keys.len();
            let (at, width) = if is_state { (OF_KEY * k, OF_KEY) } else { (states, CALIBRATION + 1) };
            let begun = self.points.partition_point(|(_, views)| views[0].key <= k);
            let rows = points.view((at, 0), (all - at, 3 * begun));
            let mut part = h.view_mut((at, at), (all - at, width));
            part -= rows * rows.rows(0, width).transpose();
        }
        self.add_priors(noise, &mut h);
        h.fill_upper_triangle_with_lower_triangle();
        for k in 0..states {
            h[(k, k)] += damping * h[(k, k)].max(0.0) + FAINT;
        }
        let own: Cholesky<f64, Dyn> = h.view((0, 0), (states, states)).into_owned().cholesky()?;
        let cross = h.columns(states, CALIBRATION + 1).rows(0, states).into_owned();
        let by_rig = -own.solve(&cross);
        let reduced = h.rows(states, CALIBRATION).columns(states, CALIBRATION + 1)
            + cross.columns(0, CALIBRATION).transpose() * &by_rig;
        Some(Normal {
            information: reduced.fixed_columns::<CALIBRATION>(0).fixed_rows::<CALIBRATION>(0).into_owned(),
            gradient: reduced.fixed_view::<CALIBRATION, 1>(0, CALIBRATION).into_owned(),
            residuals,
            states: by_rig,
            points,
            roots,
        })
    }

    fn add_links(
        &self,
        rig: &Rig,
        readings: &[Reading],
        noise: &Noise,
        h: &mut DMatrix<f64>,
        residuals: &mut Residuals,
    ) {
        let states = self.states();
        for (k, keys) in self.keys.windows(2).enumerate() {
            let pair = [&keys[0], &keys[1]];
            let Some(link) = Link::new(rig, &self.biases, readings, pair) else { continue };
            let root_s = link.dt_s.sqrt();
            let residual = |i: usize| link.residual[i].abs() / root_s;
            residuals[1].extend((0..3).map(residual));
            residuals[2].extend((3..6).map(residual));
            // Where these columns lie among all unknowns.
            let at = |column: usize| match column {
                _ if column < 2 * OF_KEY => OF_KEY * k + column,
                0..OF_SAMPLES => states + column - OF_SAMPLES,
                _ => states + OF_VIEWS + column - OF_SAMPLES,
            };
            add(h, at, &(link.by.transpose() * link_weight(link.dt_s, noise) * link.by));
        }
    }

    /// Adds what is seen; returns the whitened rows of the points as columns, which are still to be subtracted, and the roots that whiten them.
    fn add_views(
        &self,
        rig: &Rig,
        noise: &Noise,
        damping: f64,
        h: &mut DMatrix<f64>,
        residuals: &mut Residuals,
    ) -> Option<(DMatrix<f64>, Vec<Matrix3<f64>>)> {
        let states = self.states();
        let mut columns = DMatrix::<f64>::zeros(h.ncols(), 3 * self.points.len());
        let mut roots = Vec::with_capacity(self.points.len());
        // Whitened derivatives and residuals by keyframe, a column each.
        let mut seen = vec![Vec::new(); self.keys.len()];
        for (k, (point, views)) in self.points.iter().enumerate() {
            let mut own = Matrix3::from_diagonal(&Vector3::new(FAINT, FAINT, FAINT + OF_DEPTH * damping));
            let mut across = columns.fixed_columns_mut::<3>(3 * k);
            for view in views {
                let key = &self.keys[view.key];
                let Some(sight) = rig.sight(key, point, view.camera, &view.px) else { continue };
                residuals[0].push(sight.residual_px.norm());
                let relative = (sight.residual_px / noise.px).norm_squared() / (KERNEL * KERNEL);
                let root = (noise.px.powi(-2) / (1.0 + relative)).sqrt();
                let by_point = sight.by_point.transpose() * root;
                own += by_point * by_point.transpose();
                let by = sight.by.transpose() * root;
                for (column, cross) in (by * by_point.transpose()).row_iter().enumerate() {
                    let mut sum = across.row_mut(place(states, view.key, column));
                    sum += cross;
                }
                seen[view.key].extend(by.column_iter().map(|column| column.into_owned()));
            }
            let root = own.cholesky()?.l().try_inverse()?;
            across.copy_from(&(&across * root.transpose()));
            roots.push(root);
        }
        for (key, seen) in seen.into_iter().enumerate().filter(|(_, seen)| !seen.is_empty()) {
            let seen = OMatrix::<f64, _, Dyn>::from_columns(&seen);
            add(h, |column| place(states, key, column), &(&seen * seen.transpose()));
        }
        Some((columns, roots))
    }

    fn add_priors(&self, noise: &Noise, h: &mut DMatrix<f64>) {
        let first = &self.keys[0];
        let up_b = first.pose_w_b.rotation.inverse() * Vector3::z();
        let mut heading = h.fixed_view_mut::<3, 3>(0, 0);
        heading += up_b * up_b.transpose() * HELD;
        let (at, last) = (self.states() - OF_BIASES, h.ncols() - 1);
        for k in 0..3 {
            h[(3 + k, 3 + k)] += HELD;
            h[(last, 3 + k)] += HELD * first.pose_w_b.translation.vector[k];
            for (sensor, sigma) in noise.biases.iter().enumerate() {
                let k = 3 * sensor + k;
                h[(at + k, at + k)] += sigma.powi(-2);
                h[(last, at + k)] += self.biases[k] * sigma.powi(-2);
            }
        }
    }

    /// Applies the step of states and points that goes with a step of the calibration.
    pub(super) fn apply(&mut self, normal: &Normal, step: &Vector) {
        let step = step.push(1.0);
        let states = &normal.states * step;
        let all = DVector::from_iterator(normal.points.nrows(), states.iter().chain(&step).copied());
        let rows = normal.points.tr_mul(&all);
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

/// Place of a column of what is seen at a keyframe among all unknowns.
fn place(states: usize, key: usize, column: usize) -> usize {
    match column {
        0..OF_KEY => OF_KEY * key + column,
        _ if column < OF_KEY + OF_VIEWS => states + column - OF_KEY,
        _ => states + CALIBRATION,
    }
}

/// Adds the square of some rows at these places.
fn add<R: Dim, S: Storage<f64, R, R>>(
    h: &mut DMatrix<f64>,
    at: impl Fn(usize) -> usize,
    square: &Matrix<f64, R, R, S>,
) {
    for j in 0..square.ncols() {
        for i in 0..square.nrows() {
            h[(at(i), at(j))] += square[(i, j)];
        }
    }
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
        let mut rows = plane.fixed_resize::<3, 4>(0.0);
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
