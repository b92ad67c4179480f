//! Growth of the uncertainty while a state is carried forward by the inertial sensor alone.
//!
//! With `x` the error of position, attitude and velocity, `b` that of the biases, which stay what they are but for their
//! walk, and a motion of covariance `Q` whose derivative by the biases is `B`,
//!
//! ```text
//! x' = F x + G (B b + noise)        P' = F P F' + F C (GB)' + GB C' F' + GB S (GB)' + G Q G'
//! C' = F C + GB S                   S' = S + walk² dt
//! ```
//!
//! with `P`, `C`, `S` the covariances of `x`, of `x` with `b`, and of `b`.

use super::state::{FrameMatrix, NavState};
use crate::estimate::{BiasVariances, NavCovariance};
use crate::inertial::{ImuNoise, Preintegration};
use nalgebra::SMatrix;

/// Covariance of a state that is carried forward, and of its biases.
#[derive(Clone, Debug, Default)]
pub struct GrowingCovariance {
    /// Covariance of position, attitude and velocity.
    pub nav: NavCovariance,
    with_biases: SMatrix<f64, 9, 6>,
    biases: SMatrix<f64, 6, 6>,
}

impl GrowingCovariance {
    /// Covariance of an estimate, whose correlation of state and biases is not known and taken for none.
    pub fn new(nav: NavCovariance, biases: &BiasVariances) -> Self {
        Self { nav, with_biases: SMatrix::zeros(), biases: SMatrix::from_diagonal(biases) }
    }

    /// Covariance of a frame of the window, with the correlation of state and biases.
    pub fn of_frame(covariance: &FrameMatrix) -> Self {
        Self {
            nav: covariance.fixed_view::<9, 9>(0, 0).into_owned(),
            with_biases: covariance.fixed_view::<9, 6>(0, NavState::BIAS_GYRO).into_owned(),
            biases: covariance.fixed_view::<6, 6>(NavState::BIAS_GYRO, NavState::BIAS_GYRO).into_owned(),
        }
    }

    /// Covariance of state and biases, in the order of [`NavState`].
    pub fn of_all(&self) -> FrameMatrix {
        let biases = NavState::BIAS_GYRO;
        let mut all = FrameMatrix::zeros();
        all.fixed_view_mut::<9, 9>(0, 0).copy_from(&self.nav);
        all.fixed_view_mut::<9, 6>(0, biases).copy_from(&self.with_biases);
        all.fixed_view_mut::<6, 9>(biases, 0).copy_from(&self.with_biases.transpose());
        all.fixed_view_mut::<6, 6>(biases, biases).copy_from(&self.biases);
        all
    }

    /// True if all of it is finite.
    pub fn is_finite(&self) -> bool {
        self.nav.iter().chain(&self.with_biases).chain(&self.biases).all(|x| x.is_finite())
    }

    /// After the motion `step` from `nav`; the biases walk by `noise`.
    pub fn grow(&mut self, nav: &NavState, step: &Preintegration, noise: &ImuNoise) {
        let (f, g) = step.delta().transition(&nav.rot_o_b, step.dt_s);
        let by_bias = g * step.by_bias;
        let carried = f * self.with_biases;
        let mixed = carried * by_bias.transpose();
        self.nav = f * self.nav * f.transpose()
            + mixed
            + mixed.transpose()
            + by_bias * self.biases * by_bias.transpose()
            + g * step.covariance * g.transpose();
        self.with_biases = carried + by_bias * self.biases;
        for k in 0..3 {
            self.biases[(k, k)] += noise.gyro_walk * noise.gyro_walk * step.dt_s;
            self.biases[(3 + k, 3 + k)] += noise.accel_walk * noise.accel_walk * step.dt_s;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{exp_so3, log_so3};
    use nalgebra::{SVector, Vector3};

    const QUIET: ImuNoise = ImuNoise { gyro_density: 1e-9, accel_density: 1e-9, ..ImuNoise::NONE };
    const GRAVITY_O: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

    /// Flies two seconds in a curve from `nav`, 5 ms at a time.
    fn carried(nav: &NavState, mut each: impl FnMut(&NavState, &Preintegration)) -> NavState {
        let mut nav = nav.clone();
        for k in 0..400 {
            let t = f64::from(k) * 0.005;
            let (gyro, accel) = (Vector3::new(0.3, -0.2 * t, 0.6), Vector3::new(0.5, t, 9.9));
            let mut step = Preintegration::new(&nav.bias_gyro, &nav.bias_accel);
            step.integrate(0.005, &gyro, &accel, &accel, &QUIET);
            each(&nav, &step);
            nav = nav.after(&step, &GRAVITY_O);
        }
        nav
    }

    #[test]
    fn an_error_of_a_bias_does_what_the_covariance_says() {
        let start = NavState { rot_o_b: exp_so3(&Vector3::new(0.1, 0.4, -0.7)), ..NavState::default() };
        for k in 0..6 {
            let sigma = if k < 3 { 1e-5 } else { 1e-4 };
            let mut variances = BiasVariances::zeros();
            variances[k] = sigma * sigma;
            let mut covariance = GrowingCovariance::new(NavCovariance::zeros(), &variances);
            let end = carried(&start, |nav, step| covariance.grow(nav, step, &QUIET));
            let mut off = start.clone();
            let bias = if k < 3 { &mut off.bias_gyro } else { &mut off.bias_accel };
            bias[k % 3] += sigma;
            let other = carried(&off, |_, _| {});
            let turn = log_so3(&(end.rot_o_b.inverse() * other.rot_o_b));
            let parts = [other.p_o_b - end.p_o_b, turn, other.v_o_b - end.v_o_b];
            let error = SVector::<f64, 9>::from_iterator(parts.iter().flatten().copied());
            // One cause: the covariance is the square of its effect.
            let expected = error * error.transpose();
            let difference = (covariance.nav - expected).norm() / expected.norm();
            assert!(difference < 0.02, "bias {k}: {difference}");
        }
    }

    #[test]
    fn biases_that_walk_become_less_known() {
        let noise = ImuNoise { gyro_walk: 0.01, accel_walk: 0.1, ..QUIET };
        let mut covariance = GrowingCovariance::new(NavCovariance::zeros(), &BiasVariances::zeros());
        carried(&NavState::default(), |nav, step| covariance.grow(nav, step, &noise));
        assert!(
            (covariance.biases[(0, 0)] - 2e-4).abs() < 1e-9
                && (covariance.biases[(3, 3)] - 0.02).abs() < 1e-9
        );
        assert!(covariance.is_finite() && covariance.nav[(6, 6)] > 1e-3);
    }
}
