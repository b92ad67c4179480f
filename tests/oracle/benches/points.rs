//! Time of tracking 200 points from frame to frame and from left to right over shared pyramids: ours and
//! OpenCV's on the same real images, in one run, on one thread.

use nalgebra::Vector2;
use plumbline_config::GrayImage;
use plumbline_drivers::{EurocDataset, EurocOptions, StereoSource};
use plumbline_oracle::flow::{Flow, OpenCv, Ours, corners};
use plumbline_oracle::lines::{median, quantile};
use plumbline_tests::shared;
use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

const CLIP: &str = "euroc/V1_01_easy_clip";
/// Passes over the clip.
const ROUNDS: usize = 5;
/// Points of a frame.
const POINTS: usize = 200;

type Pair = (GrayImage, GrayImage);

fn measure<F: Flow>(name: &str, mut flow: F, frames: &[Pair], points: &[Vec<Vector2<f32>>]) -> (f64, f64) {
    let mut times_ms = Vec::new();
    let mut found = 0;
    for _ in 0..ROUNDS {
        found = 0;
        let mut previous = flow.prepare(&frames[0].0).expect("the image is sound");
        for ((left, right), points) in frames[1..].iter().zip(points) {
            let begin = Instant::now();
            let (left, right) = (flow.prepare(left), flow.prepare(right));
            let (left, right) = (left.expect("is sound"), right.expect("is sound"));
            let now = flow.follow(&previous, &left, black_box(points)).expect("points are inside");
            let kept: Vec<_> = now.into_iter().flatten().collect();
            let across = flow.follow(&left, &right, &kept).expect("points are inside");
            times_ms.push(begin.elapsed().as_secs_f64() * 1e3);
            found += across.iter().flatten().count();
            previous = left;
        }
    }
    println!("{name}: {:.0} points found in both, mean per frame", found as f64 / points.len() as f64);
    (median(&times_ms), quantile(&times_ms, 0.0))
}

fn main() -> Result<(), Box<dyn Error>> {
    let Some(data) = shared(CLIP) else { return Ok(()) };
    opencv::core::set_num_threads(1)?;
    let dataset = EurocDataset::open(&data.join(CLIP), &EurocOptions::default())?;
    let (mut stereo, mut frame) = (dataset.stereo(), dataset.new_frame());
    let mut frames = Vec::new();
    while stereo.next_frame(&mut frame)? {
        frames.push((frame.images[0].clone(), frame.images[1].clone()));
    }
    let points = frames.iter().map(|(left, _)| corners(left, POINTS, 20.0)).collect::<Result<Vec<_>, _>>()?;
    let ours = measure("ours", Ours, &frames, &points);
    let theirs = measure("OpenCV, window 21", OpenCv { window_px: 21 }, &frames, &points);
    let small = measure("OpenCV, window 13", OpenCv { window_px: 13 }, &frames, &points);
    println!(
        "\n| {POINTS} points, temporal and stereo, forward and back | median ms a frame | against ours | least ms |"
    );
    println!("|---|---|---|---|");
    for (name, (median, least)) in
        [("ours", ours), ("OpenCV, window 21", theirs), ("OpenCV, window 13", small)]
    {
        println!("| {name} | {median:.2} | {:.2} | {least:.2} |", median / ours.0);
    }
    Ok(())
}
