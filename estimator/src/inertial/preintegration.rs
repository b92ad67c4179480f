//! Preintegration of inertial samples between two times, on the manifold.
//!
//! Source: Forster et al., "On-Manifold Preintegration for Real-Time Visual-Inertial Odometry" (2017),
//! equations 33-44, with the specific force taken at the middle of each step. For two states `i`, `j`
//!
//! ```text
//! p_j = p_i + v_i dt + g dt²/2 + R_i dp      R_j = R_i dR      v_j = v_i + g dt + R_i dv
//! ```
//!
//! `dp`, `dR`, `dv` depend on the biases; they are kept to first order around the biases of integration.
//! Errors are ordered position (0..3), attitude (3..6, right perturbation), velocity (6..9).

use crate::geometry::{exp_so3, right_jacobian, skew};
use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};
use plumbline_config::Portable;
use plumbline_config::options::ImuConfig;

/// An error of scale or alignment counts as white noise of this correlation time, s: about as long as a motion keeps its
/// direction.
const MOTION_TIME_S: f64 = 0.5;

/// Specific force of steady flight, m/s²: gravity.
const USUAL_FORCE_M_S2: f64 = 9.81;

/// White noise and bias random walk of an inertial sensor, as densities, and what grows with its readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuNoise {
    /// rad/s/sqrt(Hz)
    pub gyro_density: f64,
    /// m/s²/sqrt(Hz)
    pub accel_density: f64,
    /// rad/s²/sqrt(Hz)
    pub gyro_walk: f64,
    /// m/s³/sqrt(Hz)
    pub accel_walk: f64,
    /// Share of an angular rate that scale and alignment may be wrong by.
    pub gyro_scale: f64,
    /// Share of a specific force beyond gravity that scale and alignment may be wrong by.
    pub accel_scale: f64,
}

impl ImuNoise {
    /// The noise model that a configuration describes.
    ///
    /// A coloured error of standard deviation `sigma` and correlation time `tau` (Gauss-Markov) changes within `t << tau` by
    /// `sigma sqrt(2 t / tau)`: like a walk of density `sigma sqrt(2 / tau)`. The window is not much longer than `tau`, and
    /// takes that walk for part of the bias. It differs from white noise, whose effect averages out, and from the walk of
    /// the switch-on bias, which is slower by an order of magnitude.
    pub fn of(config: &ImuConfig) -> Self {
        let coloured = |sigma: f64| sigma * (2.0 / config.error_time_s).sqrt();
        Self {
            gyro_density: config.gyro_noise_density,
            accel_density: config.accel_noise_density,
            gyro_walk: libm::hypot(config.gyro_bias_walk, coloured(config.gyro_error_sigma_rad_s)),
            accel_walk: libm::hypot(config.accel_bias_walk, coloured(config.accel_error_sigma_m_s2)),
            gyro_scale: config.gyro_scale_sigma,
            accel_scale: config.accel_scale_sigma,
        }
    }

    /// Variances of the mean angular rate and force of a step of `dt` in which these are `gyro` and `accel`. An error of
    /// scale or alignment is constant, but as a vehicle moves its effect is not, and the bias takes what stays of it: noise
    /// of standard deviation `sigma |omega|` and correlation time `tau` has the density `sigma |omega| sqrt(2 tau)`. Gravity
    /// is the part that stays.
    fn variances(&self, dt: f64, gyro: &Vector3<f64>, accel: &Vector3<f64>) -> (f64, f64) {
        let relative = |scale: f64, reading: f64| scale * scale * reading * reading * (2.0 * MOTION_TIME_S);
        let force = accel.norm() - USUAL_FORCE_M_S2;
        (
            (self.gyro_density * self.gyro_density + relative(self.gyro_scale, gyro.norm())) / dt,
            (self.accel_density * self.accel_density + relative(self.accel_scale, force)) / dt,
        )
    }
}

#[cfg(test)]
impl ImuNoise {
    /// A perfect sensor.
    pub const NONE: Self = Self {
        gyro_density: 0.0,
        accel_density: 0.0,
        gyro_walk: 0.0,
        accel_walk: 0.0,
        gyro_scale: 0.0,
        accel_scale: 0.0,
    };
}

