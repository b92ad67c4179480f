//! Corrections enter the odometry at a bounded rate.
//!
//! Each frame tells a little better where the vehicle was, and so where it is. What was told before is not taken back at once:
//! the difference stays as an offset, which shrinks while the vehicle flies on. Who controls or filters by the odometry sees a
//! velocity that is wrong by little for a while, in the place of a step that no velocity explains: a filter takes its
//! measurements for independent of each other, and reads a step of centimetres, which all that follow share, as
//! motion.
//!
//! The offset decays exponentially, so that small corrections are in before the next frame, but no part of it faster than
//! its bound. As it is known it counts as an error that the covariance has to cover.
//!
//! A correction that would be published as an error for long is not one to smooth: velocity above all, which a filter integrates
//! while it is wrong. Beyond [`MAX_OFFSET_M`], [`MAX_OFFSET_RAD`] or [`MAX_OFFSET_M_S`] the state is published as it is, at once,
//! and the step is counted ([`crate::Odometry::jumps`]), so that a filter restarts from it.

use crate::estimate::NavCovariance;
use crate::window::state::{FRAME_DIM, NavState};
use nalgebra::SVector;
use plumbline_config::Portable;

/// Time constant of the decay, s: that of a frame at 20 Hz.
const TIME_CONSTANT_S: f64 = 0.05;
/// Largest speed at which the position is corrected, m/s: a millimetre from one sample to the next at 200 Hz, twice the noise
/// that autopilots take for the velocity of a camera system by default (0.1 m/s). The largest correction seen with one camera,
/// 6 cm, is complete after a third of a second.
pub const MAX_SPEED_M_S: f64 = 0.2;
/// The attitude, rad/s: 0.03 degrees from sample to sample.
pub const MAX_TURN_RAD_S: f64 = 0.1;
/// The velocity, m/s²: a tenth of gravity.
pub const MAX_ACCELERATION_M_S2: f64 = 1.0;

/// Largest correction of the position that is blended, m. The largest in a flight without a fault is 11 cm, with one camera.
pub const MAX_OFFSET_M: f64 = 0.15;
/// Bound of the attitude, rad: 2.9 degrees.
pub const MAX_OFFSET_RAD: f64 = 0.05;
/// Bound of the velocity, m/s: the noise that autopilots assume for it by default.
pub const MAX_OFFSET_M_S: f64 = 0.1;

/// Position, attitude and velocity, in the order of the error state.
const DIM: usize = NavState::BIAS_GYRO;
/// Parts of the offset, how fast each may shrink, in its unit a second, and how large it may be.
const PARTS: [(usize, f64, f64); 3] = [
    (NavState::P, MAX_SPEED_M_S, MAX_OFFSET_M),
    (NavState::ROT, MAX_TURN_RAD_S, MAX_OFFSET_RAD),
    (NavState::V, MAX_ACCELERATION_M_S2, MAX_OFFSET_M_S),
];

/// Difference between the published state and the estimated state; by default there is none.
#[derive(Clone, Debug, Default)]
pub struct Blend {
    /// Error-state step from the estimated state to the published one.
    offset: SVector<f64, DIM>,
}

impl Blend {
    /// The state was corrected to `nav`; `told` is what was published of it. Returns whether the correction is blended:
    /// beyond the bounds it is taken at once, and nothing of it is left.
    pub fn begin(&mut self, told: &NavState, nav: &NavState) -> bool {
        self.offset = told.minus(nav).fixed_rows::<DIM>(0).into_owned();
        // What is no number is not within its bound.
        let is_small =
            PARTS.iter().all(|(part, _, largest)| self.offset.fixed_rows::<3>(*part).norm() <= *largest);
        if !is_small {
            self.offset.fill(0.0);
        }
        is_small
    }

    /// State to be published for `nav`.
    pub fn told(&self, nav: &NavState) -> NavState {
        let mut step = SVector::<f64, FRAME_DIM>::zeros();
        step.fixed_rows_mut::<DIM>(0).copy_from(&self.offset);
        nav.plus(&step)
    }

