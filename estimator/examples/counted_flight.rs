//! A few seconds of a simulated flight through the estimator on one thread: what `make bench-instructions` counts.
//!
//! ```text
//! cargo run --release -p plumbline-estimator --example counted_flight -- room FRAMES
//! ```
//!
//! Scenes are `room`, `hall`, `low-texture` and `far`. Options come after them: `--points` leaves lines out, `--places` looks for the
//! places of the frames instead, `--twice` does it again from the beginning. The first run renders the frames into the file FRAMES,
//! those after it fly them.

use plumbline_drivers::{ImuSource, StereoFrame, StereoSource};
use plumbline_estimator::config::options::CameraConfig;
use plumbline_estimator::config::{Config, ValidConfig};
use plumbline_estimator::image::Pyramid;
use plumbline_estimator::places::extractor::View;
use plumbline_estimator::places::index::Votes;
use plumbline_estimator::places::refine::Gravity;
use plumbline_estimator::places::{
    Extractor, Feature, Keyframe, Locator, LocatorOptions, MapLimits, PlaceMap, Query,
};
use plumbline_estimator::points::rig::RigCamera;
use plumbline_estimator::{Estimator, FrameInput, ImageView};
use plumbline_simulator::{FlightPath, Scenario, Scene, Simulator};
use std::error::Error;

/// In full flight from here on, s.
const START_S: f64 = 3.0;
/// Frames of a flight.
const FRAMES: usize = 40;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().and_then(|name| Scene::named(&name));
    let scene = scene.ok_or("name a scene: room, hall, low-texture or far")?;
    let mut config = Config::preset("sim")?.into_inner();
    let file = arguments.next().ok_or("name a file for the frames")?;
    let options: Vec<String> = arguments.collect();
    if let Some(other) = options.iter().find(|o| !["--points", "--places", "--twice"].contains(&o.as_str())) {
        return Err(format!("{other}: is not known; there are --points, --places and --twice").into());
    }
    let [is_of_points, is_of_places, is_again] =
        ["--points", "--places", "--twice"].map(|option| options.iter().any(|o| o == option));
    config.estimator.lines.enabled = !(is_of_points || is_of_places);
    let config = config.validated("counted flight")?;
    let duration_s = FRAMES as f64 / config.camera[0].rate_hz;
    let path = FlightPath::Demo;
    let scenario = Scenario { scene, path, start_s: START_S, duration_s, ..Scenario::default() };
    let simulator = Simulator::new(&config, &scenario)?;
    let Ok(pixels) = std::fs::read(&file) else { return Ok(std::fs::write(&file, rendered(&simulator)?)?) };
    let [left, right] = simulator.image_sizes().map(|(width, height)| width * height);
    if pixels.len() != FRAMES * (left + right) {
        return Err("the file holds other frames; remove it".into());
    }
    let pairs = pixels.chunks_exact(left + right).map(|pair| pair.split_at(left));
    for _ in 0..1 + u8::from(is_again) {
        if is_of_places {
            println!("{} frames whose place was found", look_for_places(&config, &simulator, pairs.clone())?);
        } else {
            println!("{} frames with a pose", fly(&config, &simulator, pairs.clone())?);
        }
    }
    Ok(())
}

/// The pixels of a stereo pair, left and right.
type Pair<'a> = (&'a [u8], &'a [u8]);

/// Flies, and counts the frames with a pose.
fn fly<'a>(
    config: &ValidConfig,
    simulator: &Simulator,
    pairs: impl Iterator<Item = Pair<'a>>,
) -> Result<usize, Box<dyn Error>> {
    let (mut imu, sizes) = (simulator.imu(), simulator.image_sizes());
    let mut estimator = Estimator::new(config.setup());
    let mut poses = 0;
    for (number, (left, right)) in (0..).zip(pairs) {
        let stamp = simulator.frame_stamp(number);
        let needed = estimator.imu_needed_until(stamp);
        while let Some(reading) = imu.next_reading()? {
            estimator.add_imu(&reading.sample);
            if reading.sample.stamp >= needed {
                break;
            }
        }
        let view = |side: usize, pixels| ImageView::new(sizes[side].0, sizes[side].1, sizes[side].0, pixels);
        let estimate = estimator.add_frame(&FrameInput::stereo(stamp, view(0, left)?, view(1, right)?));
        poses += usize::from(estimate.pose().is_some());
    }
    Ok(poses)
}

/// Looks for each frame in the map of those before it, and adds it, at its true pose; counts those that were found.
fn look_for_places<'a>(
    config: &ValidConfig,
    simulator: &Simulator,
    pairs: impl Iterator<Item = Pair<'a>>,
) -> Result<usize, Box<dyn Error>> {
    let (sizes, options) = (simulator.image_sizes(), &config.estimator);
    let camera = |c: &CameraConfig| {
        let mut camera = RigCamera::new(c.model());
        camera.pose_b_c = c.pose_b_c();
        camera
    };
    let rig: Vec<_> = config.camera.iter().map(camera).collect();
    let pose_b_c = rig[0].pose_b_c;
    let mut pyramids =
        sizes.map(|(width, height)| Pyramid::new(width, height, options.points.pyramid_levels));
    let features = options.places.max_features;
    let mut extractor = Extractor::new(sizes[0].0, sizes[0].1, features);
    let mut map = PlaceMap::new(MapLimits { keyframes: FRAMES, features });
    let (mut votes, mut locator) =
        (Votes::new(FRAMES), Locator::new(&LocatorOptions::default(), FRAMES, features));
    let (mut candidates, mut found) = (0, 0);
    for (number, (left, right)) in (0..).zip(pairs) {
        for (pyramid, (pixels, (width, height))) in
            pyramids.iter_mut().zip([left, right].into_iter().zip(sizes))
        {
            pyramid.build(&ImageView::new(width, height, width, pixels)?);
        }
        let stamp = simulator.frame_stamp(number);
        let keyframe = Keyframe::new(0, stamp, simulator.ground_truth(stamp).pose_w_b, pose_b_c);
        let [left, right] = [0, 1].map(|k| (&rig[k], &pyramids[k]));
        let features = extractor.extract(&View { left, right: Some(right), up_c: keyframe.up_c() });
        let gravity = Gravity { up_b: pose_b_c.rotation * keyframe.up_c(), sigma_rad: 0.004 };
        candidates += query(&map, features, &mut votes);
        found +=
            usize::from(locate(&map, &Query { features, pose_b_c, gravity, seed: number }, &mut locator));
        map.add(keyframe, features);
    }
    println!("{candidates} candidates");
    Ok(found)
}

/// A stage by itself: how many keyframes of the map look like a frame.
#[inline(never)]
fn query(map: &PlaceMap, features: &[Feature], votes: &mut Votes) -> usize {
    map.query(features, |_| true, votes).len()
}

/// A stage by itself: the same, and the verification of those that look most alike.
#[inline(never)]
fn locate(map: &PlaceMap, query: &Query<'_>, locator: &mut Locator) -> bool {
    locator.locate(map, query, |_| true).is_some()
}

/// The pixels of all frames, left before right.
fn rendered(simulator: &Simulator) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut source = simulator.stereo();
    let mut frame = StereoFrame::new(simulator.image_sizes());
    let mut pixels = Vec::new();
    while source.next_frame(&mut frame)? {
        frame.images.iter().for_each(|image| pixels.extend_from_slice(image.pixels()));
    }
    Ok(pixels)
}
