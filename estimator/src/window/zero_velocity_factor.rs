//! The zero-velocity factor: a vehicle at rest has no velocity, `r = v / sigma`.

use super::dense::NormalEquations;
use super::frame::Frame;
use super::state::{NavState, unknown_of_frame};

/// Speed that the zero-velocity detector may overlook, m/s ([`crate::odometry::zero_velocity`]).
pub(super) const SIGMA_M_S: f64 = 0.01;

/// Cost of the velocity of a frame at rest, in squared standard deviations. On request its normal equations are added to
/// `linearization`, the frame being that of the index given. A frame that moves costs nothing.
pub fn zero_velocity(frame: &Frame, linearization: Option<(&mut NormalEquations, usize)>) -> f64 {
    if !frame.is_still {
        return 0.0;
    }
    let v = &frame.nav.v_o_b;
    let information = 1.0 / (SIGMA_M_S * SIGMA_M_S);
    if let Some((equations, index)) = linearization {
        let at = unknown_of_frame(index) + NavState::V;
        for k in 0..3 {
            equations.add(at + k, at + k, information);
            equations.gradient_mut()[at + k] += information * v[k];
        }
    }
    0.5 * information * v.norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use plumbline_config::Timestamp;

    fn frame(is_still: bool) -> Frame {
        let nav = NavState { v_o_b: Vector3::new(0.02, -0.01, 0.03), ..NavState::default() };
        Frame {
            stamp: Timestamp::from_nanos(0),
            taken: Timestamp::from_nanos(0),
            gyro_b: Vector3::zeros(),
            time_offset_s: 0.0,
            linearization: nav.clone(),
            nav,
            in_prior: false,
            is_keyframe: false,
            is_still,
            inertial: None,
        }
    }

    #[test]
    fn a_frame_at_rest_pulls_its_velocity_to_zero_and_nothing_else() {
        let mut equations = NormalEquations::new(unknown_of_frame(2));
        equations.reset(unknown_of_frame(2));
        let cost = zero_velocity(&frame(true), Some((&mut equations, 1)));
        // (0.02² + 0.01² + 0.03²) / 0.01² / 2
        assert!((cost - 7.0).abs() < 1e-12);
        assert!((cost - zero_velocity(&frame(true), None)).abs() < 1e-12);
        let at = unknown_of_frame(1) + NavState::V;
        for k in 0..equations.dim() {
            let is_velocity = (at..at + 3).contains(&k);
            assert_eq!(equations.get(k, k) > 0.0, is_velocity, "{k}");
        }
        assert!((equations.gradient()[at] - 200.0).abs() < 1e-9);
    }

    #[test]
    fn a_frame_in_motion_says_nothing() {
        let mut equations = NormalEquations::new(unknown_of_frame(1));
        equations.reset(unknown_of_frame(1));
        assert_eq!(zero_velocity(&frame(false), Some((&mut equations, 0))), 0.0);
        assert!((0..equations.dim()).all(|k| equations.get(k, k) == 0.0));
    }
}
