//! Bringing an estimate into the frame of the reference.
//!
//! SE(3) and Sim(3) by Umeyama (1991), "Least-squares estimation of transformation parameters between two
//! point patterns", equations 34 to 43: with `x` the estimated and `y` the true positions, it minimizes
//! `sum |y - (c R x + t)|²` by the singular values of their covariance. With gravity known, only yaw and
//! position are free (4 DoF, Zhang and Scaramuzza 2018): then `R = Rz(psi)` with the `psi` that maximizes
//! `trace(Rᵀ C)`, in closed form.

use super::{EvaluateError, Pairs};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::Serialize;

/// Which freedom the alignment has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AlignmentMode {
    /// The frames are taken as they are.
    None,
    /// The first poses are made to coincide.
    Origin,
    /// Yaw about the vertical and position; both frames have z up.
    Yaw,
    /// Rotation and position.
    #[default]
    Se3,
    /// Rotation, position and scale.
    Sim3,
}

impl AlignmentMode {
    /// All alignments: name, description, value.
    pub const NAMED: [(&'static str, &'static str, Self); 5] = [
        ("none", "No alignment", Self::None),
        ("origin", "Align the first poses", Self::Origin),
        ("yaw", "Position and yaw", Self::Yaw),
        ("se3", "Position and attitude", Self::Se3),
        ("sim3", "Position, attitude and scale", Self::Sim3),
    ];
}

/// `p -> scale * R p + t`, from the frame of the estimate to that of the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Rotation.
    pub rotation: UnitQuaternion<f64>,
    /// Translation, m.
    pub translation: Vector3<f64>,
    /// By what the estimate's lengths are multiplied.
    pub scale: f64,
}

impl Similarity {
    /// The transformation that changes nothing.
    pub fn identity() -> Self {
        Self { rotation: UnitQuaternion::identity(), translation: Vector3::zeros(), scale: 1.0 }
    }

    /// A pose, transformed.
    pub fn apply(&self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        let position = self.rotation * (pose.translation.vector * self.scale) + self.translation;
        Isometry3::from_parts(Translation3::from(position), self.rotation * pose.rotation)
    }
}

/// The transformation of freedom `mode` that brings the estimate nearest to the reference.
///
/// # Errors
/// When the positions do not determine it.
pub fn align(pairs: &Pairs, mode: AlignmentMode) -> Result<Similarity, EvaluateError> {
    match mode {
        AlignmentMode::None => Ok(Similarity::identity()),
        AlignmentMode::Origin => origin(pairs),
        AlignmentMode::Yaw => yaw(&Moments::of(pairs, 2)?),
        AlignmentMode::Se3 => umeyama(&Moments::of(pairs, 3)?, false),
        AlignmentMode::Sim3 => umeyama(&Moments::of(pairs, 3)?, true),
    }
}

/// The estimate, transformed; stamps unchanged.
pub fn aligned(pairs: &Pairs, by: &Similarity) -> Pairs {
    let mut pairs = pairs.clone();
    for pose in &mut pairs.estimate {
        pose.pose = by.apply(&pose.pose);
    }
    pairs
}

/// Means, variance and covariance of the positions (equations 34 to 38).
struct Moments {
    mean_x: Vector3<f64>,
    mean_y: Vector3<f64>,
    variance_x: f64,
    covariance: Matrix3<f64>,
}

impl Moments {
    fn of(pairs: &Pairs, needed: usize) -> Result<Self, EvaluateError> {
        let found = pairs.len();
        if found < needed {
            return Err(EvaluateError::TooFew { found, needed });
        }
        let n = found as f64;
        let x = || pairs.estimate.iter().map(|p| p.pose.translation.vector);
        let y = || pairs.reference.iter().map(|p| p.pose.translation.vector);
        let (mean_x, mean_y) = (x().sum::<Vector3<f64>>() / n, y().sum::<Vector3<f64>>() / n);
        let variance_x = x().map(|x| (x - mean_x).norm_squared()).sum::<f64>() / n;
        let covariance =
            x().zip(y()).map(|(x, y)| (y - mean_y) * (x - mean_x).transpose()).sum::<Matrix3<f64>>() / n;
        Ok(Self { mean_x, mean_y, variance_x, covariance })
    }

    fn similarity(&self, rotation: UnitQuaternion<f64>, scale: f64) -> Similarity {
        Similarity { rotation, translation: self.mean_y - rotation * self.mean_x * scale, scale }
    }
}

