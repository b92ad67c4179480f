//! Work and time are bounded, whatever the image, and the outcome is the same each time.

use plumbline_config::GrayImage;
use plumbline_config::options::LinesConfig;
use plumbline_estimator::lines::{ExtractionFigures, LineExtractor, Segment};
use plumbline_oracle::lines::images::{Adversary, left_images};
use plumbline_oracle::lines::{median, quantile};
use plumbline_tests::shared;
use std::time::Instant;

const SIZE: (usize, usize) = (752, 480);

fn extractor() -> LineExtractor {
    LineExtractor::new(SIZE.0, SIZE.1, &LinesConfig::default())
}

fn adversaries() -> Vec<Adversary> {
    use Adversary::*;
    let mut all = vec![Flat(0), Flat(128), Flat(255)];
    all.extend([2.0, 5.0, 10.0, 20.0, 50.0, 120.0].map(Noise));
    all.extend([2, 3, 5, 9].map(Blobs));
    for angle in [0.0, 0.1, 0.5, 0.785] {
        all.extend([2.0, 3.0, 4.0, 5.0, 8.0, 16.0, 40.0].map(|side| Checkerboard(side, angle)));
        all.extend([3.0, 4.0, 6.0, 9.0, 20.0].map(|period| Grating(period, angle)));
    }
    all.extend([4.0, 8.0, 20.0].map(Rings));
    all.extend([50, 500, 5000].map(Lines));
    all.extend([50, 500, 5000].map(Shapes));
    all.extend([0.001, 0.01, 0.1, 0.5].map(SaltAndPepper));
    all
}

fn outcome(extractor: &mut LineExtractor, image: &GrayImage) -> (Vec<Segment>, ExtractionFigures) {
    let segments = extractor.extract(&image.view()).unwrap().to_vec();
    (segments, extractor.figures())
}

#[test]
fn the_budget_is_kept_and_the_outcome_repeats() {
    let options = LinesConfig::default();
    // Work is checked before each segment, which is as long as the image at most.
    let limit = options.max_visits + SIZE.0.max(SIZE.1);
    let mut used = extractor();
    let mut most = (0, Adversary::Flat(0));
    for adversary in adversaries() {
        for seed in 0..3 {
            let image = adversary.render(SIZE.0, SIZE.1, seed);
            // An extractor that has seen other images, the same again, and a new one.
            let (segments, figures) = outcome(&mut used, &image);
            assert_eq!(
                (&segments, figures),
                (&outcome(&mut used, &image).0, used.figures()),
                "{adversary:?}"
            );
            assert_eq!((segments, figures), outcome(&mut extractor(), &image), "{adversary:?}");
            assert!(figures.visits as usize <= limit, "{adversary:?}: {figures:?}");
            assert!(figures.raw as usize <= options.max_raw && figures.kept as usize <= options.max_segments);
            if figures.visits > most.0 {
                most = (figures.visits, adversary);
            }
        }
    }
    println!("most visits: {} by {:?}, limit {limit}", most.0, most.1);
}

#[test]
fn an_image_without_edges_has_no_segments() {
    for level in [0, 1, 127, 254, 255] {
        let image = Adversary::Flat(level).render(SIZE.0, SIZE.1, 0);
        let (segments, figures) = outcome(&mut extractor(), &image);
        assert!(segments.is_empty() && figures == ExtractionFigures::default(), "{level}: {figures:?}");
    }
}

/// Time of an image, ms: the least of `runs`, as what comes on top is the machine's.
fn time_ms(extractor: &mut LineExtractor, image: &GrayImage, runs: usize) -> f64 {
    let run = |_| {
        let begin = Instant::now();
        extractor.extract(&image.view()).unwrap();
        begin.elapsed().as_secs_f64() * 1e3
    };
    (0..runs).map(run).fold(f64::INFINITY, f64::min)
}

fn print_times(name: &str, times_ms: &[f64]) {
    let [median, p99, max] = [0.5, 0.99, 1.0].map(|at| quantile(times_ms, at));
    println!("| {name} | {} | {median:.2} | {p99:.2} | {max:.2} |", times_ms.len());
}

/// Adversary number `seed`.
fn drawn(seed: u64) -> GrayImage {
    Adversary::drawn(seed).render(SIZE.0, SIZE.1, seed)
}

#[test]
#[ignore = "minutes; run by `make soak`"]
fn soak_ten_thousand_adversaries_take_no_longer_than_three_images() {
    const CLIP: &str = "euroc/V1_01_easy_clip";
    let Some(shared) = shared(CLIP) else { return };
    let mut extractor = extractor();
    let real = left_images(&shared.join(CLIP)).unwrap();
    let mut first = Vec::with_capacity(10_000);
    for seed in 0..10_000 {
        first.push((time_ms(&mut extractor, &drawn(seed), 1), seed));
    }
    let all_ms: Vec<f64> = first.iter().map(|(ms, _)| *ms).collect();
    // The machine may have been busy: the slowest are measured again, side by side with the real ones.
    first.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut real_ms = Vec::new();
    let mut slowest = Vec::new();
    for (seed, image) in first.iter().map(|(_, seed)| *seed).zip(&real) {
        real_ms.push(time_ms(&mut extractor, image, 20));
        slowest.push((time_ms(&mut extractor, &drawn(seed), 20), seed));
    }
    slowest.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!("| images | number | median ms | p99 ms | max ms |\n|---|---:|---:|---:|---:|");
    print_times("real, least of 20 runs", &real_ms);
    print_times("adversarial, one run", &all_ms);
    print_times("slowest of them, least of 20 runs", &slowest.iter().map(|(ms, _)| *ms).collect::<Vec<_>>());
    let limit_ms = 3.0 * median(&real_ms);
    for (ms, seed) in &slowest[..5] {
        println!("{ms:.2} ms: {:?}, number {seed}; limit {limit_ms:.2} ms", Adversary::drawn(*seed));
    }
    assert!(slowest[0].0 <= limit_ms);
}
