//! A plane and its image: the homography between them, and the pose of the plane that it gives.
//!
//! The homography by the direct linear transform on normalized points (Hartley and Zisserman, Multiple View Geometry, 4.4.4),
//! the pose by its columns (Zhang 2000, 3.1).

use nalgebra::{
    Isometry3, Matrix3, Rotation3, SMatrix, SVector, SymmetricEigen, Translation3, UnitQuaternion, Vector2,
    Vector3,
};
use plumbline_config::CameraModel;

/// Fewest points of a homography.
const MIN_POINTS: usize = 4;
/// The second smallest eigenvalue of a homography's equations over the largest: below it the points are on one line.
const MIN_SPREAD: f64 = 1e-9;

/// The homography `H` with `H (x, y, 1) ~ (u, v, 1)` for pairs of `(x, y)` and `(u, v)`, by least squares; `None` of fewer
/// than four pairs, or when they are on a line.
pub fn homography(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Matrix3<f64>> {
    if pairs.len() < MIN_POINTS {
        return None;
    }
    let from = normalization(pairs.iter().map(|(a, _)| a))?;
    let to = normalization(pairs.iter().map(|(_, b)| b))?;
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (a, b) in pairs {
        let (p, q) = (from * a.push(1.0), to * b.push(1.0));
        let (u, v) = (q.x, q.y);
        let rows = [
            [p.x, p.y, 1.0, 0.0, 0.0, 0.0, -u * p.x, -u * p.y, -u],
            [0.0, 0.0, 0.0, p.x, p.y, 1.0, -v * p.x, -v * p.y, -v],
        ];
        for row in rows {
            let row = SVector::from(row);
            normal += row * row.transpose();
        }
    }
    let eigen = SymmetricEigen::new(normal);
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    if eigen.eigenvalues[order[1]] < MIN_SPREAD * eigen.eigenvalues[order[8]] {
        return None;
    }
    let h = eigen.eigenvectors.column(order[0]);
    let h = Matrix3::from_fn(|i, j| h[3 * i + j]);
    Some(to.try_inverse()? * h * from)
}

/// The similarity that takes points to the origin, and their mean distance to the root of two.
fn normalization<'a>(points: impl Iterator<Item = &'a Vector2<f64>> + Clone) -> Option<Matrix3<f64>> {
    let count = points.clone().count() as f64;
    let mean = points.clone().sum::<Vector2<f64>>() / count;
    let distance = points.map(|p| (p - mean).norm()).sum::<f64>() / count;
    if !(distance.is_finite() && distance > 0.0) {
        return None;
    }
    let s = std::f64::consts::SQRT_2 / distance;
    Some(Matrix3::new(s, 0.0, -s * mean.x, 0.0, s, -s * mean.y, 0.0, 0.0, 1.0))
}

/// Where a homography takes a point; `None` at infinity.
pub fn transfer(h: &Matrix3<f64>, point: &Vector2<f64>) -> Option<Vector2<f64>> {
    let q = h * point.push(1.0);
    (q.z.abs() > f64::EPSILON).then(|| q.xy() / q.z)
}

/// The pose `T_CT` of a board whose points `(x, y, 0)` are seen at pixels; `None` where there is none before the camera.
pub fn pose_of_board(model: &CameraModel, seen: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Isometry3<f64>> {
    let rays: Vec<(Vector2<f64>, Vector2<f64>)> =
        seen.iter().filter_map(|(point, px)| Some((*point, model.unproject(px)?))).collect();
    let h = homography(&rays)?;
    let scale = 2.0 / (h.column(0).norm() + h.column(1).norm());
    // The board is before the camera.
    let h = h * (if h[(2, 2)] < 0.0 { -scale } else { scale });
    let (first, second): (Vector3<f64>, Vector3<f64>) = (h.column(0).into(), h.column(1).into());
    let rough = Matrix3::from_columns(&[first, second, first.cross(&second)]);
    let svd = rough.svd(true, true);
    let nearest = svd.u? * svd.v_t?;
    if !(nearest.determinant() > 0.5 && h[(2, 2)] > 0.0) {
        return None;
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(nearest));
    Some(Isometry3::from_parts(Translation3::from(Vector3::from(h.column(2))), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::camera::lens::lens_named;

    #[test]
    fn the_pose_of_a_board_is_found_from_its_points() {
        let model = CameraModel {
            width_px: 752,
            height_px: 480,
            focal_px: Vector2::new(458.0, 457.0),
            centre_px: Vector2::new(367.0, 248.0),
            distortion: lens_named("radtan").with_coefficients(&[-0.28, 0.07, 0.0, 0.0]),
        };
        let points: Vec<Vector2<f64>> =
            (0..20).map(|k| Vector2::new(f64::from(k % 5) * 0.1, f64::from(k / 5) * 0.1)).collect();
        for axis_angle in [Vector3::new(0.3, -0.2, 0.5), Vector3::new(3.0, 0.2, 0.1), Vector3::zeros()] {
            let pose = Isometry3::new(Vector3::new(-0.1, 0.05, 0.9), axis_angle);
            let seen: Vec<_> = points
                .iter()
                .map(|p| (*p, model.project(&(pose * nalgebra::Point3::new(p.x, p.y, 0.0)).coords).unwrap()))
                .collect();
            let found = pose_of_board(&model, &seen).unwrap();
            let error = pose.inverse() * found;
            assert!(error.translation.vector.norm() < 1e-8 && error.rotation.angle() < 1e-8, "{error}");
        }
    }

    #[test]
    fn points_on_a_line_and_too_few_points_have_no_homography() {
        let line: Vec<_> =
            (0..8).map(|k| (Vector2::repeat(f64::from(k)), Vector2::new(f64::from(k), 3.0))).collect();
        assert_eq!(homography(&line), None);
        assert_eq!(homography(&line[..3]), None);
        assert_eq!(homography(&[(Vector2::zeros(), Vector2::zeros()); 6]), None);
    }
}