fn umeyama(moments: &Moments, with_scale: bool) -> Result<Similarity, EvaluateError> {
    let svd = moments.covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(EvaluateError::Degenerate) };
    let d = svd.singular_values;
    if d[1] <= f64::EPSILON {
        return Err(EvaluateError::Degenerate);
    }
    let handedness = if u.determinant() * v_t.determinant() < 0.0 { -1.0 } else { 1.0 };
    let s = Vector3::new(1.0, 1.0, handedness);
    let rotation = Rotation3::from_matrix_unchecked(u * Matrix3::from_diagonal(&s) * v_t);
    let scale = if with_scale { d.dot(&s) / moments.variance_x } else { 1.0 };
    Ok(moments.similarity(UnitQuaternion::from_rotation_matrix(&rotation), scale))
}

fn yaw(moments: &Moments) -> Result<Similarity, EvaluateError> {
    let c = &moments.covariance;
    let (sine, cosine) = (c[(1, 0)] - c[(0, 1)], c[(0, 0)] + c[(1, 1)]);
    if sine.hypot(cosine) <= f64::EPSILON {
        return Err(EvaluateError::Degenerate);
    }
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), sine.atan2(cosine));
    Ok(moments.similarity(rotation, 1.0))
}

fn origin(pairs: &Pairs) -> Result<Similarity, EvaluateError> {
    let first = pairs.reference.first().zip(pairs.estimate.first());
    let (y, x) = first.ok_or(EvaluateError::TooFew { found: 0, needed: 1 })?;
    let motion = y.pose * x.pose.inverse();
    Ok(Similarity { rotation: motion.rotation, translation: motion.translation.vector, scale: 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Timestamp;
    use plumbline_drivers::StampedPose;
    use proptest::prelude::*;

    fn helix(n: usize) -> Vec<StampedPose> {
        (0..n)
            .map(|i| {
                let a = i as f64 * 0.3;
                let rotation = UnitQuaternion::from_euler_angles(0.1 * a.sin(), 0.2, a);
                let position = Translation3::new(2.0 * a.cos(), 3.0 * a.sin(), 0.1 * a);
                let stamp = Timestamp::from_nanos(i as i64 * 50_000_000);
                StampedPose { stamp, pose: Isometry3::from_parts(position, rotation) }
            })
            .collect()
    }

    fn moved(by: &Similarity) -> Pairs {
        let estimate = helix(40);
        let mut reference = estimate.clone();
        for p in &mut reference {
            p.pose = by.apply(&p.pose);
        }
        Pairs { estimate, reference }
    }

    fn assert_near(a: &Similarity, b: &Similarity) {
        assert!(a.rotation.angle_to(&b.rotation) < 1e-9, "{a:?} {b:?}");
        assert!((a.translation - b.translation).norm() < 1e-8, "{a:?} {b:?}");
        assert!((a.scale - b.scale).abs() < 1e-10, "{a:?} {b:?}");
    }

    proptest! {
        #[test]
        fn a_known_motion_is_found(
            r in prop::array::uniform3(-3.0..3.0),
            t in prop::array::uniform3(-50.0..50.0),
            scale in 0.2..5.0,
        ) {
            let rotation = UnitQuaternion::from_scaled_axis(r.into());
            let sim3 = Similarity { rotation, translation: t.into(), scale };
            assert_near(&align(&moved(&sim3), AlignmentMode::Sim3).unwrap(), &sim3);
            let se3 = Similarity { scale: 1.0, ..sim3 };
            assert_near(&align(&moved(&se3), AlignmentMode::Se3).unwrap(), &se3);
            assert_near(&align(&moved(&se3), AlignmentMode::Origin).unwrap(), &se3);
            let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), r[0]);
            let yaw = Similarity { rotation, ..se3 };
            assert_near(&align(&moved(&yaw), AlignmentMode::Yaw).unwrap(), &yaw);
        }
    }

    #[test]
    fn a_mirrored_estimate_still_gives_a_rotation() {
        let mut pairs = moved(&Similarity::identity());
        pairs.reference.iter_mut().for_each(|p| p.pose.translation.x *= -1.0);
        let rotation = align(&pairs, AlignmentMode::Se3).unwrap().rotation.to_rotation_matrix();
        assert!((rotation.matrix().determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_line_or_a_point_determines_nothing() {
        let mut pairs = moved(&Similarity::identity());
        for p in pairs.estimate.iter_mut().chain(&mut pairs.reference) {
            p.pose.translation = Translation3::new(p.stamp.as_nanos() as f64 * 1e-9, 0.0, 0.0);
        }
        assert!(matches!(align(&pairs, AlignmentMode::Se3), Err(EvaluateError::Degenerate)));
        pairs.estimate.iter_mut().for_each(|p| p.pose.translation.x = 1.0);
        assert!(matches!(align(&pairs, AlignmentMode::Yaw), Err(EvaluateError::Degenerate)));
        let two = Pairs { estimate: helix(2), reference: helix(2) };
        assert!(matches!(
            align(&two, AlignmentMode::Se3),
            Err(EvaluateError::TooFew { found: 2, needed: 3 })
        ));
    }
}
