//! Calibration of a rig as one vector: what a fit may change, and where a point is seen through it.
//!
//! A point is a direction `n` (unit, from the origin of the piece) and an inverse distance `rho`; the body sees it along
//! `q = R_wb' (n - rho p_w)`, the left camera along `R_bc' (q - rho p_bc)`, the right one along `R_01' (that - rho p_01)`. So points
//! at infinity need no care. All rotations are perturbed on the right.

use nalgebra::{Isometry3, Matrix2, Matrix2x3, Matrix3, SMatrix, SVector, Vector2, Vector3};
use plumbline_config::{CameraModel, Config};
use plumbline_estimator::geometry::{exp_so3, log_so3, skew};

/// Unknowns of the calibration.
pub(crate) const CALIBRATION: usize = 55;
/// The first of them, by which what is seen changes.
pub(super) const OF_VIEWS: usize = 28;
/// Unknowns of a keyframe: rotation, position, velocity.
pub(super) const OF_KEY: usize = 9;
/// Unknowns of a camera: logarithm of the focal length, of fx / fy, centre in px, cubic distortion, and how the first changes
/// within a piece, 1/s and 1/s².
pub(super) const OF_LENS: usize = 7;
/// Place of each group of unknowns.
pub(crate) const LENSES: [usize; 2] = [0, OF_LENS];
pub(crate) const ROT_B_C: usize = 14;
pub(crate) const P_B_C: usize = 17;
pub(crate) const ROT_PAIR: usize = 20;
pub(crate) const P_PAIR: usize = 23;
pub(crate) const RIGHT_LATE: usize = 26;
pub(crate) const READOUT: usize = 27;
pub(crate) const DELAY: usize = 28;
pub(crate) const CLOCK_RATE: usize = 29;
pub(crate) const ALTERNATING: usize = 30;
pub(crate) const GYRO: usize = 31;
pub(crate) const ACCEL: usize = 40;
pub(crate) const BIASES: usize = 49;

/// Smallest cosine between a ray and the optical axis at which a point counts as seen.
const MIN_COSINE: f64 = 0.05;

/// Calibration vector.
pub(crate) type Vector = SVector<f64, CALIBRATION>;

/// Calibration at which the residuals are evaluated.
#[derive(Clone, Debug)]
pub(crate) struct Rig {
    models: [CameraModel; 2],
    configured: [Isometry3<f64>; 2],
    /// Left camera in the body, right camera in the left one.
    poses: [Isometry3<f64>; 2],
    readout_s: f64,
    offset_s: f64,
    pub(super) gravity_w: Vector3<f64>,
    /// Unknowns beside the rotations, as steps from the configuration.
    values: Vector,
}

/// State of the body at a keyframe.
#[derive(Clone, Debug, Default)]
pub(super) struct Key {
    /// Stamp by the cameras' clock, s from the middle of the recording.
    pub(super) t_s: f64,
    /// Stamp by the cameras' clock, s from the middle of its piece.
    pub(super) within_s: f64,
    /// 0.5 for every other frame, -0.5 for those between.
    pub(super) parity: f64,
    pub(super) pose_w_b: Isometry3<f64>,
    pub(super) v_w: Vector3<f64>,
    /// Rate of the body by the gyroscope, rad/s.
    pub(super) rate_b: Vector3<f64>,
}

/// Point of a piece.
#[derive(Clone, Debug)]
pub(super) struct Point {
    pub(super) direction: Vector3<f64>,
    pub(super) inverse_m: f64,
}

/// Predicted pixel less the measured one, with its derivatives.
pub(super) struct Sight {
    pub(super) residual_px: Vector2<f64>,
    /// By rotation, position and velocity of the body, then by the rig; in the last column the residual.
    pub(super) by: SMatrix<f64, 2, { OF_KEY + OF_VIEWS + 1 }>,
    /// By two tangents of the direction and by the inverse distance.
    pub(super) by_point: SMatrix<f64, 2, 3>,
}

impl Key {
    /// State after a rotation, a shift and a change of the velocity.
    pub(super) fn moved(&self, delta: &SVector<f64, OF_KEY>) -> Self {
        let turn = delta.fixed_rows::<3>(0).into_owned();
        let mut moved = self.clone();
        moved.pose_w_b.rotation *= exp_so3(&(turn / turn.norm().max(1.0)));
        moved.pose_w_b.translation.vector += delta.fixed_rows::<3>(3);
        moved.v_w += delta.fixed_rows::<3>(6);
        moved
    }
}

