//! Time of line extraction per image: ours and OpenCV's detectors on the same real images, in one run.
//!
//! A round is all images; the time of an image is the median over rounds, and the table has the median over images.

use plumbline_config::GrayImage;
use plumbline_config::options::LinesConfig;
use plumbline_estimator::lines::descriptor::Describer;
use plumbline_estimator::lines::matching::LineMatcher;
use plumbline_estimator::lines::{LineExtractor, Segment};
use plumbline_oracle::lines::detectors::unfiltered;
use plumbline_oracle::lines::images::left_images;
use plumbline_oracle::lines::{Detector, median, quantile};
use plumbline_tests::shared;
use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

const CLIP: &str = "euroc/V1_01_easy_clip";
const ROUNDS: usize = 20;

/// A row of the table.
struct Row {
    name: &'static str,
    median_ms: f64,
    /// Median over images of the least time: what other work on the machine disturbs least.
    least_ms: f64,
    /// Mean number per image.
    segments: f64,
}

fn detectors(size: (usize, usize)) -> opencv::Result<Vec<Detector>> {
    Ok(vec![
        Detector::ours("ours", size, &LinesConfig::default()),
        Detector::ours("ours, all", size, &unfiltered()),
        Detector::lsd()?,
        Detector::lsd_half()?,
        Detector::edge_drawing()?,
        Detector::fast_line_detector()?,
    ])
}

fn measure(detector: &mut Detector, images: &[GrayImage]) -> opencv::Result<Row> {
    let mut count = 0;
    for image in images {
        count += detector.detect(image)?.len();
    }
    let mut times_ms = vec![Vec::new(); images.len()];
    for _ in 0..ROUNDS {
        for (image, times_ms) in images.iter().zip(&mut times_ms) {
            let begin = Instant::now();
            let _ = black_box(detector.detect(black_box(image)));
            times_ms.push(begin.elapsed().as_secs_f64() * 1e3);
        }
    }
    let over_images =
        |of: fn(&[f64]) -> f64| median(&times_ms.iter().map(|times_ms| of(times_ms)).collect::<Vec<_>>());
    Ok(Row {
        name: detector.name,
        median_ms: over_images(median),
        least_ms: over_images(|times_ms| quantile(times_ms, 0.0)),
        segments: count as f64 / images.len() as f64,
    })
}

fn print(rows: &[Row], images: usize) {
    println!("\n{images} images of {CLIP}, one thread\n");
    println!("| detector | median ms per image | against ours | least ms | against ours | segments |");
    println!("|---|---:|---:|---:|---:|---:|");
    for row in rows {
        let [median, least] = [row.median_ms / rows[0].median_ms, row.least_ms / rows[0].least_ms];
        println!(
            "| {} | {:.2} | {median:.2} | {:.2} | {least:.2} | {:.0} |",
            row.name, row.median_ms, row.least_ms, row.segments
        );
    }
}

/// Median time of `work`, ms.
fn timed<T>(mut work: impl FnMut() -> T) -> f64 {
    let times_ms: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let begin = Instant::now();
            black_box(work());
            begin.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    median(&times_ms)
}

/// Describing and matching of the 100 clearest segments of consecutive images; geometry admits every pair,
/// which is the worst that can happen.
fn measure_description(images: &[GrayImage]) -> Result<(), Box<dyn Error>> {
    let [first, second] = images.first_chunk::<2>().ok_or("two images are needed")?;
    let options = unfiltered();
    let mut extractor = LineExtractor::new(first.width(), first.height(), &options);
    let describer = Describer::default();
    let mut described = Vec::new();
    for image in [first, second] {
        let clearest: Vec<Segment> =
            extractor.extract(&image.view()).ok_or("size")?.iter().take(100).copied().collect();
        let gradients = extractor.gradients();
        let describe_all =
            || -> Vec<_> { clearest.iter().map(|s| describer.describe(gradients, s)).collect() };
        described.push(describe_all());
        println!("description of {}: {:.3} ms", clearest.len(), timed(describe_all));
    }
    let mut matcher = LineMatcher::new(&options, 2 * options.max_segments);
    let matching_ms = timed(|| matcher.pairs(&described[0], &described[1], |_, _| true).len());
    println!("matching, every pair admitted: {matching_ms:.3} ms");
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let Some(shared) = shared(CLIP) else { return Ok(()) };
    opencv::core::set_num_threads(1)?;
    let images = left_images(&shared.join(CLIP))?;
    let size = images.first().map_or((0, 0), |image| (image.width(), image.height()));
    let mut detectors = detectors(size)?;
    let rows =
        detectors.iter_mut().map(|detector| measure(detector, &images)).collect::<Result<Vec<_>, _>>()?;
    measure_description(&images)?;
    print(&rows, images.len());
    Ok(())
}
