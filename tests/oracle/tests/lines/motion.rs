//! Simulated flights: are the segments of a frame found again in the next, and where they should be?
//!
//! Segments are compared as they would be without the lens, in the pixels of a pinhole camera of the same
//! focal length: an edge that the lens bends has no straight place in the image. Ours are undistorted as the
//! estimator does it, others by their ends.

use nalgebra::{Isometry3, Vector2, Vector3};
use plumbline_config::camera::Distortion;
use plumbline_config::{CameraModel, Config, GrayImage, Timestamp};
use plumbline_estimator::lines::filter::clearest_first;
use plumbline_estimator::lines::merge::Merger;
use plumbline_estimator::lines::{ImageLine, LineExtractor, Segment};
use plumbline_estimator::points::rig::RigCamera;
use plumbline_oracle::lines::detectors::unfiltered;
use plumbline_oracle::lines::{Detector, Line};
use plumbline_simulator::{Scene, Simulator};
use plumbline_tests::{along, shared};

/// Flights, each in its scene.
const FLIGHTS: [(&str, &str, Scene); 4] = [
    ("V1_02_medium", "room", Scene::Room),
    ("V2_02_medium", "hall", Scene::Hall),
    ("V1_03_difficult", "low-texture", Scene::LowTexture),
    ("MH_04_difficult", "hall", Scene::Hall),
];
/// Pairs of frames of a flight, and frames from one to the next.
const PAIRS: u64 = 12;
const PAIR_STEP: u64 = 10;
/// Shortest segment that counts, for all detectors.
const MIN_LENGTH_PX: f64 = 40.0;
/// Ends are moved inwards by this much: at a corner they may already lie on what is behind.
const INSET_PX: f64 = 3.0;
/// Depth is taken this far to either side of a segment.
const BESIDE_PX: f64 = 2.0;
/// Transferred segments this near to the image's border are left out.
const BORDER_PX: f64 = 10.0;
/// Largest distance of a segment that is the same.
const SAME_PX: f64 = 2.0;
/// Largest angle to one that is the same, degrees.
const SAME_DEG: f64 = 2.0;

/// The left camera at one time of a simulated flight.
struct View<'a> {
    simulator: &'a Simulator,
    model: &'a CameraModel,
    time: Timestamp,
    pose_w_c: Isometry3<f64>,
}

impl<'a> View<'a> {
    fn new(simulator: &'a Simulator, model: &'a CameraModel, frame: u64) -> Self {
        let time = simulator.frame_time(frame);
        let pose_w_c = simulator.ground_truth(time).pose_w_b * simulator.config().camera[0].pose_b_c();
        Self { simulator, model, time, pose_w_c }
    }

    /// The point of an edge with normal `across` that is seen at `px`: it lies on the nearer of the
    /// surfaces to both sides.
    fn edge_point(&self, px: &Vector2<f64>, across: &Vector2<f64>) -> Option<Vector3<f64>> {
        let lens = |px: &Vector2<f64>| self.model.project_normalized(&normalized(self.model, px)).0;
        let hit = |offset: f64| self.simulator.first_hit(self.time, 0, &lens(&(px + across * offset)));
        let (a, b, centre) = (hit(-BESIDE_PX)?, hit(BESIDE_PX)?, hit(0.0)?);
        let nearer = if a.distance < b.distance { a } else { b };
        // Rays have z = 1, so that distances are depths.
        let depth = if centre.surface == nearer.surface { centre.distance } else { nearer.distance };
        let bearing = normalized(self.model, px);
        Some(self.pose_w_c.transform_point(&(bearing.push(1.0) * depth).into()).coords)
    }

    fn project(&self, p_w: &Vector3<f64>) -> Option<Vector2<f64>> {
        let p_c = self.pose_w_c.inverse_transform_point(&(*p_w).into());
        self.model.project(&p_c.coords).filter(|px| self.model.contains(px, BORDER_PX))?;
        Some(straight(self.model, &(p_c.coords.xy() / p_c.z)))
    }

    /// Image of a segment of this view in `next`; `None` when it leaves the image.
    fn transfer(&self, line: &Line, next: &Self) -> Option<Line> {
        let along = line.direction();
        let across = Vector2::new(-along.y, along.x);
        let [start, end] = [line.start + along * INSET_PX, line.end - along * INSET_PX];
        let start = next.project(&self.edge_point(&start, &across)?)?;
        let end = next.project(&self.edge_point(&end, &across)?)?;
        Some(Line { start, end })
    }
}

/// Pixel of a camera without distortion.
fn straight(model: &CameraModel, xy: &Vector2<f64>) -> Vector2<f64> {
    xy.component_mul(&model.focal_px) + model.centre_px
}

/// The inverse of [`straight`].
fn normalized(model: &CameraModel, px: &Vector2<f64>) -> Vector2<f64> {
    (px - model.centre_px).component_div(&model.focal_px)
}

/// Fate of the segments of all first frames.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    found: usize,
    transferred: usize,
    again: usize,
    squared_px2: f64,
}