/// The motion between two times as the IMU measured it, independent of the state at either.
#[derive(Clone, Debug, PartialEq)]
pub struct Preintegration {
    /// Length of the interval, s.
    pub dt_s: f64,
    /// `dp`, m, in the body frame of the start.
    pub delta_p: Vector3<f64>,
    /// `dR`.
    pub delta_rot: UnitQuaternion<f64>,
    /// `dv`, m/s, in the body frame of the start.
    pub delta_v: Vector3<f64>,
    /// Covariance of the errors of `dp`, `dR`, `dv`.
    pub covariance: SMatrix<f64, 9, 9>,
    /// Derivative of (`dp`, `dR`, `dv`) by the biases of gyroscope (0..3) and accelerometer (3..6).
    pub by_bias: SMatrix<f64, 9, 6>,
    /// Gyroscope bias of integration, rad/s.
    pub bias_gyro: Vector3<f64>,
    /// Accelerometer bias of integration, m/s².
    pub bias_accel: Vector3<f64>,
    /// Variance of the times of both ends together, s²; in the covariance already.
    pub ends_variance_s2: f64,
}

/// `dp`, `dR`, `dv` at some biases.
#[derive(Clone, Debug, PartialEq)]
pub struct CorrectedDelta {
    /// `dp`, m.
    pub p: Vector3<f64>,
    /// `dR`.
    pub rot: UnitQuaternion<f64>,
    /// `dv`, m/s.
    pub v: Vector3<f64>,
}

impl Preintegration {
    /// The empty interval.
    pub fn new(bias_gyro: &Vector3<f64>, bias_accel: &Vector3<f64>) -> Self {
        Self {
            dt_s: 0.0,
            delta_p: Vector3::zeros(),
            delta_rot: UnitQuaternion::identity(),
            delta_v: Vector3::zeros(),
            covariance: SMatrix::zeros(),
            by_bias: SMatrix::zeros(),
            bias_gyro: *bias_gyro,
            bias_accel: *bias_accel,
            ends_variance_s2: 0.0,
        }
    }

    /// Appends a step of `dt` with the mean angular rate `gyro` and the specific force `accel_start` at
    /// its start and `accel_end` at its end.
    pub fn integrate(
        &mut self,
        dt: f64,
        gyro: &Vector3<f64>,
        accel_start: &Vector3<f64>,
        accel_end: &Vector3<f64>,
        noise: &ImuNoise,
    ) {
        let phi = (gyro - self.bias_gyro) * dt;
        let step_rot = exp_so3(&phi);
        let end_in_start = step_rot * (accel_end - self.bias_accel);
        let accel = (accel_start - self.bias_accel + end_in_start) * 0.5;

        let rot = self.delta_rot.to_rotation_matrix().into_inner();
        let rot_accel = rot * skew(&accel);
        // The force at the end turns with the step: half of it sees the gyroscope bias of this step.
        let jr_dt = right_jacobian(&phi) * dt;
        let rot_half_end = rot * skew(&end_in_start) * (0.5 * dt);
        let variances = noise.variances(dt, &(phi / dt), &accel);
        self.propagate_errors(dt, &step_rot, &rot, &rot_accel, &jr_dt, &rot_half_end, variances);

        let accel_in_first = self.delta_rot * accel;
        self.delta_p += self.delta_v * dt + accel_in_first * (0.5 * dt * dt);
        self.delta_v += accel_in_first * dt;
        self.delta_rot = UnitQuaternion::new_normalize((self.delta_rot * step_rot).into_inner());
        self.dt_s += dt;
    }

    /// First-order propagation of covariance and bias Jacobians over one step.
    #[allow(clippy::too_many_arguments)]
    fn propagate_errors(
        &mut self,
        dt: f64,
        step_rot: &UnitQuaternion<f64>,
        rot: &Matrix3<f64>,
        rot_accel: &Matrix3<f64>,
        jr_dt: &Matrix3<f64>,
        rot_half_end: &Matrix3<f64>,
        (gyro_var, accel_var): (f64, f64),
    ) {
        let identity = Matrix3::identity();
        let mut a = SMatrix::<f64, 9, 9>::identity();
        a.fixed_view_mut::<3, 3>(0, 3).copy_from(&(rot_accel * (-0.5 * dt * dt)));
        a.fixed_view_mut::<3, 3>(0, 6).copy_from(&(identity * dt));
        a.fixed_view_mut::<3, 3>(3, 3).copy_from(&step_rot.inverse().to_rotation_matrix().into_inner());
        a.fixed_view_mut::<3, 3>(6, 3).copy_from(&(rot_accel * -dt));

        // By the bias of this step; noise acts through the same matrix.
        let mut b = SMatrix::<f64, 9, 6>::zeros();
        b.fixed_view_mut::<3, 3>(0, 0).copy_from(&(rot_half_end * (0.5 * dt * dt)));
        b.fixed_view_mut::<3, 3>(3, 0).copy_from(&-jr_dt);
        b.fixed_view_mut::<3, 3>(6, 0).copy_from(&(rot_half_end * dt));
        let mean_rot = (rot + rot * step_rot.to_rotation_matrix().into_inner()) * 0.5;
        b.fixed_view_mut::<3, 3>(0, 3).copy_from(&(mean_rot * (-0.5 * dt * dt)));
        b.fixed_view_mut::<3, 3>(6, 3).copy_from(&(mean_rot * -dt));

        let mut weighted = b;
        weighted.fixed_columns_mut::<3>(0).scale_mut(gyro_var);
        weighted.fixed_columns_mut::<3>(3).scale_mut(accel_var);
        self.covariance = a * self.covariance * a.transpose() + weighted * b.transpose();
        self.by_bias = a * self.by_bias + b;
    }

