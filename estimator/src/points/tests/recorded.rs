//! The front-end on recorded flights: how long tracks live, and how steady they are.

use super::dataset::{Clip, euroc_rig};
use crate::points::rig::{Baseline, RigCamera};
use crate::points::{PointObservation, PointTracker, TrackerFigures, TrackerInput};
use crate::work_budget::InTurn;
use nalgebra::{Isometry3, Matrix3, Point3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};
use plumbline_config::CameraModel;
use plumbline_config::options::PointsConfig;
use std::collections::BTreeMap;

/// Observations in a clip, by frame.
struct Run {
    frames: Vec<Vec<PointObservation>>,
    figures: Vec<TrackerFigures>,
    milliseconds: Vec<f64>,
}

fn run(clip: &Clip, cameras: usize, bias: Vector3<f64>) -> Run {
    let (models, poses) = euroc_rig();
    let mut tracker = PointTracker::new(&PointsConfig::default(), &models[..cameras]);
    tracker.set_extrinsics(&poses[..cameras]);
    let mut out = Run { frames: Vec::new(), figures: Vec::new(), milliseconds: Vec::new() };
    let mut before = clip.stamps[0];
    for &stamp in &clip.stamps {
        let images = [clip.image(0, stamp), if cameras > 1 { clip.image(1, stamp) } else { None }];
        let rot_prev_cur = clip.rotation(before, stamp, &bias);
        let input =
            TrackerInput { images: images.each_ref().map(|i| i.as_ref().map(|i| i.view())), rot_prev_cur };
        out.milliseconds.push(time_of(&tracker, &input));
        let seen = tracker.track(&input, &InTurn, &mut ()).to_vec();
        out.frames.push(seen);
        out.figures.push(tracker.figures());
        before = stamp;
    }
    out
}

/// Milliseconds of processor time that a frame takes: the least of some, for other programs disturb the caches.
fn time_of(tracker: &PointTracker, input: &TrackerInput<'_>) -> f64 {
    const REPEATS: usize = 5;
    let once = |_| {
        let mut copy = tracker.clone();
        let start = processor_ns();
        copy.track(input, &InTurn, &mut ());
        (processor_ns() - start) * 1e-6
    };
    (0..REPEATS).map(once).fold(f64::INFINITY, f64::min)
}

/// Processor time of this thread, ns. Linux brings it up to date when a thread yields.
fn processor_ns() -> f64 {
    std::thread::yield_now();
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split(' ').next().and_then(|t| t.parse().ok()).unwrap_or(0.0)
}

impl Run {
    fn lengths(&self) -> Vec<u32> {
        let mut last = BTreeMap::new();
        for point in self.frames.iter().flatten() {
            last.insert(point.track_id, point.age);
        }
        let mut lengths: Vec<u32> = last.into_values().collect();
        lengths.sort_unstable();
        lengths
    }

    fn print(&self, name: &str) {
        let mut ms = self.milliseconds.clone();
        ms.sort_by(f64::total_cmp);
        let n = self.frames.len() as f64;
        let mean = |f: &dyn Fn(&TrackerFigures) -> u32| {
            self.figures.iter().map(|x| f64::from(f(x))).sum::<f64>() / n
        };
        println!(
            "{name}: {:.0} points a frame, {:.0} stereo",
            self.frames.iter().map(Vec::len).sum::<usize>() as f64 / n,
            mean(&|f| f.stereo)
        );
        println!(
            "  refined {:.1} flow only {:.1} changed {:.2} lost {:.2} outliers {:.2} new {:.2}",
            mean(&|f| f.refined),
            mean(&|f| f.flow_only),
            mean(&|f| f.changed),
            mean(&|f| f.lost),
            mean(&|f| f.outliers),
            mean(&|f| f.new)
        );
        let lengths = self.lengths();
        println!(
            "  {} tracks, median length {}, mean {:.1}, longest {}",
            lengths.len(),
            lengths[lengths.len() / 2],
            lengths.iter().sum::<u32>() as f64 / lengths.len() as f64,
            lengths[lengths.len() - 1]
        );
        println!(
            "  ms: median {:.2} p95 {:.2} max {:.2} first {:.2}",
            ms[ms.len() / 2],
            ms[ms.len() * 95 / 100],
            ms[ms.len() - 1],
            self.milliseconds[0]
        );
    }
}

