//! Rotations: exponential, logarithm and Jacobians of SO(3) for the right perturbation
//! `R <- R Exp(dtheta)`.
//!
//! Source: Forster et al., "On-Manifold Preintegration" (2017), section III; Sola et al., "A micro Lie
//! theory" (2018). Below [`SMALL_ANGLE_RAD`] series replace the closed forms; they agree there to 1e-12.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Angle below which series replace closed forms.
const SMALL_ANGLE_RAD: f64 = 1e-4;

/// The matrix `[v]x` with `[v]x w = v x w`.
#[must_use]
pub fn skew(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// `Exp`: the rotation by `phi` (axis times angle, rad).
#[must_use]
pub fn exp_so3(phi: &Vector3<f64>) -> UnitQuaternion<f64> {
    let angle = phi.norm();
    let (w, scale) = if angle < SMALL_ANGLE_RAD {
        let a2 = angle * angle;
        (1.0 - a2 / 8.0, 0.5 - a2 / 48.0)
    } else {
        let (sin, cos) = libm::sincos(0.5 * angle);
        (cos, sin / angle)
    };
    UnitQuaternion::new_normalize(Quaternion::new(w, phi.x * scale, phi.y * scale, phi.z * scale))
}

/// `Log`: axis times angle of a rotation, angle in `[0, pi]`.
#[must_use]
pub fn log_so3(rot: &UnitQuaternion<f64>) -> Vector3<f64> {
    let q = rot.quaternion();
    let (w, v) = if q.w < 0.0 { (-q.w, -q.imag()) } else { (q.w, q.imag()) };
    let sin = v.norm();
    if sin < SMALL_ANGLE_RAD {
        return v * (2.0 + sin * sin / 3.0);
    }
    v * (2.0 * libm::atan2(sin, w) / sin)
}

/// `Jr`: `Exp(phi + d) ~ Exp(phi) Exp(Jr(phi) d)`.
#[must_use]
pub fn right_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let angle = phi.norm();
    let s = skew(phi);
    if angle < SMALL_ANGLE_RAD {
        return Matrix3::identity() - s * 0.5 + s * s / 6.0;
    }
    let a2 = angle * angle;
    Matrix3::identity() - s * ((1.0 - libm::cos(angle)) / a2)
        + s * s * ((angle - libm::sin(angle)) / (a2 * angle))
}

/// The inverse of [`right_jacobian`]: `Log(Exp(phi) Exp(d)) ~ phi + Jr^-1(phi) d`. Singular at `2 pi`.
#[must_use]
pub fn right_jacobian_inverse(phi: &Vector3<f64>) -> Matrix3<f64> {
    let angle = phi.norm();
    let s = skew(phi);
    if angle < SMALL_ANGLE_RAD {
        return Matrix3::identity() + s * 0.5 + s * s / 12.0;
    }
    let a2 = angle * angle;
    let half = 0.5 * angle;
    Matrix3::identity() + s * 0.5 + s * s * ((1.0 - half * libm::cos(half) / libm::sin(half)) / a2)
}

/// The shortest rotation that takes the direction of `from` to that of `to`; about the x axis where they
/// are opposite.
#[must_use]
pub fn rotation_between(from: &Vector3<f64>, to: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(from, to)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI))
}

/// The yaw of an attitude, rad: the twist about z in its split into a swing and a twist. It adds up under
/// rotations about z from the left, and is singular only upside down, whichever axis of `B` points ahead.
#[must_use]
pub fn yaw_of(rot_o_b: &UnitQuaternion<f64>) -> f64 {
    let q = rot_o_b.quaternion();
    let half = if q.w < 0.0 { libm::atan2(-q.k, -q.w) } else { libm::atan2(q.k, q.w) };
    2.0 * half
}

/// The attitude with zero yaw in which the specific force `accel_b` points up.
#[must_use]
pub fn attitude_from_gravity(accel_b: &Vector3<f64>) -> UnitQuaternion<f64> {
    let tilt = rotation_between(accel_b, &Vector3::z());
    let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -yaw_of(&tilt));
    yaw * tilt
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vector3<f64>> {
        let scale = prop_oneof![Just(0.0), Just(1e-9), Just(1e-4), Just(0.1), Just(1.0), Just(1.7)];
        (scale, prop::array::uniform3(-1.0..1.0f64)).prop_map(|(s, v)| Vector3::from(v) * s)
    }

    proptest! {
        #[test]
        fn log_inverts_exp(phi in vector()) {
            prop_assert!((log_so3(&exp_so3(&phi)) - phi).norm() < 1e-9);
        }

        #[test]
        fn right_jacobian_is_the_derivative_of_exp(phi in vector()) {
            let h = 1e-6;
            for k in 0..3 {
                let mut d = Vector3::zeros();
                d[k] = h;
                let numeric = log_so3(&(exp_so3(&(phi - d)).inverse() * exp_so3(&(phi + d)))) / (2.0 * h);
                prop_assert!((numeric - right_jacobian(&phi).column(k)).norm() < 1e-6);
            }
        }

        #[test]
        fn the_inverse_jacobian_is_the_inverse(phi in vector()) {
            let product = right_jacobian(&phi) * right_jacobian_inverse(&phi);
            prop_assert!((product - Matrix3::identity()).norm() < 1e-9);
        }
    }

    #[test]
    fn at_rest_the_specific_force_points_up_and_yaw_is_zero() {
        let accel_b = Vector3::new(9.1, 0.2, -3.6);
        let rot_o_b = attitude_from_gravity(&accel_b);
        let up = rot_o_b * accel_b;
        assert!((up - Vector3::z() * accel_b.norm()).norm() < 1e-9);
        assert!(yaw_of(&rot_o_b).abs() < 1e-12);
    }

    #[test]
    fn both_signs_of_a_quaternion_are_one_rotation() {
        let q = exp_so3(&Vector3::new(0.3, -0.2, 3.0));
        let negated = UnitQuaternion::new_unchecked(-q.into_inner());
        assert!((log_so3(&q) - log_so3(&negated)).norm() < 1e-12);
    }
}
