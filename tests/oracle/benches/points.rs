//! Time of tracking 200 points from frame to frame and from left to right over shared pyramids: ours and
//! OpenCV's on the same real images, in one run, on one thread.

use criterion::{BenchmarkGroup, Criterion, SamplingMode, measurement::WallTime};
use nalgebra::Vector2;
use plumbline_config::GrayImage;
use plumbline_drivers::{EurocDataset, EurocOptions, StereoSource};
use plumbline_oracle::flow::{Flow, OpenCv, Ours, corners};
use plumbline_oracle::lines::{median, quantile};
use plumbline_tests::shared;
use std::error::Error;
use std::hint::black_box;
use std::time::{Duration, Instant};

const CLIP: &str = "euroc/V1_01_easy_clip";
/// Points of a frame.
const POINTS: usize = 200;

type Pair = (GrayImage, GrayImage);

fn measure<F: Flow>(
    group: &mut BenchmarkGroup<'_, WallTime>,
    name: &str,
    mut flow: F,
    frames: &[Pair],
    points: &[Vec<Vector2<f32>>],
) -> (f64, f64) {
    let mut times_ms = Vec::new();
    let mut found = 0;
    group.bench_function(name, |bencher| {
        bencher.iter_custom(|iterations| {
            let mut total = Duration::ZERO;
            for _ in 0..iterations {
                found = 0;
                let mut previous = flow.prepare(&frames[0].0).expect("the image is sound");
                for ((left, right), points) in frames[1..].iter().zip(points) {
                    let begin = Instant::now();
                    let (left, right) = (flow.prepare(left), flow.prepare(right));
                    let (left, right) = (left.expect("is sound"), right.expect("is sound"));
                    let now = flow.follow(&previous, &left, black_box(points)).expect("points are inside");
                    let kept: Vec<_> = now.into_iter().flatten().collect();
                    let across = flow.follow(&left, &right, &kept).expect("points are inside");
                    let took = begin.elapsed();
                    found += across.iter().flatten().count();
                    times_ms.push(took.as_secs_f64() * 1e3);
                    total += took;
                    previous = left;
                }
            }
            total
        });
    });
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
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("points");
    group.sampling_mode(SamplingMode::Flat).sample_size(10).measurement_time(Duration::from_secs(10));
    let ours = measure(&mut group, "ours", Ours, &frames, &points);
    let theirs = measure(&mut group, "OpenCV, window 21", OpenCv { window_px: 21 }, &frames, &points);
    let small = measure(&mut group, "OpenCV, window 13", OpenCv { window_px: 13 }, &frames, &points);
    group.finish();
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
