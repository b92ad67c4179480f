//! Frames of the simulator: their digest and the time of one, and under callgrind its instructions.
//!
//! ```text
//! cargo run --release -p plumbline-drivers --example counted_render -- room
//! ```
//!
//! Scenes are `room`, `hall` and `low-texture`; a second argument `--perfect` leaves out what optics and sensor do.

use plumbline_config::Config;
use plumbline_drivers::StereoFrame;
use plumbline_drivers::simulator::{Effects, Scenario, Scene, Simulator};
use std::error::Error;
use std::time::Instant;

/// From one frame to the next that is rendered: places all over the flight.
const STRIDE: u64 = 31;
/// Frames that are rendered, and how often.
const FRAMES: u64 = 20;
const ROUNDS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let scene = match arguments.next().as_deref() {
        Some("room") => Scene::Room,
        Some("hall") => Scene::Hall,
        Some("low-texture") => Scene::LowTexture,
        _ => return Err("name a scene: room, hall or low-texture".into()),
    };
    let (effects, rounds) = match arguments.next().as_deref() {
        None => (Effects::default(), ROUNDS),
        Some("--perfect") => (Effects::none(), ROUNDS),
        Some("--once") => (Effects::default(), 1),
        Some(other) => return Err(format!("{other}: is not known; there are --perfect and --once").into()),
    };
    let config = Config::preset("sim")?.into_inner();
    let duration_s = (FRAMES * STRIDE) as f64 / config.camera[0].rate_hz;
    let simulator = Simulator::new(&config, &Scenario { scene, effects, duration_s, ..Scenario::default() })?;
    let (mut scratch, mut frame) = (simulator.scratch(), StereoFrame::new(simulator.image_sizes()));
    let (mut digest, mut times_ms) = (0, Vec::new());
    for _ in 0..rounds {
        digest = 0xcbf2_9ce4_8422_2325_u64;
        let mut took_ms = 0.0;
        for number in 0..FRAMES {
            let begin = Instant::now();
            simulator.render_frame(STRIDE * number, &mut scratch, &mut frame);
            took_ms += begin.elapsed().as_secs_f64() * 1e3;
            for pixel in frame.images.iter().flat_map(|image| image.pixels()) {
                digest = (digest ^ u64::from(*pixel)).wrapping_mul(0x0100_0000_01b3);
            }
        }
        times_ms.push(took_ms / FRAMES as f64);
    }
    times_ms.sort_by(f64::total_cmp);
    println!("{digest:016x}: {:.1} ms for a stereo frame, median of {rounds}", times_ms[rounds / 2]);
    Ok(())
}
