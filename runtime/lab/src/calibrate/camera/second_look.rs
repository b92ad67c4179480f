//! The second look at an image: every corner of the board that should be in it, by what is known of cameras and board so
//! far, refined to a fraction of a pixel, and believed where it is found near where it should be.
//!
//! Most corners come in by this: of the tags of an AprilGrid only some are decoded at first sight. The distance up to which
//! a corner is believed is Kalibr's.

use super::adjust::{Cameras, Corner};
use super::detector::{Detector, Fault};
use super::target::Target;
use nalgebra::{Isometry3, Vector2};
use plumbline_config::ImageView;

/// Corners this near to the edge of the image are not looked for, px.
const BORDER_PX: f64 = 4.0;
/// Square of the distance from where a corner should be up to which it is believed, px².
const MOST_MOVED_PX2: f64 = 1.5;
/// Windows for the search of a corner, to each side, px.
const HALF_WINDOWS_PX: std::ops::RangeInclusive<usize> = 2..=6;
/// Windows reach this share of the way to the nearest other corner. On the real images of the tests 0.35, 0.45 and 0.5 left
/// 0.29, 0.27 and 0.265 px RMS (of what is within four medians); windows of 2 px for all left 0.35 px.
const WINDOW_SHARE: f64 = 0.5;
/// The contrast of a corner must be at least this share of the median of all corners in its image: where the board is
/// covered there may be none, and what is looked for stays where it is expected.
const LEAST_CONTRAST: f64 = 0.1;

/// The corners of the board in the image of camera `index`.
///
/// # Errors
/// When the detector fails.
pub fn look(
    detector: &Detector,
    target: &Target,
    image: &ImageView<'_>,
    cameras: &Cameras,
    index: usize,
    pose_c0_t: &Isometry3<f64>,
) -> Result<Vec<Corner>, Fault> {
    let expected = expected_px(target, cameras, index, pose_c0_t);
    let all: Vec<Vector2<f64>> = expected.iter().map(|corner| corner.px).collect();
    let window = half_window_px(target, &all);
    let found = (detector.refine)(image, &all, window)?;
    let contrasts: Vec<f64> = found.iter().map(|px| contrast(image, px, window)).collect();
    let mut sorted = contrasts.clone();
    sorted.sort_by(f64::total_cmp);
    let least = sorted.get(sorted.len() / 2).map_or(0.0, |median| LEAST_CONTRAST * median);
    let believed = expected.iter().zip(&found).zip(&contrasts);
    Ok(believed
        .filter(|((corner, px), contrast)| {
            (*px - corner.px).norm_squared() <= MOST_MOVED_PX2 && **contrast > least
        })
        .map(|((corner, px), _)| Corner { number: corner.number, px: *px })
        .collect())
}

/// Where the corners of the board should be, of those that are well inside the image.
fn expected_px(target: &Target, cameras: &Cameras, index: usize, pose_c0_t: &Isometry3<f64>) -> Vec<Corner> {
    let model = &cameras.models[index];
    let corner = |(number, point): (usize, Vector2<f64>)| {
        let px = model.project(&cameras.seen_from(index, pose_c0_t, &point))?;
        model.contains(&px, BORDER_PX).then_some(Corner { number, px })
    };
    target.corners_m().into_iter().enumerate().filter_map(corner).collect()
}

/// Reach of the windows, so that no other corner is in them.
pub(super) fn half_window_px(target: &Target, corners_px: &[Vector2<f64>]) -> usize {
    let to_nearest = |(k, px): (usize, &Vector2<f64>)| {
        let others = corners_px.iter().enumerate().filter(|(other, _)| *other != k);
        others.map(|(_, other)| (other - px).norm()).fold(f64::INFINITY, f64::min)
    };
    let nearest = corners_px.iter().enumerate().map(to_nearest).fold(f64::INFINITY, f64::min);
    // In a ChArUco board the corner of a marker is nearer than the next corner of the chessboard.
    let nearest = match *target {
        Target::Charuco { square_m, marker_m, .. } => 0.9 * nearest * (square_m - marker_m) / square_m,
        _ => nearest,
    };
    // A float to usize saturates.
    ((WINDOW_SHARE * nearest) as usize).clamp(*HALF_WINDOWS_PX.start(), *HALF_WINDOWS_PX.end())
}

/// The smaller eigenvalue of the sum of the gradients' squares about a pixel: how well a corner is held in both directions.
fn contrast(image: &ImageView<'_>, px: &Vector2<f64>, half_window: usize) -> f64 {
    let (x, y) = (px.x.round(), px.y.round());
    let reach = half_window as f64 + 1.0;
    let is_inside =
        x >= reach && y >= reach && x + reach < image.width() as f64 && y + reach < image.height() as f64;
    if !is_inside {
        return 0.0;
    }
    let (x, y) = (x as usize, y as usize);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for v in y - half_window..=y + half_window {
        let (above, row, below) = (image.row(v - 1), image.row(v), image.row(v + 1));
        for u in x - half_window..=x + half_window {
            let gx = f64::from(row[u + 1]) - f64::from(row[u - 1]);
            let gy = f64::from(below[u]) - f64::from(above[u]);
            xx += gx * gx;
            xy += gx * gy;
            yy += gy * gy;
        }
    }
    let (half_sum, half_difference) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    half_sum - half_difference.hypot(xy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::GrayImage;

    #[test]
    fn contrast_tells_a_corner_from_an_edge_and_a_wall() {
        let image = |light: fn(usize, usize) -> bool| {
            let pixels = (0..400).map(|k| if light(k % 20, k / 20) { 200 } else { 40 }).collect();
            let image = GrayImage::from_pixels(20, 20, pixels).unwrap();
            contrast(&image.view(), &Vector2::new(9.6, 10.2), 3)
        };
        let corner = image(|x, y| (x < 10) != (y < 10));
        assert!(corner > 1e4 && image(|x, _| x < 10) < 1e-6 * corner && image(|_, _| true) == 0.0);
        let small = GrayImage::new(6, 6);
        assert_eq!(contrast(&small.view(), &Vector2::new(3.0, 3.0), 3), 0.0);
        assert_eq!(contrast(&small.view(), &Vector2::new(f64::NAN, -1e9), 3), 0.0);
    }

    #[test]
    fn windows_keep_clear_of_other_corners() {
        let chessboard: Target = "chessboard:9x6:0.025".parse().unwrap();
        let apart = |px: f64| [Vector2::zeros(), Vector2::new(px, 0.0), Vector2::new(0.0, 3.0 * px)];
        assert_eq!(half_window_px(&chessboard, &apart(100.0)), 6);
        assert_eq!(half_window_px(&chessboard, &apart(10.0)), 5);
        assert_eq!(half_window_px(&chessboard, &apart(3.0)), 2);
        assert_eq!(half_window_px(&chessboard, &[]), 6);
        let charuco: Target = "charuco:7x6:0.1:0.07".parse().unwrap();
        assert_eq!(half_window_px(&charuco, &apart(40.0)), 5);
    }
}
