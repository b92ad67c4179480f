//! A first guess of a camera: the focal length under which its views look most like views of a plane.
//!
//! For each of a row of focal lengths, with the principal point in the middle of the image and no distortion, the board's
//! pose in every view is taken from its homography, and the median distance of corners from where they are then projected to
//! is compared. The adjustment finds the rest from there. No closed form (Zhang 2000) is needed, and the same works for
//! fisheye lenses.

use super::adjust::{Cameras, Corner};
use super::plane::pose_of_board;
use nalgebra::{Isometry3, Vector2};
use plumbline_config::CameraModel;
use plumbline_config::camera::Distortion;

/// Focal lengths that are tried, in widths of the image: lenses of 150 to 12 degrees.
const SHORTEST: f64 = 0.2;
const LONGEST: f64 = 5.0;
const TRIED: usize = 60;

/// A first guess of a camera of `size_px`; `None` when no view has a pose under any.
pub fn first_guess(
    lens: Distortion,
    size_px: (usize, usize),
    points_m: &[Vector2<f64>],
    views: &[&[Corner]],
) -> Option<CameraModel> {
    let guess = |k: usize| {
        let ratio = SHORTEST * (LONGEST / SHORTEST).powf(k as f64 / (TRIED - 1) as f64);
        camera(lens, size_px, ratio * size_px.0 as f64)
    };
    let guesses = (0..TRIED).map(guess);
    let judged = guesses.filter_map(|model| Some((misfit_px(&model, points_m, views)?, model)));
    judged.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, model)| model)
}

fn camera(distortion: Distortion, (width_px, height_px): (usize, usize), focal_px: f64) -> CameraModel {
    let middle = |side: usize| 0.5 * (side as f64 - 1.0);
    // The focal length is that of the pinhole that the lens is near its axis.
    let paraxial = distortion.distort(&Vector2::zeros()).1.m11;
    CameraModel {
        width_px,
        height_px,
        focal_px: Vector2::repeat(focal_px / paraxial),
        centre_px: Vector2::new(middle(width_px), middle(height_px)),
        distortion,
    }
}

/// The pose `T_CT` of the board in a view.
pub fn pose(model: &CameraModel, points_m: &[Vector2<f64>], corners: &[Corner]) -> Option<Isometry3<f64>> {
    let seen: Vec<_> = corners.iter().map(|corner| (points_m[corner.number], corner.px)).collect();
    pose_of_board(model, &seen)
}

/// The median over the views of the root of their mean squared distances, px; views that have no pose count as the worst.
fn misfit_px(model: &CameraModel, points_m: &[Vector2<f64>], views: &[&[Corner]]) -> Option<f64> {
    let cameras = Cameras::single(*model);
    let of_view = |corners: &&[Corner]| {
        let pose_c_t = pose(model, points_m, corners)?;
        let mut sum = 0.0;
        for corner in corners.iter() {
            let px = model.project(&cameras.seen_from(0, &pose_c_t, &points_m[corner.number]))?;
            sum += (px - corner.px).norm_squared();
        }
        Some((sum / corners.len() as f64).sqrt())
    };
    let mut misfits: Vec<f64> = views.iter().map(|view| of_view(view).unwrap_or(f64::INFINITY)).collect();
    misfits.sort_by(f64::total_cmp);
    misfits.get(misfits.len() / 2).copied().filter(|misfit| misfit.is_finite())
}

/// The pose `T_C1C0` that most views agree on: the one from which the others are least far, m and rad alike.
pub fn pose_between(poses: &[(Isometry3<f64>, Isometry3<f64>)]) -> Option<Isometry3<f64>> {
    let each: Vec<Isometry3<f64>> =
        poses.iter().map(|(pose_c0_t, pose_c1_t)| pose_c1_t * pose_c0_t.inverse()).collect();
    let distance = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
        let between = a.inverse() * b;
        between.translation.vector.norm() + between.rotation.angle()
    };
    let loneliness = |a: &Isometry3<f64>| each.iter().map(|b| distance(a, b)).sum::<f64>();
    each.iter().copied().min_by(|a, b| loneliness(a).total_cmp(&loneliness(b)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::camera::lens::lens_named;
    use nalgebra::Vector3;

    fn views(model: &CameraModel, points: &[Vector2<f64>]) -> Vec<Vec<Corner>> {
        let cameras = Cameras::single(*model);
        let view = |k: i32| {
            let tilt = Vector3::new(0.4 * f64::from(k % 3 - 1), 0.5 * f64::from(k % 2) - 0.25, 0.3);
            let pose = Isometry3::new(Vector3::new(-0.3, -0.25, 0.9 + 0.05 * f64::from(k)), tilt);
            let corner = |(number, point): (usize, &Vector2<f64>)| {
                Some(Corner { number, px: model.project(&cameras.seen_from(0, &pose, point))? })
            };
            points.iter().enumerate().filter_map(corner).collect()
        };
        (0..6).map(view).collect()
    }

    #[test]
    fn the_focal_length_is_guessed_to_a_fifth_for_every_lens() {
        let points: Vec<Vector2<f64>> =
            (0..48).map(|k| Vector2::new(f64::from(k % 8) * 0.08, f64::from(k / 8) * 0.08)).collect();
        let lenses: [(&str, f64, &[f64]); 7] = [
            ("radtan", 458.0, &[-0.28, 0.07]),
            ("radtan", 1400.0, &[0.05]),
            ("equidistant", 290.0, &[-0.01, 0.02]),
            ("rational", 400.0, &[0.3, -0.1, 0.0, 0.0, 0.02, 0.6, 0.1, 0.03]),
            ("omni", 290.0, &[1.4, -0.1]),
            ("eucm", 290.0, &[0.6, 1.1]),
            ("double-sphere", 290.0, &[-0.2, 0.6]),
        ];
        for (name, focal_px, k) in lenses {
            let lens = lens_named(name);
            let mut model = camera(lens, (752, 480), focal_px);
            model.distortion = lens.with_coefficients(k);
            // As many pixels to a radian near the axis.
            model.focal_px = Vector2::repeat(focal_px / model.distortion.distort(&Vector2::zeros()).1.m11);
            let views = views(&model, &points);
            let views: Vec<&[Corner]> = views.iter().map(Vec::as_slice).collect();
            let guess = first_guess(lens, (752, 480), &points, &views).unwrap();
            let near_axis = guess.focal_px.x * guess.distortion.distort(&Vector2::zeros()).1.m11;
            let ratio = near_axis / focal_px;
            assert!((0.8..1.25).contains(&ratio), "{name} {focal_px}: {ratio}");
        }
    }

    #[test]
    fn the_pose_between_the_cameras_is_that_of_the_many() {
        let between = Isometry3::new(Vector3::new(-0.1, 0.0, 0.0), Vector3::new(0.0, 0.02, 0.0));
        let board = |k: f64| Isometry3::new(Vector3::new(0.1 * k, 0.0, 1.0), Vector3::new(0.1 * k, 0.0, 0.0));
        let mut poses: Vec<_> =
            (0..5).map(|k| (board(f64::from(k)), between * board(f64::from(k)))).collect();
        poses.push((board(1.0), Isometry3::identity()));
        let found = pose_between(&poses).unwrap();
        assert!((found.inverse() * between).translation.vector.norm() < 1e-12);
        assert_eq!(pose_between(&[]), None);
    }
}
