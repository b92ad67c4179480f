//! Starts with one camera of which nobody has told the delay, the readout or the rate.

use super::super::Odometer;
use super::super::synthetic::{self, World, stamp};
use crate::exchange::{Feedback, Tracked, believable_offset};
use crate::window::state::FrameTime;

/// A start, and how the estimate was afterwards.
#[derive(Debug)]
struct Started {
    first_s: Option<f64>,
    time_offset_s: f64,
    /// Estimated over true speed, in the mean of the frames from 4 s on.
    scale: f64,
    readout_s: f64,
    resets: u32,
}

/// Flies eight seconds, frame `k` coming `interval_s(k)` after the one before.
fn fly(world: &mut World, interval_s: impl Fn(u32) -> f64) -> Started {
    let mut odometer = Odometer::new(&world.config);
    let (mut tracked, mut feedback) = (Tracked::new(&world.config), Feedback::new(&world.config));
    // As the front-end hears of it: a frame late.
    let mut heard_offset_s = feedback.time_offset_s;
    let (mut t, mut k) = (0.2, 0u32);
    let (mut speeds, mut started) = ([0.0; 2], None);
    let mut last = None;
    while t < 8.0 {
        let time_offset_s = believable_offset(heard_offset_s);
        let needed = stamp(t).plus_seconds(time_offset_s);
        tracked.samples.extend(world.samples_to(t + time_offset_s));
        tracked.points = world.observe(t, [true, false]);
        tracked.sequence = u64::from(k);
        tracked.time = FrameTime { stamp: needed, time_offset_s };
        (heard_offset_s, world.known_readout_s) = (feedback.time_offset_s, feedback.readouts[0].readout_s);
        let estimate = odometer.process(&tracked, &mut (), &mut feedback);
        tracked.samples.clear();
        if estimate.has_pose() {
            started.get_or_insert(t - 0.2);
            if t > 4.0 {
                speeds[0] += estimate.v_o_b.norm();
                speeds[1] += world.v_b(t + world.time_offset_s).norm();
            }
        }
        last = Some(estimate);
        k += 1;
        t += interval_s(k);
    }
    let last = last.expect("frames were flown");
    Started {
        first_s: started,
        time_offset_s: last.time_offset_s,
        scale: speeds[0] / speeds[1],
        readout_s: odometer.estimation.measurer.readouts[0].readout_s,
        resets: last.reset_counter,
    }
}

/// A world seen sharply enough that its gentle turns determine a delay to about 1 ms, and a readout to 2 ms.
fn sharp_world(seed: u64) -> World {
    const SIGMA_PX: f64 = 0.1;
    let mut setup = (*synthetic::config(1)).clone();
    setup.estimator.points.sigma_px = SIGMA_PX;
    let config = setup.validate().expect("is valid");
    let mut world = World::new(&config, seed, 500);
    world.sigma_px = SIGMA_PX;
    world
}

fn steady(_: u32) -> f64 {
    0.05
}

fn is_sound(world: &World, started: &Started) {
    assert!(started.first_s.is_some_and(|s| s < 3.0) && started.resets == 0, "{started:?}");
    assert!((started.time_offset_s - world.time_offset_s).abs() < 0.004, "{started:?}");
    assert!((started.scale - 1.0).abs() < 0.1, "{started:?}");
}

#[test]
fn finds_a_delay_that_is_not_configured() {
    for time_offset_s in [-0.1, -0.05, 0.03, 0.06] {
        let mut world = sharp_world(5);
        world.time_offset_s = time_offset_s;
        let started = fly(&mut world, steady);
        is_sound(&world, &started);
        assert_eq!(started.readout_s, 0.0, "a global shutter");
    }
}

#[test]
fn finds_a_readout_that_is_not_configured() {
    let mut world = sharp_world(6);
    (world.readout_s, world.time_offset_s) = (0.025, -0.03);
    let started = fly(&mut world, steady);
    is_sound(&world, &started);
    // Rows are known to 5 ms.
    assert!((started.readout_s - 0.025).abs() < 0.01, "{started:?}");
}

#[test]
fn starts_at_any_rate_and_at_rates_that_vary() {
    // 60 Hz, 10 Hz and 16 to 30 Hz, whatever the configuration says.
    let intervals: [fn(u32) -> f64; 3] =
        [|_| 1.0 / 60.0, |_| 0.1, |k| [0.04, 0.06, 0.05, 0.033][k as usize / 7 % 4]];
    for interval_s in intervals {
        let mut world = sharp_world(7);
        world.time_offset_s = -0.05;
        let started = fly(&mut world, interval_s);
        is_sound(&world, &started);
    }
}
