//! Against segments marked by hand: York Urban (Denis et al. 2008).

use plumbline_oracle::lines::agreement::covered_share;
use plumbline_oracle::lines::detectors::unfiltered;
use plumbline_oracle::lines::images::{MarkedImage, marked_images};
use plumbline_oracle::lines::{Detector, Line, longest_first};
use plumbline_tests::shared;

/// Recall and precision, means over the images.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    count: f64,
    length_px: f64,
    recall: f64,
    precision: f64,
}

impl Score {
    fn add(&mut self, found: &[Line], marked: &[Line], weight: f64) {
        self.count += weight * found.len() as f64;
        self.length_px += weight * found.iter().map(Line::length).sum::<f64>();
        self.recall += weight * covered_share(marked, found);
        self.precision += weight * covered_share(found, marked);
    }

    fn print(&self, name: &str) {
        println!(
            "| {name} | {:.1} | {:.0} | {:.4} | {:.4} |",
            self.count, self.length_px, self.recall, self.precision
        );
    }
}

fn found(detector: &mut Detector, images: &[MarkedImage]) -> Vec<Vec<Line>> {
    let sorted = |image: &MarkedImage| {
        let mut lines = detector.detect(&image.image).unwrap();
        if detector.name.starts_with("OpenCV") {
            longest_first(&mut lines);
        }
        lines
    };
    images.iter().map(sorted).collect()
}

/// Scores of both at the same number per image: `share` of that of the detector that finds fewer.
fn compare(images: &[MarkedImage], ours: &[Vec<Line>], theirs: &[Vec<Line>], share: f64) -> [Score; 2] {
    let mut scores = [Score::default(); 2];
    let weight = 1.0 / images.len() as f64;
    for (image, (a, b)) in images.iter().zip(ours.iter().zip(theirs)) {
        let count = (share * a.len().min(b.len()) as f64).round() as usize;
        scores[0].add(&a[..count], &image.marked, weight);
        scores[1].add(&b[..count], &image.marked, weight);
    }
    scores
}

/// Scores of the longest of both that are `length_px` long together: what equal numbers do not show, as
/// segments in fewer pieces are longer.
fn compare_at_length(
    images: &[MarkedImage],
    ours: &[Vec<Line>],
    theirs: &[Vec<Line>],
    length_px: f64,
) -> [Score; 2] {
    let mut scores = [Score::default(); 2];
    for (image, both) in images.iter().zip(ours.iter().zip(theirs)) {
        for (score, lines) in scores.iter_mut().zip([both.0, both.1]) {
            let mut sum = 0.0;
            let count = lines.iter().take_while(|line| {
                sum += line.length();
                sum <= length_px
            });
            score.add(&lines[..count.count()], &image.marked, 1.0 / images.len() as f64);
        }
    }
    scores
}

#[test]
fn marked_segments_are_found_as_well_as_by_lsd() {
    let Some(shared) = shared("york_urban") else { return };
    let images = marked_images(&shared.join("york_urban")).unwrap();
    assert_eq!(images.len(), 51);
    let size = (images[0].image.width(), images[0].image.height());
    let lsd = found(&mut Detector::lsd().unwrap(), &images);
    println!("| longest of each image | mean N | px | recall | precision |\n|---|---:|---:|---:|---:|");
    let mut failures = Vec::new();
    let ours = found(&mut Detector::ours("ours", size, &unfiltered()), &images);
    for share in [1.0, 0.5] {
        let [a, b] = compare(&images, &ours, &lsd, share);
        a.print(&format!("ours, {share} N"));
        b.print(&format!("LSD, {share} N"));
        if a.recall < b.recall || a.precision < b.precision {
            failures.push(format!("at {share} N: {a:?} against {b:?}"));
        }
    }
    for length_px in [4000.0, 8000.0] {
        let [a, b] = compare_at_length(&images, &ours, &lsd, length_px);
        a.print(&format!("ours, {length_px} px"));
        b.print(&format!("LSD, {length_px} px"));
    }
    assert!(failures.is_empty(), "worse than LSD: {failures:#?}");
}
