//! The pose of a camera from three points: Grunert's equations, as in Haralick et al. (1994), "Review and analysis of
//! solutions of the three point perspective pose estimation problem".
//!
//! With unit bearings `j1..j3` and distances `s1, s2 = u s1, s3 = v s1` the law of cosines for the three sides gives a
//! quartic in `v`; each root gives the three points in the camera, and two triangles give the pose. Degenerate where
//! the points are on a line (no plane) or the camera is on the danger cylinder (double roots).

use super::polynomial::real_roots;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Most poses that three points allow.
pub const MAX_SOLUTIONS: usize = 4;
/// Ratios of distances of two points, at most: beyond, one of them is of no use.
const MAX_RATIO: f64 = 50.0;

/// Poses found.
pub type Solutions = heapless::Vec<Isometry3<f64>, MAX_SOLUTIONS>;

/// Poses `T_CM` (map to camera coordinates) that see the points `points_m` in the directions `rays_c` (any length).
#[must_use]
pub fn solve(points_m: &[Vector3<f64>; 3], rays_c: &[Vector3<f64>; 3]) -> Solutions {
    let mut solutions = Solutions::new();
    let Some(base_m) = triangle_frame(points_m) else { return solutions };
    let j = rays_c.map(|r| r.normalize());
    let [p1, p2, p3] = points_m;
    let (a2, b2, c2) = ((p2 - p3).norm_squared(), (p1 - p3).norm_squared(), (p1 - p2).norm_squared());
    let (cos_a, cos_b, cos_g) = (j[1].dot(&j[2]), j[0].dot(&j[2]), j[0].dot(&j[1]));
    let d = (a2 - c2) / b2;
    let s = (a2 + c2) / b2;
    let (cb, ab) = (c2 / b2, a2 / b2);
    let quartic = [
        (1.0 + d) * (1.0 + d) - 4.0 * ab * cos_g * cos_g,
        4.0 * (-d * (1.0 + d) * cos_b + 2.0 * ab * cos_g * cos_g * cos_b - (1.0 - s) * cos_a * cos_g),
        2.0 * (d * d - 1.0 + 2.0 * d * d * cos_b * cos_b + 2.0 * (1.0 - cb) * cos_a * cos_a
            - 4.0 * s * cos_a * cos_b * cos_g
            + 2.0 * (1.0 - ab) * cos_g * cos_g),
        4.0 * (d * (1.0 - d) * cos_b - (1.0 - s) * cos_a * cos_g + 2.0 * cb * cos_a * cos_a * cos_b),
        (d - 1.0) * (d - 1.0) - 4.0 * cb * cos_a * cos_a,
    ];
    for &v in real_roots(quartic, 1.0 / MAX_RATIO, MAX_RATIO).as_slice() {
        let u = ((d - 1.0) * v * v - 2.0 * d * cos_b * v + 1.0 + d) / (2.0 * (cos_g - v * cos_a));
        let s1 = (b2 / (1.0 + v * v - 2.0 * v * cos_b)).sqrt();
        // Written so that a NaN fails.
        if !(u > 0.0 && u.is_finite() && s1 > 0.0 && s1.is_finite()) {
            continue;
        }
        let seen = [j[0] * s1, j[1] * (u * s1), j[2] * (v * s1)];
        if let Some(base_c) = triangle_frame(&seen) {
            let rotation = Rotation3::from_matrix_unchecked(base_c * base_m.transpose());
            let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
            let translation = seen[0] - rotation * p1;
            // Four roots at most, so there is room.
            let _ = solutions.push(Isometry3::from_parts(Translation3::from(translation), rotation));
        }
    }
    solutions
}

/// An orthonormal frame tied to a triangle; `None` when it is next to a line.
fn triangle_frame(points: &[Vector3<f64>; 3]) -> Option<Matrix3<f64>> {
    let first = points[1] - points[0];
    let normal = first.cross(&(points[2] - points[0]));
    let (x, z) = (first.try_normalize(1e-6)?, normal.try_normalize(1e-6)?);
    Some(Matrix3::from_columns(&[x, z.cross(&x), z]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::exp_so3;
    use plumbline_config::Random;

    #[test]
    fn the_true_pose_is_among_the_solutions() {
        let mut random = Random::new(1);
        let mut vector = |scale: f64| Vector3::from_fn(|_, _| scale * (2.0 * random.unit() - 1.0));
        for _ in 0..1000 {
            let truth = Isometry3::from_parts(vector(3.0).into(), exp_so3(&vector(3.0)));
            let seen: [_; 3] = std::array::from_fn(|_| vector(2.0) + Vector3::new(0.0, 0.0, 4.0));
            let points = seen.map(|p| truth.inverse_transform_point(&p.into()).coords);
            let best = solve(&points, &seen)
                .iter()
                .map(|s| {
                    (s.translation.vector - truth.translation.vector).norm()
                        + s.rotation.angle_to(&truth.rotation)
                })
                .fold(f64::INFINITY, f64::min);
            assert!(best < 1e-5, "{best}");
        }
    }

    #[test]
    fn points_on_a_line_have_no_pose() {
        let points = [0.0, 1.0, 2.0].map(|x| Vector3::new(x, 0.0, 4.0));
        assert!(solve(&points, &points).is_empty());
    }
}