impl Point {
    /// Two tangents of the direction.
    pub(super) fn tangents(&self) -> [Vector3<f64>; 2] {
        let least = Vector3::ith(self.direction.iamin(), 1.0);
        let first = self.direction.cross(&least).normalize();
        [first, self.direction.cross(&first)]
    }
}

impl Rig {
    /// The configured calibration; one camera stands for both.
    pub(crate) fn new(config: &Config) -> Option<Self> {
        let left = config.camera.first()?;
        let right = config.camera.get(1).unwrap_or(left);
        let poses = [left.pose_b_c(), left.pose_b_c().inverse() * right.pose_b_c()];
        Some(Self {
            models: [left.model(), right.model()],
            configured: poses,
            poses,
            readout_s: left.readout_s,
            offset_s: config.rig.time_offset_s,
            gravity_w: Vector3::z() * -config.imu.gravity_m_s2,
            values: Vector::zeros(),
        })
    }

    /// Applies a step.
    pub(crate) fn plus(&self, step: &Vector) -> Self {
        let mut next = self.clone();
        next.values += step;
        for (pose, at) in next.poses.iter_mut().zip([ROT_B_C, ROT_PAIR]) {
            pose.rotation *= exp_so3(&step.fixed_rows::<3>(at).into_owned());
            pose.translation.vector += step.fixed_rows::<3>(at + 3);
        }
        next
    }

    /// Steps from the configuration.
    pub(crate) fn steps(&self) -> Vector {
        let mut steps = self.values;
        for (k, at) in [ROT_B_C, ROT_PAIR].into_iter().enumerate() {
            let turned = log_so3(&(self.configured[k].rotation.inverse() * self.poses[k].rotation));
            steps.fixed_rows_mut::<3>(at).copy_from(&turned);
        }
        steps
    }

    /// Time of a keyframe by the clock of the inertial samples, s.
    pub(super) fn imu_time_s(&self, key: &Key) -> f64 {
        let v = &self.values;
        key.t_s + self.offset_s + v[DELAY] + v[CLOCK_RATE] * key.t_s + v[ALTERNATING] * key.parity
    }

    /// Matrix that takes readings of one inertial sensor to what they should be, and the bias after it.
    pub(super) fn sensor(&self, at: usize) -> (Matrix3<f64>, Vector3<f64>) {
        let bias = BIASES + if at == GYRO { 0 } else { 3 };
        let change = Matrix3::from_row_slice(&self.values.as_slice()[at..at + 9]);
        (Matrix3::identity() + change, self.values.fixed_rows::<3>(bias).into_owned())
    }

