//! Time of rendering: a stereo frame of 752x480 of the preset `sim` in each scene, on one thread.

use plumbline_config::Config;
use plumbline_drivers::StereoFrame;
use plumbline_oracle::lines::median;
use plumbline_simulator::{Scenario, Scene, Simulator};
use std::error::Error;
use std::time::Instant;

/// From one frame to the next that is rendered, and their number: places all over the flight.
const STRIDE: u64 = 31;
const FRAMES: u64 = 20;

fn main() -> Result<(), Box<dyn Error>> {
    let config = Config::preset("sim")?.into_inner();
    let duration_s = (FRAMES * STRIDE) as f64 / config.camera[0].rate_hz;
    for name in ["room", "hall", "low-texture"] {
        let scene = Scene::named(name).ok_or("there is no such scene")?;
        let simulator = Simulator::new(&config, &Scenario { scene, duration_s, ..Scenario::default() })?;
        let (mut scratch, mut frame) = (simulator.scratch(), StereoFrame::new(simulator.image_sizes()));
        let times_ms: Vec<f64> = (0..FRAMES)
            .map(|number| {
                let begin = Instant::now();
                simulator.render_frame(STRIDE * number, &mut scratch, &mut frame);
                begin.elapsed().as_secs_f64() * 1e3
            })
            .collect();
        println!("{name}: {:.2} ms", median(&times_ms));
    }
    Ok(())
}