    /// The increments at the biases of integration.
    pub fn delta(&self) -> CorrectedDelta {
        CorrectedDelta { p: self.delta_p, rot: self.delta_rot, v: self.delta_v }
    }

    /// The increments at the biases given, to first order.
    pub fn corrected(&self, bias_gyro: &Vector3<f64>, bias_accel: &Vector3<f64>) -> CorrectedDelta {
        let d_gyro = bias_gyro - self.bias_gyro;
        let d_accel = bias_accel - self.bias_accel;
        let part = |row: usize| {
            self.by_bias.fixed_view::<3, 3>(row, 0) * d_gyro
                + self.by_bias.fixed_view::<3, 3>(row, 3) * d_accel
        };
        CorrectedDelta {
            p: self.delta_p + part(0),
            rot: self.delta_rot * exp_so3(&part(3)),
            v: self.delta_v + part(6),
        }
    }

    /// This interval followed by `next`, at the biases of this one.
    pub fn followed_by(&self, next: &Self) -> Self {
        let delta = next.corrected(&self.bias_gyro, &self.bias_accel);
        let rot = self.delta_rot.to_rotation_matrix().into_inner();
        let dt = next.dt_s;
        let (a, b) = self.transition(next);
        Self {
            dt_s: self.dt_s + dt,
            delta_p: self.delta_p + self.delta_v * dt + rot * delta.p,
            delta_rot: UnitQuaternion::new_normalize((self.delta_rot * delta.rot).into_inner()),
            delta_v: self.delta_v + rot * delta.v,
            covariance: a * self.covariance * a.transpose() + b * next.covariance * b.transpose(),
            by_bias: a * self.by_bias + b * next.by_bias,
            ends_variance_s2: self.ends_variance_s2.at_least(next.ends_variance_s2),
            ..*self
        }
    }

    /// Transition matrices of the errors of this interval (first) and of `next` (second) into those of both
    /// together.
    pub fn transition(&self, next: &Self) -> (SMatrix<f64, 9, 9>, SMatrix<f64, 9, 9>) {
        let delta = next.corrected(&self.bias_gyro, &self.bias_accel);
        delta.transition(&self.delta_rot, next.dt_s)
    }
}

impl CorrectedDelta {
    /// Transition matrices of the errors of a state of attitude `rot` (first), and of this motion of `dt_s` from there
    /// (second), into those of the state at its end.
    pub fn transition(
        &self,
        rot: &UnitQuaternion<f64>,
        dt_s: f64,
    ) -> (SMatrix<f64, 9, 9>, SMatrix<f64, 9, 9>) {
        let rot = rot.to_rotation_matrix().into_inner();
        let mut a = SMatrix::<f64, 9, 9>::identity();
        a.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-rot * skew(&self.p)));
        a.fixed_view_mut::<3, 3>(0, 6).copy_from(&(Matrix3::identity() * dt_s));
        a.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.rot.inverse().to_rotation_matrix().into_inner());
        a.fixed_view_mut::<3, 3>(6, 3).copy_from(&(-rot * skew(&self.v)));
        let mut b = SMatrix::<f64, 9, 9>::zeros();
        b.fixed_view_mut::<3, 3>(0, 0).copy_from(&rot);
        b.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::identity());
        b.fixed_view_mut::<3, 3>(6, 6).copy_from(&rot);
        (a, b)
    }
}

#[cfg(test)]
mod tests;