    /// Direction in the body, and centre in the body, of a pixel at a keyframe.
    pub(super) fn ray_b(
        &self,
        key: &Key,
        camera: usize,
        px: &Vector2<f64>,
    ) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let (model, lens) = (&self.models[camera], self.lens(camera));
        let relative = px - model.centre_px - Vector2::new(lens[2], lens[3]);
        let undone = relative.component_div(&gains(lens, key)) + model.centre_px;
        let xy = model.unproject(&undone)?;
        let pose = if camera == 0 { self.poses[0] } else { self.poses[0] * self.poses[1] };
        Some((pose.rotation * xy.push(1.0), pose.translation.vector))
    }

    fn lens(&self, camera: usize) -> &[f64] {
        &self.values.as_slice()[LENSES[camera]..LENSES[camera] + OF_LENS]
    }

    /// Residual of a pixel in which a camera saw a point; `None` where the point cannot be seen.
    pub(super) fn sight(&self, key: &Key, point: &Point, camera: usize, px: &Vector2<f64>) -> Option<Sight> {
        let rho = point.inverse_m;
        let row = px.y / (self.models[camera].height_px as f64 - 1.0) - 0.5;
        let right = camera as f64;
        let late_s = (self.readout_s + self.values[READOUT]) * row + right * self.values[RIGHT_LATE];
        let rot_b_w = key.pose_w_b.rotation.inverse().to_rotation_matrix().into_inner();
        let p_w = key.pose_w_b.translation.vector + key.v_w * late_s;
        let turned = exp_so3(&(key.rate_b * -late_s)).to_rotation_matrix().into_inner();
        let to_b = turned * rot_b_w;
        let q_b = to_b * (point.direction - p_w * rho);
        // By rotation, position, velocity, time, direction (through `to_b`) and inverse distance.
        let by_late = -key.rate_b.cross(&q_b) - to_b * key.v_w * rho;
        let rot_c_b = self.poses[0].rotation.inverse().to_rotation_matrix().into_inner();
        let mut ray = rot_c_b * (q_b - self.poses[0].translation.vector * rho);
        let mut chain = rot_c_b;
        let mut by_mount = [skew(&ray), -rot_c_b * rho];
        let mut by_inverse = rot_c_b * (-to_b * p_w - self.poses[0].translation.vector);
        let mut by_pair = [Matrix3::zeros(); 2];
        if camera == 1 {
            let across = self.poses[1].rotation.inverse().to_rotation_matrix().into_inner();
            ray = across * (ray - self.poses[1].translation.vector * rho);
            by_inverse = across * (by_inverse - self.poses[1].translation.vector);
            by_mount = by_mount.map(|m| across * m);
            by_pair = [skew(&ray), -across * rho];
            chain = across * chain;
        }
        let (residual_px, by_ray, by_lens) = self.projected(key, camera, &ray, px)?;
        let [a, b] = point.tangents();
        let by_q = by_ray * chain;
        let mut by = SMatrix::<f64, 2, { OF_KEY + OF_VIEWS + 1 }>::zeros();
        by.set_column(OF_KEY + OF_VIEWS, &residual_px);
        let by_p = by_q * to_b * -rho;
        by.fixed_columns_mut::<3>(0).copy_from(&(by_q * skew(&q_b)));
        by.fixed_columns_mut::<3>(3).copy_from(&by_p);
        by.fixed_columns_mut::<3>(6).copy_from(&(by_p * late_s));
        by.fixed_columns_mut::<OF_LENS>(OF_KEY + LENSES[camera]).copy_from(&by_lens);
        for k in 0..2 {
            by.fixed_columns_mut::<3>(OF_KEY + ROT_B_C + 3 * k).copy_from(&(by_ray * by_mount[k]));
            by.fixed_columns_mut::<3>(OF_KEY + ROT_PAIR + 3 * k).copy_from(&(by_ray * by_pair[k]));
        }
        let by_late = by_q * by_late;
        by.set_column(OF_KEY + RIGHT_LATE, &(by_late * right));
        by.set_column(OF_KEY + READOUT, &(by_late * row));
        let by_point =
            SMatrix::<f64, 2, 3>::from_columns(&[by_q * to_b * a, by_q * to_b * b, by_ray * by_inverse]);
        Some(Sight { residual_px, by, by_point })
    }

    /// Residual of the pixel of a ray, with its derivatives by the ray and by the lens.
    fn projected(
        &self,
        key: &Key,
        camera: usize,
        ray: &Vector3<f64>,
        px: &Vector2<f64>,
    ) -> Option<(Vector2<f64>, Matrix2x3<f64>, SMatrix<f64, 2, OF_LENS>)> {
        if ray.z.is_nan() || ray.z < MIN_COSINE * ray.norm() {
            return None;
        }
        let (model, lens) = (&self.models[camera], self.lens(camera));
        let xy = ray.xy() / ray.z;
        let (r2, cubic) = (xy.norm_squared(), lens[4]);
        let (ideal_px, by_bent) = model.project_normalized(&(xy * (1.0 + cubic * r2)));
        let gain = Matrix2::from_diagonal(&gains(lens, key));
        let relative = gain * (ideal_px - model.centre_px);
        let residual = relative + model.centre_px + Vector2::new(lens[2], lens[3]) - px;
        let by_bent = gain * by_bent;
        let by_xy =
            by_bent * (Matrix2::identity() * (1.0 + cubic * r2) + xy * xy.transpose() * (2.0 * cubic));
        let by_ray = by_xy * Matrix2x3::new(1.0, 0.0, -xy.x, 0.0, 1.0, -xy.y) / ray.z;
        let by_aspect = Vector2::new(relative.x, -relative.y) * 0.5;
        let moves = [relative * key.within_s, relative * key.within_s.powi(2)];
        let columns =
            [relative, by_aspect, Vector2::x(), Vector2::y(), by_bent * xy * r2, moves[0], moves[1]];
        Some((residual, by_ray, SMatrix::from_columns(&columns)))
    }
}

/// Factors of the pixels from the centre.
fn gains(lens: &[f64], key: &Key) -> Vector2<f64> {
    let focal = lens[0] + (lens[5] + lens[6] * key.within_s) * key.within_s;
    Vector2::new((focal + 0.5 * lens[1]).exp(), (focal - 0.5 * lens[1]).exp())
}
