//! The prior: what is known from measurements that have left the window.
//!
//! A quadratic in the error state around fixed linearization points, in information form:
//! `E(d) = d' H d / 2 + b' d`, with `d` the step from the linearization point (rig first, then frames in
//! order). Its Jacobians are those of the first estimates, so that the four directions which no
//! measurement can see (position and yaw of everything) stay unseen: see [`super::marginalize`].

use super::calibration::KnownRig;
use super::dense::{MAX_UNKNOWNS, NormalEquations};
use super::frame::Frame;
use super::state::{FRAME_DIM, NavState, RIG_DIM, Rig, unknown_of_frame};
use nalgebra::Vector3;

/// An unknown with less information than this is dropped instead of eliminated.
pub(super) const PIVOT_FLOOR: f64 = 1e-9;

/// The prior over the rig and the first frames of the window.
#[derive(Clone, Debug)]
pub struct Prior {
    /// `H` and `b`.
    pub equations: NormalEquations,
    /// Where the rig is linearized.
    pub rig: Rig,
    /// Steps from the linearization points, refreshed by [`Self::evaluate`].
    steps: [f64; MAX_UNKNOWNS],
    product: [f64; MAX_UNKNOWNS],
}

/// State at the first pose, as far as it is known beforehand.
#[derive(Clone, Copy, Debug, Default)]
pub struct AnchorState {
    /// Gyroscope bias, rad/s.
    pub bias_gyro: Vector3<f64>,
    /// Accelerometer bias, m/s².
    pub bias_accel: Vector3<f64>,
    /// The vertical in the body; `None` where it is not known, and the tilt is what the solution makes of it.
    pub up_b: Option<Vector3<f64>>,
}

/// Standard deviations of the state at the first pose.
#[derive(Clone, Copy, Debug)]
pub struct AnchorSigmas {
    /// Position and yaw: they define the odometry frame, so they are known.
    pub position_m: f64,
    /// See `position_m`.
    pub yaw_rad: f64,
    /// Roll and pitch.
    pub tilt_rad: f64,
    /// Velocity, m/s.
    pub velocity_m_s: f64,
    /// Gyroscope bias, rad/s.
    pub bias_gyro_rad_s: f64,
    /// Accelerometer bias, m/s².
    pub bias_accel_m_s2: f64,
}

impl Prior {
    /// No information about anything; `capacity` unknowns at most.
    pub fn new(capacity: usize, rig: &Rig) -> Self {
        let mut equations = NormalEquations::new(capacity);
        equations.reset(RIG_DIM);
        Self { equations, rig: rig.clone(), steps: [0.0; MAX_UNKNOWNS], product: [0.0; MAX_UNKNOWNS] }
    }

    /// Number of frames in the prior (the first ones of the window).
    pub fn frames(&self) -> usize {
        (self.equations.dim() - RIG_DIM) / FRAME_DIM
    }

    /// Forgets everything and starts from `rig`, and what is known of it.
    pub fn start(&mut self, rig: &Rig, known: &KnownRig) {
        self.equations.reset(RIG_DIM);
        self.rig = rig.clone();
        self.equations.add_block(0, 0, &known.information);
        self.equations.gradient_mut()[..RIG_DIM].copy_from_slice(known.gradient.as_slice());
    }

    /// Adds what is known of frame `index` at the start: its state is `nav`, and `known` beforehand, within the standard
    /// deviations given.
    pub fn anchor(&mut self, index: usize, nav: &NavState, known: &AnchorState, sigmas: &AnchorSigmas) {
        let base = unknown_of_frame(index);
        if self.equations.dim() < base + FRAME_DIM {
            self.equations.grow(base + FRAME_DIM);
        }
        let information = |sigma: f64| 1.0 / (sigma * sigma);
        for (part, sigma) in [
            (NavState::P, sigmas.position_m),
            (NavState::V, sigmas.velocity_m_s),
            (NavState::BIAS_GYRO, sigmas.bias_gyro_rad_s),
            (NavState::BIAS_ACCEL, sigmas.bias_accel_m_s2),
        ] {
            for k in base + part..base + part + 3 {
                self.equations.add(k, k, information(sigma));
            }
        }
        let gyro = (nav.bias_gyro - known.bias_gyro) * information(sigmas.bias_gyro_rad_s);
        let accel = (nav.bias_accel - known.bias_accel) * information(sigmas.bias_accel_m_s2);
        for k in 0..3 {
            self.equations.gradient_mut()[base + NavState::BIAS_GYRO + k] += gyro[k];
            self.equations.gradient_mut()[base + NavState::BIAS_ACCEL + k] += accel[k];
        }
        let up_b: Vector3<f64> = nav.rot_o_b.inverse() * Vector3::z();
        let yaw = up_b * up_b.transpose() * (information(sigmas.yaw_rad) - information(sigmas.tilt_rad));
        let tilt = nalgebra::Matrix3::identity() * information(sigmas.tilt_rad);
        let at = base + NavState::ROT;
        self.equations.add_block(at, at, &(yaw + tilt));
        if let Some(known_up_b) = known.up_b {
            // The turn from the known tilt to that of the state, without its yaw.
            let turn = up_b.cross(&known_up_b) * information(sigmas.tilt_rad);
            (0..3).for_each(|k| self.equations.gradient_mut()[at + k] += turn[k]);
        }
    }

    /// Adds the prior to `target` at the present states; returns its cost `d' H d / 2 + b' d`.
    pub fn evaluate(&mut self, rig: &Rig, frames: &[Frame], target: Option<&mut NormalEquations>) -> f64 {
        let dim = self.equations.dim();
        self.refresh_steps(rig, frames);
        let mut cost = 0.0;
        for k in 0..dim {
            cost += self.steps[k] * (0.5 * self.product[k] + self.equations.gradient()[k]);
        }
        if let Some(target) = target {
            for i in 0..dim {
                for (to, from) in target.row_mut(i).iter_mut().zip(self.equations.row(i)) {
                    *to += from;
                }
                target.gradient_mut()[i] += self.equations.gradient()[i] + self.product[i];
            }
        }
        cost
    }

    /// Steps from the linearization points, and `H` times them.
    fn refresh_steps(&mut self, rig: &Rig, frames: &[Frame]) {
        self.steps[..RIG_DIM].copy_from_slice(rig.minus(&self.rig).as_slice());
        for (k, frame) in frames.iter().take(self.frames()).enumerate() {
            let at = unknown_of_frame(k);
            self.steps[at..at + FRAME_DIM].copy_from_slice(frame.nav.minus(&frame.linearization).as_slice());
        }
        self.equations.multiply(&self.steps, &mut self.product);
    }

    /// Replaces the prior by `equations`, whose gradient is taken at the present states: moved back to
    /// the linearization points.
    pub fn replace(&mut self, equations: &NormalEquations, rig: &Rig, frames: &[Frame]) {
        self.equations.copy_from(equations);
        self.refresh_steps(rig, frames);
        for (b, moved) in self.equations.gradient_mut().iter_mut().zip(&self.product) {
            *b -= moved;
        }
    }
}

#[cfg(test)]
#[path = "prior_tests.rs"]
mod tests;