/// A view of a point: frame and pixel.
type View = (usize, Vector2<f64>);

/// Reprojection errors of tracks with at least `min_length` frames after an adjustment of points and poses
/// in turn, which takes out what the ground truth is off: what stays is how far tracks contradict each other.
fn reprojection(run: &Run, clip: &Clip, min_length: usize) {
    let (models, extrinsics) = euroc_rig();
    let model = &models[0];
    let mut tracks: BTreeMap<u32, Vec<View>> = BTreeMap::new();
    for (k, frame) in run.frames.iter().enumerate() {
        for point in frame {
            if let Some(px) = point.px[0] {
                tracks.entry(point.track_id).or_default().push((k, px));
            }
        }
    }
    let truth: Vec<_> = clip
        .stamps
        .iter()
        .map(|&s| clip.pose(s).unwrap_or_else(Isometry3::identity) * extrinsics[0])
        .collect();
    let mut poses = truth.clone();
    let mut points: BTreeMap<u32, Point3<f64>> = BTreeMap::new();
    for round in 0..30 {
        for (id, views) in tracks.iter().filter(|(_, v)| v.len() >= 8) {
            if let Some(p) = triangulate(model, &poses, views, points.get(id)) {
                points.insert(*id, p);
            }
        }
        if round > 0 {
            for (k, pose) in poses.iter_mut().enumerate() {
                let seen = run.frames[k].iter().filter_map(|p| Some((*points.get(&p.track_id)?, p.px[0]?)));
                adjust(model, pose, &truth[k], &seen.collect::<Vec<_>>());
            }
        }
    }
    let error = |p_w: &Point3<f64>, (k, px): &View| {
        model.project(&(poses[*k].inverse() * p_w).coords).map_or(99.0, |q| (q - px).norm())
    };
    let mut errors: Vec<f64> = Vec::new();
    for (id, views) in tracks.iter().filter(|(_, v)| v.len() >= min_length) {
        let Some(p) = points.get(id) else { continue };
        errors.push((views.iter().map(|v| error(p, v).powi(2)).sum::<f64>() / views.len() as f64).sqrt());
    }
    errors.sort_by(f64::total_cmp);
    let q = |q: usize| errors[(errors.len() - 1) * q / 100];
    let over = |limit: f64| errors.iter().filter(|e| **e > limit).count() as f64 / errors.len() as f64;
    println!(
        "  length >= {min_length}: {} tracks, rms p10 {:.3} p25 {:.3} p50 {:.3} p75 {:.3} p90 {:.3} p97 {:.3} px; over 1 px {:.3} over 3 px {:.3}",
        errors.len(),
        q(10),
        q(25),
        q(50),
        q(75),
        q(90),
        q(97),
        over(1.0),
        over(3.0)
    );
}