impl Tally {
    fn add(&mut self, views: &[View<'_>; 2], first: &[Line], second: &[Line]) {
        self.found += first.len();
        for line in first {
            let Some(expected) = views[0].transfer(line, &views[1]) else { continue };
            self.transferred += 1;
            let nearest = second
                .iter()
                .filter_map(|candidate| mean_square_if_same(&expected, candidate))
                .min_by(f64::total_cmp);
            if let Some(square) = nearest {
                self.again += 1;
                self.squared_px2 += square;
            }
        }
    }

    fn repeatability(&self) -> f64 {
        self.again as f64 / self.transferred.max(1) as f64
    }

    fn rms_px(&self) -> f64 {
        (self.squared_px2 / self.again.max(1) as f64).sqrt()
    }

    fn print(&self, scene: &str, name: &str) {
        println!(
            "| {scene} | {name} | {} | {} | {:.4} | {:.4} |",
            self.found,
            self.transferred,
            self.repeatability(),
            self.rms_px()
        );
    }
}

/// Mean squared distance of the ends of `expected` from the line of `found`, if both are the same.
fn mean_square_if_same(expected: &Line, found: &Line) -> Option<f64> {
    let [a, b] = [expected.start, expected.end].map(|px| found.distance_across(&px));
    if a.max(b) > SAME_PX || expected.angle(found) > SAME_DEG.to_radians() {
        return None;
    }
    let place = |px: &Vector2<f64>| found.direction().dot(&(px - found.start)).clamp(0.0, found.length());
    let overlap = (place(&expected.end) - place(&expected.start)).abs();
    (overlap >= 0.5 * expected.length()).then_some(0.5 * (a * a + b * b))
}

/// Our segments of at least [`MIN_LENGTH_PX`], and what merging makes of them.
struct Ours {
    extractor: LineExtractor,
    merger: Merger,
}

impl Ours {
    fn new((width, height): (usize, usize)) -> Self {
        let options = unfiltered(false);
        Self { extractor: LineExtractor::new(width, height, &options), merger: Merger::new(&options) }
    }

    fn detect(&mut self, image: &GrayImage, model: &CameraModel) -> [Vec<Line>; 2] {
        let raw = self.extractor.extract(&image.view()).unwrap();
        let is_long = |segment: &&Segment| f64::from(segment.length()) >= MIN_LENGTH_PX;
        let mut kept: Vec<Segment> = raw.iter().filter(is_long).copied().collect();
        clearest_first(&mut kept);
        let mut merged = Vec::with_capacity(kept.len());
        self.merger.merge(&kept, &mut merged);
        let line = |segment: &Segment| {
            let [start, end] =
                ImageLine::of(segment, &RigCamera::new(*model))?.ends_xy.map(|xy| straight(model, &xy));
            Some(Line { start, end })
        };
        [merged, kept].map(|segments| segments.iter().filter_map(line).collect())
    }
}

fn lsd_segments(lsd: &mut Detector, image: &GrayImage, model: &CameraModel) -> Vec<Line> {
    let mut lines = lsd.detect(image).unwrap();
    lines.retain(|line| line.length() >= MIN_LENGTH_PX);
    let end = |px: &Vector2<f64>| Some(straight(model, &model.unproject(px)?));
    lines.iter().filter_map(|line| Some(Line { start: end(&line.start)?, end: end(&line.end)? })).collect()
}

/// The rig, with its lenses or, for images in which straight edges are straight, without distortion.
fn rig(is_distorted: bool) -> Config {
    let mut config = Config::preset("sim").unwrap().into_inner();
    if !is_distorted {
        for camera in &mut config.camera {
            camera.distortion = Distortion::RadialTangential { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0 };
        }
    }
    config
}

/// Tallies of ours merged, ours unmerged and LSD over one flight.
fn tally(config: &Config, path: &str, scene: Scene) -> [Tally; 3] {
    let seconds = (PAIRS * PAIR_STEP + 2) as f64 / 20.0;
    let simulator = Simulator::new(config, &along(path, scene, seconds).unwrap()).unwrap();
    let model = simulator.config().camera[0].model();
    let (mut scratch, size) = (simulator.scratch(), simulator.image_sizes()[0]);
    let (mut ours, mut lsd) = (Ours::new(size), Detector::lsd().unwrap());
    let mut tallies = [Tally::default(); 3];
    for pair in 0..PAIRS {
        let frames = [pair * PAIR_STEP, pair * PAIR_STEP + 1];
        let views = frames.map(|frame| View::new(&simulator, &model, frame));
        let segments = frames.map(|frame| {
            let mut image = GrayImage::new(size.0, size.1);
            simulator.render_camera(frame, 0, &mut scratch, &mut image);
            let [merged, raw] = ours.detect(&image, &model);
            [merged, raw, lsd_segments(&mut lsd, &image, &model)]
        });
        for (k, tally) in tallies.iter_mut().enumerate() {
            tally.add(&views, &segments[0][k], &segments[1][k]);
        }
    }
    tallies
}

/// Compares the detectors over all flights with the rig's lenses or without distortion.
fn compare(is_distorted: bool) {
    if shared("euroc/trajectories").is_none() {
        return;
    }
    println!("| flight | detector | segments | in both frames | found again | RMS px |");
    println!("|---|---|---:|---:|---:|---:|");
    let config = rig(is_distorted);
    let mut sums = [Tally::default(); 3];
    let names = ["ours, merged", "ours, raw", "LSD"];
    for (path, scene_name, scene) in FLIGHTS {
        let tallies = tally(&config, path, scene);
        for ((sum, tally), name) in sums.iter_mut().zip(&tallies).zip(names) {
            tally.print(&format!("{path} {scene_name}"), name);
            sum.found += tally.found;
            sum.transferred += tally.transferred;
            sum.again += tally.again;
            sum.squared_px2 += tally.squared_px2;
        }
    }
    for (sum, name) in sums.iter().zip(names) {
        sum.print("all", name);
    }
    let [ours, _, lsd] = sums;
    assert!(ours.transferred >= 100 && lsd.transferred >= 100);
    assert!(ours.repeatability() >= lsd.repeatability(), "found again less often than by LSD");
    assert!(ours.rms_px() <= lsd.rms_px(), "not as exact as LSD");
}

#[test]
fn segments_are_found_again_where_they_should_be_as_well_as_by_lsd() {
    compare(true);
}

#[test]
fn so_they_are_where_the_lens_bends_no_edge() {
    compare(false);
}