    /// The covariance of what is told, given that of the state.
    #[must_use]
    pub fn covariance(&self, covariance: &NavCovariance) -> NavCovariance {
        covariance + self.offset * self.offset.transpose()
    }

    /// `dt_s` later: the offset has shrunk.
    pub fn advance(&mut self, dt_s: f64) {
        let share = 1.0 - libm::exp(-dt_s / TIME_CONSTANT_S);
        for (part, max_rate, _) in PARTS {
            let mut offset = self.offset.fixed_rows_mut::<3>(part);
            let size = offset.norm();
            if size > 0.0 {
                offset *= 1.0 - share.at_most(max_rate * dt_s / size);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::exp_so3;
    use nalgebra::Vector3;

    const DT_S: f64 = 0.005;

    fn turned(x: f64) -> NavState {
        NavState { rot_o_b: exp_so3(&Vector3::new(x, 0.3, -0.2)), ..NavState::default() }
    }

    #[test]
    fn what_was_told_is_told_until_time_passes() {
        let (told, nav) = (turned(0.04), NavState { p_o_b: Vector3::new(0.05, 0.02, 0.03), ..turned(0.0) });
        let mut blend = Blend::default();
        assert_eq!(blend.told(&nav), nav);
        assert!(blend.begin(&told, &nav));
        assert!(blend.told(&nav).minus(&told).norm() < 1e-12);
        blend.advance(0.0);
        assert!(blend.told(&nav).minus(&told).norm() < 1e-12);
    }

    #[test]
    fn no_part_is_corrected_faster_than_its_bound_and_all_of_it_in_the_end() {
        let (told, nav) = (NavState { p_o_b: Vector3::new(0.06, 0.0, 0.0), ..turned(0.03) }, turned(0.0));
        let told = NavState { v_o_b: Vector3::new(0.0, -0.09, 0.03), ..told };
        let mut blend = Blend::default();
        assert!(blend.begin(&told, &nav));
        let mut before = blend.told(&nav);
        for _ in 0..200 {
            blend.advance(DT_S);
            let now = blend.told(&nav);
            let step = now.minus(&before);
            for (part, max_rate, _) in PARTS {
                assert!(step.fixed_rows::<3>(part).norm() <= max_rate * DT_S * (1.0 + 1e-9));
            }
            before = now;
        }
        assert!(before.minus(&nav).norm() < 1e-3, "{}", before.minus(&nav));
    }

    #[test]
    fn takes_a_large_correction_at_once() {
        let nav = turned(0.0);
        let wrong = [
            NavState { p_o_b: Vector3::new(0.0, 0.16, 0.0), ..turned(0.0) },
            turned(0.06),
            NavState { v_o_b: Vector3::new(0.0, 0.0, -0.12), ..turned(0.0) },
            NavState { v_o_b: Vector3::new(f64::NAN, 0.0, 0.0), ..turned(0.0) },
        ];
        for told in wrong {
            let mut blend = Blend::default();
            assert!(!blend.begin(&told, &nav), "{told:?}");
            assert_eq!(blend.told(&nav), nav);
            assert_eq!(blend.covariance(&NavCovariance::zeros()), NavCovariance::zeros());
        }
    }

    #[test]
    fn the_covariance_covers_what_is_still_to_come() {
        let (told, nav) = (NavState { p_o_b: Vector3::new(0.06, 0.0, 0.0), ..turned(0.0) }, turned(0.0));
        let known = NavCovariance::identity() * 1e-6;
        let mut blend = Blend::default();
        assert_eq!(blend.covariance(&known), known);
        blend.begin(&told, &nav);
        let covariance = blend.covariance(&known);
        assert!((covariance[(0, 0)] - (1e-6 + 0.06 * 0.06)).abs() < 1e-12 && covariance[(1, 1)] < 2e-6);
        // The offset is one standard deviation of it, at most.
        let offset = told.minus(&nav).fixed_rows::<DIM>(0).into_owned();
        let squared = (offset.transpose() * covariance.try_inverse().expect("is one") * offset)[0];
        assert!(squared < 1.0, "{squared}");
    }
}
