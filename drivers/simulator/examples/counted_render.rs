//! Frames of the simulator: their digest and the processor time of one, and under callgrind its instructions.
//!
//! ```text
//! cargo run --release -p plumbline-drivers --example counted_render -- room
//! ```
//!
//! Scenes are `room`, `hall`, `low-texture` and `far`; a second argument `--perfect` leaves out what optics and sensor do.

use plumbline_config::Config;
use plumbline_drivers::StereoFrame;
use plumbline_simulator::{Effects, Scenario, Scene, Simulator};
use rustix::time::{ClockId, clock_gettime};
use std::error::Error;

/// From one frame to the next that is rendered: places all over the flight.
const STRIDE: u64 = 31;
/// Frames that are rendered, and how often.
const FRAMES: u64 = 20;
const ROUNDS: usize = 9;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().and_then(|name| Scene::named(&name));
    let scene = scene.ok_or("name a scene: room, hall, low-texture or far")?;
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
    let (mut digest, mut times_ms, mut least_ms) = (0, Vec::new(), [f64::MAX; FRAMES as usize]);
    for _ in 0..rounds {
        digest = 0xcbf2_9ce4_8422_2325_u64;
        let mut sum_ms = 0.0;
        for (number, least_ms) in (0..).zip(&mut least_ms) {
            let begin_ms = now_ms(rounds);
            simulator.render_frame(STRIDE * number, &mut scratch, &mut frame);
            let took_ms = now_ms(rounds) - begin_ms;
            sum_ms += took_ms;
            *least_ms = least_ms.min(took_ms);
            for pixel in frame.images.iter().flat_map(|image| image.pixels()) {
                digest = (digest ^ u64::from(*pixel)).wrapping_mul(0x0100_0000_01b3);
            }
        }
        times_ms.push(sum_ms / FRAMES as f64);
    }
    times_ms.sort_by(f64::total_cmp);
    let (median_ms, least_ms) = (times_ms[rounds / 2], least_ms.iter().sum::<f64>() / FRAMES as f64);
    println!(
        "{digest:016x}: {median_ms:.1} ms for a stereo frame, median of {rounds}; {least_ms:.1} ms by the least of each"
    );
    Ok(())
}

/// Processor time of this thread; not read in a single round, since valgrind stops where it is read.
fn now_ms(rounds: usize) -> f64 {
    if rounds == 1 {
        return 0.0;
    }
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as f64 * 1e3 + now.tv_nsec as f64 * 1e-6
}
