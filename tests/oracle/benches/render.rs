//! Time of rendering: a stereo frame of 752x480 of the preset `sim` in each scene, on one thread.

use criterion::{Criterion, SamplingMode};
use plumbline_config::Config;
use plumbline_drivers::StereoFrame;
use plumbline_simulator::{Scenario, Scene, Simulator};
use std::error::Error;
use std::time::Duration;

/// From one frame to the next that is rendered, and their number: places all over the flight.
const STRIDE: u64 = 31;
const FRAMES: u64 = 20;

fn main() -> Result<(), Box<dyn Error>> {
    let config = Config::preset("sim")?.into_inner();
    let duration_s = (FRAMES * STRIDE) as f64 / config.camera[0].rate_hz;
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("render");
    group.sampling_mode(SamplingMode::Flat).sample_size(20).measurement_time(Duration::from_secs(5));
    for name in ["room", "hall", "low-texture"] {
        let scene = Scene::named(name).ok_or("there is no such scene")?;
        let simulator = Simulator::new(&config, &Scenario { scene, duration_s, ..Scenario::default() })?;
        let (mut scratch, mut frame) = (simulator.scratch(), StereoFrame::new(simulator.image_sizes()));
        let mut number = 0;
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                simulator.render_frame(STRIDE * number, &mut scratch, &mut frame);
                number = (number + 1) % FRAMES;
            });
        });
    }
    group.finish();
    Ok(())
}