/// Gauss-Newton steps of a pose on the points it sees, with a prior at the truth (2 mm, 2 mrad).
fn adjust(
    model: &CameraModel,
    pose: &mut Isometry3<f64>,
    truth: &Isometry3<f64>,
    seen: &[(Point3<f64>, Vector2<f64>)],
) {
    for _ in 0..2 {
        let (mut h, mut g) =
            (SMatrix::<f64, 6, 6>::identity() * (0.3f64 / 0.005).powi(2), SVector::<f64, 6>::zeros());
        let off = truth.inverse() * *pose;
        g.fixed_rows_mut::<3>(0).copy_from(&(off.translation.vector * (0.3f64 / 0.005).powi(2)));
        g.fixed_rows_mut::<3>(3).copy_from(&(off.rotation.scaled_axis() * (0.3f64 / 0.005).powi(2)));
        for (p_w, px) in seen {
            let p_c = (pose.inverse() * p_w).coords;
            let Some((q, by_p)) = model.project_with_jacobian(&p_c) else { continue };
            let mut by_pose = SMatrix::<f64, 3, 6>::zeros();
            by_pose.fixed_columns_mut::<3>(0).copy_from(&-Matrix3::identity());
            by_pose.fixed_columns_mut::<3>(3).copy_from(&p_c.cross_matrix());
            let j = by_p * by_pose;
            let w = 1.0 / (1.0 + (q - px).norm_squared() / 0.25);
            h += j.transpose() * j * w;
            g += j.transpose() * (q - px) * w;
        }
        let Some(step) = h.cholesky().map(|c| -c.solve(&g)) else { return };
        let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(3).into_owned());
        *pose *= Isometry3::from_parts(step.fixed_rows::<3>(0).into_owned().into(), turn);
    }
}

/// The point that best explains all views (Gauss-Newton on the pixels, robust, from a linear start).
fn triangulate(
    model: &CameraModel,
    poses: &[Isometry3<f64>],
    views: &[View],
    start: Option<&Point3<f64>>,
) -> Option<Point3<f64>> {
    let linear = || {
        let (mut a, mut b) = (Matrix3::identity() * 1e-9, Vector3::zeros());
        for (k, px) in views {
            let xy = model.unproject(px)?;
            let ray = poses[*k].rotation * Vector3::new(xy.x, xy.y, 1.0).normalize();
            let across = Matrix3::identity() - ray * ray.transpose();
            a += across;
            b += across * poses[*k].translation.vector;
        }
        Some(Point3::from(a.try_inverse()? * b))
    };
    let mut p_w = start.copied().or_else(linear)?;
    for _ in 0..(if start.is_some() { 1 } else { 8 }) {
        let (mut h, mut g) = (Matrix3::zeros(), Vector3::zeros());
        for (k, px) in views {
            let (q, j) = model.project_with_jacobian(&(poses[*k].inverse() * p_w).coords)?;
            let j = j * poses[*k].rotation.inverse().to_rotation_matrix().matrix();
            let w = 1.0 / (1.0 + (q - px).norm_squared());
            h += j.transpose() * j * w;
            g += j.transpose() * (q - px) * w;
        }
        p_w -= h.try_inverse()? * g;
    }
    Some(p_w)
}

#[test]
#[ignore = "prints figures; needs the recorded clips"]
fn flight_figures() {
    let Some(clip) = Clip::open("MH_05_mono_clip") else { return };
    for (bias, name) in [(Vector3::zeros(), "no bias"), (Vector3::new(-0.0018, 0.0209, 0.0769), "true bias")]
    {
        let run = run(&clip, 1, bias);
        run.print(&format!("MH_05 {name}"));
        for length in [10, 20, 40, 80] {
            reprojection(&run, &clip, length);
        }
    }
}

