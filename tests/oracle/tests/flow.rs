//! Our optical flow is at least as accurate as OpenCV's, on real images moved in a known way.

use nalgebra::{Matrix3, Vector2, Vector3};
use opencv::core::{BORDER_REFLECT_101, Mat, Scalar, Size};
use opencv::imgproc::{INTER_LANCZOS4, warp_perspective};
use opencv::prelude::*;
use plumbline_config::GrayImage;
use plumbline_oracle::flow::{Flow, OpenCv, Ours, corners};
use plumbline_oracle::lines::images::left_images;
use plumbline_oracle::lines::quantile;
use plumbline_tests::shared;

const CLIP: &str = "euroc/MH_05_mono_clip";
/// One image of so many is used.
const STRIDE: usize = 30;
/// A point this far from the truth is lost, px.
const LOST_PX: f64 = 1.0;
/// Noise added to the moved image, grey levels.
const NOISE: f64 = 2.0;

/// The motion of the image number `k`: a turn, a change of scale, a shift and a little perspective.
fn motion(k: usize, size: (usize, usize)) -> Matrix3<f64> {
    let (x, y) = (size.0 as f64 / 2.0, size.1 as f64 / 2.0);
    let phase = k as f64 * 1.7;
    let (sin, cos) = (0.03 * phase.sin()).sin_cos();
    let scale = 1.0 + 0.03 * (phase * 1.3).cos();
    let centre = Matrix3::new(1.0, 0.0, -x, 0.0, 1.0, -y, 0.0, 0.0, 1.0);
    let turn = Matrix3::new(
        scale * cos,
        -scale * sin,
        0.0,
        scale * sin,
        scale * cos,
        0.0,
        1e-5 * sin,
        2e-5 * cos,
        1.0,
    );
    let back = Matrix3::new(1.0, 0.0, x + 9.3 * phase.cos(), 0.0, 1.0, y - 7.7 * phase.sin(), 0.0, 0.0, 1.0);
    back * turn * centre
}

fn moved(image: &GrayImage, motion: &Matrix3<f64>, seed: u64) -> GrayImage {
    let (width, height) = (image.width() as i32, image.height() as i32);
    let pixels = Mat::new_rows_cols_with_data(height, width, image.pixels()).unwrap();
    let rows: Vec<Vec<f64>> = (0..3).map(|i| (0..3).map(|j| motion[(i, j)]).collect()).collect();
    let matrix = Mat::from_slice_2d(&rows).unwrap();
    let mut warped = Mat::default();
    let size = Size::new(width, height);
    warp_perspective(
        &pixels,
        &mut warped,
        &matrix,
        size,
        INTER_LANCZOS4,
        BORDER_REFLECT_101,
        Scalar::all(0.0),
    )
    .unwrap();
    let mut state = seed;
    let mut noise = || {
        // The sum of twelve uniform numbers is nearly normal.
        let sum: f64 = (0..12)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1u64 << 53) as f64
            })
            .sum();
        (sum - 6.0) * NOISE
    };
    let noisy = warped
        .data_bytes()
        .unwrap()
        .iter()
        .map(|p| (f64::from(*p) + noise()).round().clamp(0.0, 255.0) as u8);
    GrayImage::from_pixels(image.width(), image.height(), noisy.collect()).unwrap()
}

/// Errors of the points that were found, px, and the share of all that were.
fn errors<F: Flow>(mut flow: F, images: &[GrayImage]) -> (Vec<f64>, f64) {
    let (mut errors, mut asked) = (Vec::new(), 0);
    for (k, image) in images.iter().enumerate() {
        let motion = motion(k, (image.width(), image.height()));
        let points = corners(image, 200, 40.0).unwrap();
        let from = flow.prepare(image).unwrap();
        let to = flow.prepare(&moved(image, &motion, k as u64 + 1)).unwrap();
        asked += points.len();
        for (p, q) in points.iter().zip(flow.follow(&from, &to, &points).unwrap()) {
            let truth = motion * Vector3::new(f64::from(p.x), f64::from(p.y), 1.0);
            let error = q.map(|q| (q.cast::<f64>() - Vector2::new(truth.x, truth.y) / truth.z).norm());
            errors.extend(error.filter(|e| *e < LOST_PX));
        }
    }
    let share = errors.len() as f64 / asked as f64;
    errors.sort_by(f64::total_cmp);
    (errors, share)
}

#[test]
fn it_is_as_accurate_as_that_of_opencv_and_loses_no_more_points() {
    let Some(data) = shared(CLIP) else { return };
    let images: Vec<_> = left_images(&data.join(CLIP)).unwrap().into_iter().step_by(STRIDE).collect();
    let rms = |errors: &[f64]| (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    let (ours, our_share) = errors(Ours, &images);
    let summary = |name: &str, errors: &[f64], share: f64| {
        let (median, p95) = (quantile(errors, 0.5), quantile(errors, 0.95));
        println!(
            "{name}: found {:.1} %, median {median:.3} px, p95 {p95:.3}, rms {:.3}",
            100.0 * share,
            rms(errors)
        );
    };
    summary("ours", &ours, our_share);
    for window_px in [21, 13] {
        let (theirs, their_share) = errors(OpenCv { window_px }, &images);
        summary(&format!("OpenCV, window {window_px}"), &theirs, their_share);
        assert!(rms(&ours) <= rms(&theirs), "window {window_px}");
        assert!(our_share >= their_share - 0.01, "window {window_px}: {our_share} against {their_share}");
    }
}
