//! A few seconds of a simulated flight through the estimator on one thread: what `make bench-instructions` counts.
//!
//! ```text
//! cargo run --release -p plumbline-estimator --example counted_flight -- room FRAMES
//! ```
//!
//! Scenes are `room`, `hall` and `low-texture`; a third argument `--points` leaves lines out. The first run renders the
//! frames into the file FRAMES, those after it fly them.

use plumbline_drivers::simulator::{FlightPath, Scenario, Scene, Simulator};
use plumbline_drivers::{ImuSource, StereoFrame, StereoSource};
use plumbline_estimator::config::{Config, ValidConfig};
use plumbline_estimator::{Estimator, FrameInput, ImageView};
use std::error::Error;

/// In full flight from here on, s.
const START_S: f64 = 3.0;
/// Frames of a flight.
const FRAMES: usize = 40;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let scene = match arguments.next().as_deref() {
        Some("room") => Scene::Room,
        Some("hall") => Scene::Hall,
        Some("low-texture") => Scene::LowTexture,
        _ => return Err("name a scene: room, hall or low-texture".into()),
    };
    let mut config = Config::preset("sim")?.into_inner();
    let file = arguments.next().ok_or("name a file for the frames")?;
    config.estimator.lines.enabled = match arguments.next().as_deref() {
        None => true,
        Some("--points") => false,
        Some(other) => return Err(format!("{other}: is not known; there is --points").into()),
    };
    let config = config.validated("counted flight")?;
    let duration_s = FRAMES as f64 / config.camera[0].rate_hz;
    let path = FlightPath::Demo;
    let scenario = Scenario { scene, path, start_s: START_S, duration_s, ..Scenario::default() };
    let simulator = Simulator::new(&config, &scenario)?;
    match std::fs::read(&file) {
        Ok(pixels) => println!("{} frames with a pose", fly(&config, &simulator, &pixels)?),
        Err(_) => std::fs::write(&file, rendered(&simulator)?)?,
    }
    Ok(())
}

/// Flies, and counts the frames with a pose.
fn fly(config: &ValidConfig, simulator: &Simulator, pixels: &[u8]) -> Result<usize, Box<dyn Error>> {
    let (mut imu, sizes) = (simulator.imu(), simulator.image_sizes());
    let bytes = sizes.map(|(width, height)| width * height);
    if pixels.len() != FRAMES * (bytes[0] + bytes[1]) {
        return Err("the file holds other frames; remove it".into());
    }
    let mut estimator = Estimator::new(config.setup());
    let mut poses = 0;
    for (number, pair) in (0..).zip(pixels.chunks_exact(bytes[0] + bytes[1])) {
        let stamp = simulator.frame_stamp(number);
        let needed = estimator.imu_needed_until(stamp);
        while let Some(reading) = imu.next_reading()? {
            estimator.add_imu(&reading.sample);
            if reading.sample.stamp >= needed {
                break;
            }
        }
        let (left, right) = pair.split_at(bytes[0]);
        let view = |side: usize, pixels| ImageView::new(sizes[side].0, sizes[side].1, sizes[side].0, pixels);
        let estimate = estimator.add_frame(&FrameInput::stereo(stamp, view(0, left)?, view(1, right)?));
        poses += usize::from(estimate.pose().is_some());
    }
    Ok(poses)
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