#[test]
#[ignore = "prints figures; needs the recorded clips"]
fn rest_figures() {
    let Some(clip) = Clip::open("V1_01_easy_clip") else { return };
    let run = run(&clip, 2, Vector3::zeros());
    run.print("V1_01 at rest");
    let (models, poses) = euroc_rig();
    let mut depths: Vec<f64> = run.frames[30].iter().filter_map(|p| depth(&models, &poses, p)).collect();
    depths.sort_by(f64::total_cmp);
    let q = |share: usize| depths[(depths.len() - 1) * share / 100];
    println!(
        "  depths: least {:.2} p10 {:.2} p50 {:.2} p90 {:.2} most {:.2} m",
        q(0),
        q(10),
        q(50),
        q(90),
        q(100)
    );
    assert!(q(0) > 0.5 && q(100) < 30.0);
    for camera in 0..2 {
        let mut tracks: BTreeMap<u32, Vec<Vector2<f64>>> = BTreeMap::new();
        for point in run.frames.iter().take(60).flatten() {
            if let Some(px) = point.px[camera] {
                tracks.entry(point.track_id).or_default().push(px);
            }
        }
        let (mut sum, mut drift, mut count, mut worst) = (0.0, 0.0, 0, 0);
        tracks.retain(|_, p| p.len() == 60);
        // The vehicle trembles: the motion common to all points is taken out.
        let mut centred: Vec<Vec<Vector2<f64>>> = tracks
            .values()
            .map(|p| {
                let mean = p.iter().sum::<Vector2<f64>>() / p.len() as f64;
                p.iter().map(|x| x - mean).collect()
            })
            .collect();
        let mut common = 0.0;
        for k in 0..60 {
            let mean = centred.iter().map(|p| p[k]).sum::<Vector2<f64>>() / centred.len() as f64;
            common += mean.norm_squared() / 60.0;
            centred.iter_mut().for_each(|p| p[k] -= mean);
        }
        println!("  common motion {:.3} px rms", common.sqrt());
        for positions in &centred {
            let mean = positions.iter().sum::<Vector2<f64>>() / positions.len() as f64;
            let variance =
                positions.iter().map(|p| (p - mean).norm_squared()).sum::<f64>() / positions.len() as f64;
            sum += variance;
            drift += (positions[positions.len() - 1] - positions[0]).norm_squared();
            worst += i32::from(variance.sqrt() > 0.2);
            count += 1;
        }
        println!(
            "  camera {camera}: rms about mean {:.3} px, last - first {:.3} px, {worst} of {count} over 0.2 px",
            (sum / f64::from(count)).sqrt(),
            (drift / f64::from(count)).sqrt()
        );
    }
}

/// The cost of a frame with a full set of points in flight and stereo: there is no such recording, so the
/// right image is the left one moved by 15 px.
#[test]
#[ignore = "prints figures; needs the recorded clips"]
fn stereo_flight_cost() {
    const DISPARITY_PX: usize = 15;
    let Some(clip) = Clip::open("MH_05_mono_clip") else { return };
    let (models, poses) = euroc_rig();
    let mut tracker = PointTracker::new(&PointsConfig::default(), &[models[0]; 2]);
    tracker.set_extrinsics(&[poses[0], poses[0] * Isometry3::translation(0.11, 0.0, 0.0)]);
    let mut out = Run { frames: Vec::new(), figures: Vec::new(), milliseconds: Vec::new() };
    for pair in clip.stamps.windows(2) {
        let left = clip.image(0, pair[1]).expect("image");
        let mut right = left.clone();
        right.pixels_mut().rotate_left(DISPARITY_PX);
        let rot_prev_cur = clip.rotation(pair[0], pair[1], &Vector3::zeros());
        let input = TrackerInput { images: [Some(left.view()), Some(right.view())], rot_prev_cur };
        out.milliseconds.push(time_of(&tracker, &input));
        out.frames.push(tracker.track(&input, &InTurn, &mut ()).to_vec());
        out.figures.push(tracker.figures());
    }
    out.print("MH_05 with a second camera");
}

/// Depth of a point seen by both cameras, m.
fn depth(models: &[CameraModel; 2], poses: &[Isometry3<f64>; 2], point: &PointObservation) -> Option<f64> {
    let mut cameras = models.map(RigCamera::new);
    for (camera, pose) in cameras.iter_mut().zip(poses) {
        camera.pose_b_c = *pose;
    }
    let baseline = Baseline::between(&cameras[0], &cameras[1]);
    baseline.triangulate(&point.xy[0]?, &point.xy[1]?, cameras[1].focal_px()).map(|g| 1.0 / g.inverse_depth)
}
