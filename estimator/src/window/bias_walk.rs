//! Covariance that the random walk of the biases adds to a motion that is joined of many.
//!
//! The factor takes the biases of its first frame for those of the whole motion. Over a fraction of a second that is as good as
//! true; over seconds without a view they walk away from there, and the motion with them. With `x` the error of `dp`, `dR`,
//! `dv`, `w` the walk of the biases since the first frame, and a next motion whose derivative by the biases is `B`,
//!
//! ```text
//! x' = F x + G (B w + x_next)        w' = w + w_next
//! ```
//!
//! with `F`, `G` of [`Preintegration::transition`]. Covariances of `x` and of `x` with `w` are carried along; that of `w` is
//! `walk² dt`. It is the growth of [`super::growth`], from biases that are known.

use super::state::{FrameMatrix, NavState};
use crate::inertial::{ImuNoise, Preintegration};
use nalgebra::SMatrix;
use plumbline_config::Portable;

/// Integration is exact to about a micrometre per step: keeps the covariance of one step regular.
pub(super) const FLOOR: f64 = 1e-14;
/// Least variance of a walk.
const LEAST_WALK: f64 = 1e-16;

/// Covariances of what the walk of the biases did to a motion: nothing, for one that was integrated in one piece.
#[derive(Clone, Debug, Default)]
pub(super) struct BiasWalk {
    motion: SMatrix<f64, 9, 9>,
    with_biases: SMatrix<f64, 9, 6>,
}

impl BiasWalk {
    /// Returns the bias walk of `first` (with `self`) followed by `next` (with `of_next`).
    pub(super) fn followed_by(
        &self,
        first: &Preintegration,
        (of_next, next): (&Self, &Preintegration),
        noise: &ImuNoise,
    ) -> Self {
        let (f, g) = first.transition(next);
        let by_bias = g * next.by_bias;
        let walked = by_bias * SMatrix::<f64, 6, 6>::from_diagonal(&variances(noise, first.dt_s));
        let carried = f * self.with_biases;
        let mixed = carried * by_bias.transpose();
        Self {
            motion: f * self.motion * f.transpose()
                + mixed
                + mixed.transpose()
                + walked * by_bias.transpose()
                + g * of_next.motion * g.transpose(),
            with_biases: carried + walked + g * of_next.with_biases,
        }
    }

    /// Information of the residual of `motion`; `None` where its covariance cannot be inverted.
    pub(super) fn information(&self, motion: &Preintegration, noise: &ImuNoise) -> Option<FrameMatrix> {
        let mut covariance = FrameMatrix::zeros();
        let of_motion = motion.covariance + self.motion + SMatrix::<f64, 9, 9>::identity() * FLOOR;
        covariance.fixed_view_mut::<9, 9>(0, 0).copy_from(&of_motion);
        let biases = NavState::BIAS_GYRO;
        covariance.fixed_view_mut::<9, 6>(0, biases).copy_from(&self.with_biases);
        covariance.fixed_view_mut::<6, 9>(biases, 0).copy_from(&self.with_biases.transpose());
        for (k, variance) in variances(noise, motion.dt_s).iter().enumerate() {
            covariance[(biases + k, biases + k)] = variance.at_least(LEAST_WALK);
        }
        Some(covariance.cholesky()?.inverse())
    }
}

/// Variances of the walk of gyroscope (0..3) and accelerometer (3..6) over `dt_s`.
fn variances(noise: &ImuNoise, dt_s: f64) -> nalgebra::SVector<f64, 6> {
    let of = |k: usize| if k < 3 { noise.gyro_walk } else { noise.accel_walk };
    nalgebra::SVector::from_fn(|k, _| of(k) * of(k) * dt_s)
}

#[cfg(test)]
mod tests {
    use super::super::growth::GrowingCovariance;
    use super::super::inertial_factor::InertialFactor;
    use super::*;
    use crate::estimate::{BiasVariances, NavCovariance};
    use nalgebra::Vector3;

    /// Sensor of the preset `sim`.
    const NOISE: ImuNoise = ImuNoise {
        gyro_density: 1.7e-4,
        accel_density: 2e-3,
        gyro_walk: 1.9e-5,
        accel_walk: 3e-3,
        ..ImuNoise::NONE
    };
    const GRAVITY_O: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

    /// `count` motions of 50 ms.
    fn pieces(count: usize) -> impl Iterator<Item = Preintegration> {
        (0..count).map(|k| {
            let mut piece = Preintegration::new(&Vector3::zeros(), &Vector3::zeros());
            let t = k as f64 * 0.05;
            let (gyro, accel) = (Vector3::new(0.1, -0.02 * t, 0.1), Vector3::new((2.0 * t).sin(), 0.3, 9.9));
            (0..10).for_each(|_| piece.integrate(0.005, &gyro, &accel, &accel, &NOISE));
            piece
        })
    }

    fn joined(count: usize) -> InertialFactor {
        let factors = pieces(count).map(|piece| InertialFactor::new(piece, &NOISE));
        factors.reduce(|joined, next| joined.followed_by(&next, &NOISE)).expect("is one")
    }

    fn covariance(factor: &InertialFactor) -> FrameMatrix {
        factor.information().expect("is regular").try_inverse().expect("is regular")
    }

    #[test]
    fn a_long_motion_is_as_uncertain_as_a_state_that_is_carried_as_far() {
        let mut nav = NavState::default();
        let mut carried = GrowingCovariance::new(NavCovariance::zeros(), &BiasVariances::zeros());
        for piece in pieces(90) {
            carried.grow(&nav, &piece, &NOISE);
            nav = nav.after(&piece, &GRAVITY_O);
        }
        let of_factor = covariance(&joined(90)).fixed_view::<9, 9>(0, 0).into_owned();
        assert!((of_factor - carried.nav).norm() < 1e-3 * carried.nav.norm());
        // 4.5 s of walk: the velocity is known to 1.6 cm/s, of which white noise is 4 mm/s.
        assert!((0.015..0.02).contains(&of_factor[(6, 6)].sqrt()), "{}", of_factor[(6, 6)].sqrt());
    }

    #[test]
    fn where_the_biases_end_tells_of_the_motion() {
        let covariance = covariance(&joined(90));
        let (v, bias) = (NavState::V, NavState::BIAS_ACCEL);
        let correlation = |k: usize| {
            let mixed = covariance.fixed_view::<3, 3>(v, bias).row(k).norm();
            mixed / (covariance[(v + k, v + k)] * covariance[(bias + k, bias + k)]).sqrt()
        };
        // Of a walk and its integral it is the square root of three quarters; white noise and the turn take some of it.
        assert!((0..3).all(|k| (0.65..0.87).contains(&correlation(k))), "{}", correlation(0));
    }

    #[test]
    fn within_two_seconds_biases_are_steady() {
        let factor = joined(40);
        let block = factor.information().expect("is regular").fixed_view::<9, 9>(0, 0).into_owned();
        let steady = (factor.motion.covariance + SMatrix::<f64, 9, 9>::identity() * FLOOR).cholesky();
        assert_eq!(block, steady.expect("is regular").inverse());
    }
}
