//! The pose of a camera from two points when gravity is known: position and yaw, four unknowns from four equations
//! (Kukelova, Bujnak and Pajdla 2010, "Closed-form solutions to minimal absolute pose problems with known vertical
//! direction").
//!
//! With rays `f` turned so that z is up, `s_i f_i = Rz(yaw) p_i + t`. The difference of the two points has the same
//! height and the same horizontal length on both sides: `s1 f1z - s2 f2z = dz` and
//! `|s1 f1xy - s2 f2xy|^2 = |dxy|^2`, a quadratic equation after elimination of the distance with the larger `fz`.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2, Vector3};

/// Most poses that two points allow.
pub const MAX_SOLUTIONS: usize = 2;

/// Poses found.
pub type Solutions = heapless::Vec<Isometry3<f64>, MAX_SOLUTIONS>;

/// Poses `T_CM` (map to camera coordinates) that see `points_m` in the directions `rays_c`; `rot_l_c` turns camera
/// coordinates until z points up, with any yaw.
pub fn solve(
    points_m: &[Vector3<f64>; 2],
    rays_c: &[Vector3<f64>; 2],
    rot_l_c: &UnitQuaternion<f64>,
) -> Solutions {
    let mut solutions = Solutions::new();
    let mut f = rays_c.map(|r| rot_l_c * r.normalize());
    let mut p = *points_m;
    if f[0].z.abs() < f[1].z.abs() {
        f.swap(0, 1);
        p.swap(0, 1);
    }
    let d = p[0] - p[1];
    // s1 = a + b s2, so the horizontal difference is g + h s2.
    let (a, b) = (d.z / f[0].z, f[1].z / f[0].z);
    let g = f[0].xy() * a;
    let h = f[0].xy() * b - f[1].xy();
    let (qa, qb, qc) = (h.norm_squared(), g.dot(&h), g.norm_squared() - d.xy().norm_squared());
    let discriminant = qb * qb - qa * qc;
    if !(qa > 1e-12 && discriminant >= 0.0) {
        return solutions;
    }
    let root = discriminant.sqrt();
    for s2 in [(-qb + root) / qa, (-qb - root) / qa] {
        let s1 = a + b * s2;
        if !(s1 > 0.0 && s2 > 0.0) {
            continue;
        }
        let Some(yaw) = turn(&d.xy(), &(g + h * s2)) else { continue };
        let rotation = rot_l_c.inverse() * yaw;
        let translation = rot_l_c.inverse() * (f[0] * s1) - rotation * p[0];
        let _ = solutions.push(Isometry3::from_parts(Translation3::from(translation), rotation));
    }
    solutions
}

/// The rotation about z that takes the direction of `from` to that of `to`.
fn turn(from: &Vector2<f64>, to: &Vector2<f64>) -> Option<UnitQuaternion<f64>> {
    let scale = from.norm() * to.norm();
    if scale < 1e-9 {
        return None;
    }
    let (cos, sin) = (from.dot(to) / scale, from.perp(to) / scale);
    // Half angles without a trigonometric function: q = (1 + cos, sin) normalized, and half a turn where that vanishes.
    let q = if cos > -1.0 + 1e-12 {
        nalgebra::Quaternion::new(1.0 + cos, 0.0, 0.0, sin)
    } else {
        nalgebra::Quaternion::new(0.0, 0.0, 0.0, 1.0)
    };
    Some(UnitQuaternion::new_normalize(q))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::exp_so3;
    use plumbline_config::Random;

    #[test]
    fn the_true_pose_is_among_the_solutions() {
        let mut random = Random::new(2);
        let mut vector = |scale: f64| Vector3::from_fn(|_, _| scale * (2.0 * random.unit() - 1.0));
        for _ in 0..1000 {
            let pose_m_c = Isometry3::from_parts(vector(3.0).into(), exp_so3(&vector(3.0)));
            let seen: [_; 2] = std::array::from_fn(|_| vector(2.0) + Vector3::new(0.0, 0.0, 4.0));
            let points = seen.map(|p| (pose_m_c * nalgebra::Point3::from(p)).coords);
            // What is known of the attitude: all but a turn about the vertical.
            let rot_l_c = exp_so3(&Vector3::new(0.0, 0.0, vector(3.0).x)) * pose_m_c.rotation;
            let truth = pose_m_c.inverse();
            let best = solve(&points, &seen, &rot_l_c)
                .iter()
                .map(|s| {
                    (s.translation.vector - truth.translation.vector).norm()
                        + s.rotation.angle_to(&truth.rotation)
                })
                .fold(f64::INFINITY, f64::min);
            assert!(best < 1e-6, "{best}");
        }
    }

    #[test]
    fn one_point_twice_has_no_pose() {
        let points = [Vector3::new(1.0, 2.0, 4.0); 2];
        assert!(solve(&points, &points, &UnitQuaternion::identity()).is_empty());
    }
}
