//! A room with mats on its walls and little on its floor: strips and play mats on a carpet.

use super::builder::{Builder, Wall};
use super::fittings::{carpets, ceiling_lights, floor_place};
use super::light::Lighting;
use super::pattern::Material;
use super::solid::{Bounds, Solid};
use super::world::Finish;
use nalgebra::Vector3;
use plumbline_config::Portable;

/// Floor below the lowest pose, m: the vehicle starts from a stand.
const BELOW_M: f64 = 0.9;
/// Walls and ceiling beyond the flight, m.
const SIDES_M: [f64; 2] = [1.8, 1.6];
const ABOVE_M: f64 = 1.6;
/// Tones of walls and ceiling, and of the carpet, least and largest.
const PLAIN: (f64, f64) = (0.5, 0.85);
const CARPET: (f64, f64) = (0.45, 0.65);
/// Height of mats, m, and their width, least and largest.
const MAT_HEIGHT_M: f64 = 2.0;
const MAT_WIDTH_M: (f64, f64) = (0.9, 1.4);
/// Play mats, with strong edges, and strips on the floor for each square metre.
const PLAY_MATS_PER_M2: f64 = 0.025;
const STRIPS_PER_M2: f64 = 0.2;
/// Height of a truss above the floor, its own height, distance of its posts and width of its bars, m.
const TRUSS_M: [f64; 4] = [2.7, 0.3, 0.4, 0.05];
/// Share of mats that lie on their side in front of others.
const LYING: f64 = 0.35;
/// Chance of a window on every two metres of wall, and its grey level, above white.
const WINDOWS: f64 = 0.5;
const WINDOW_GLOW: f32 = 320.0;

/// Builds the room around `flight`.
pub(super) fn real_room(b: &mut Builder<'_>, flight: &Bounds) -> Lighting {
    let low = flight.low - Vector3::new(SIDES_M[0], SIDES_M[1], BELOW_M);
    let bounds = Bounds { low, high: flight.high + Vector3::new(SIDES_M[1], SIDES_M[0], ABOVE_M) };
    let tone = b.draws.range(CARPET.0, CARPET.1) as f32;
    let carpet = Finish::of(Material::Concrete).zoomed(0.8).toned(0.8 * tone, 1.2 * tone);
    let (ceiling, walls) = (plain(b), [(); 4].map(|()| plain(b)));
    let walls = b.as_given(|b| b.shell(&bounds, carpet, ceiling, walls));
    let lamps = ceiling_lights(b, &bounds, 2.6, (135.0, 2.6));
    for wall in &walls {
        mats(b, wall);
        windows(b, wall);
        truss(b, wall);
    }
    let area = (bounds.high - bounds.low).xy().product();
    b.as_given(|b| carpets(b, &bounds, (area * PLAY_MATS_PER_M2).round() as usize));
    for _ in 0..(area * STRIPS_PER_M2) as usize {
        strip(b, &bounds);
    }
    for _ in 0..3 {
        let foot = floor_place(b, &bounds, 0.8);
        let side = b.draws.range(0.3, 0.55);
        b.stack(foot, side, &[Finish::of(Material::Labels), Finish::of(Material::Wood)]);
    }
    Lighting { ambient: 125.0, step_m: 0.3, lamps }
}

/// Finish of a plain wall or ceiling.
fn plain(b: &mut Builder<'_>) -> Finish {
    let tone = b.draws.range(PLAIN.0, PLAIN.1) as f32;
    Finish::of(Material::Plaster).toned(0.92 * tone, 1.04 * tone)
}

/// Mats side by side along a wall, some lying in front.
fn mats(b: &mut Builder<'_>, wall: &Wall) {
    let mut at = b.draws.range(0.0, 0.1);
    loop {
        let width = b.draws.range(MAT_WIDTH_M.0, MAT_WIDTH_M.1);
        if at + width > wall.length {
            return;
        }
        let (depth, tall) = (b.draws.range(0.08, 0.3), MAT_HEIGHT_M * b.draws.range(0.92, 1.0));
        let look = cloth(b);
        b.as_given(|b| b.attach(&wall.panel(at, 0.0, [width, tall.at_most(wall.height - 0.1)], depth), look));
        if b.draws.unit() < LYING && at + MAT_HEIGHT_M < wall.length {
            let look = cloth(b);
            b.as_given(|b| b.attach(&wall.panel(at, 0.0, [MAT_HEIGHT_M, width], depth + 0.15), look));
        }
        at += width + b.draws.range(0.01, 0.12);
    }
}

/// Cloth of a mat, with folds.
fn cloth(b: &mut Builder<'_>) -> Finish {
    let (tone, contrast) = (b.draws.range(0.34, 0.62) as f32, b.draws.range(0.3, 0.6) as f32);
    let zoom = b.draws.range(0.8, 1.4);
    Finish::of(Material::Folds).zoomed(zoom).toned(tone * (1.0 - contrast), tone * (1.0 + contrast))
}

/// Windows, brighter than the sensor's white.
fn windows(b: &mut Builder<'_>, wall: &Wall) {
    let count = (wall.length / 2.0) as usize;
    for k in 0..count {
        let (width, at) = (b.draws.range(0.9, 1.5), (k as f64 + 0.2) * wall.length / count as f64);
        let bottom = b.draws.range(0.9, 1.3);
        if b.draws.unit() < WINDOWS && bottom + 1.0 < wall.height {
            let tall = (wall.height - bottom - 0.3).at_most(1.4);
            b.attach(
                &wall.panel(at, bottom, [width, tall], 0.02),
                Finish::of(Material::Paint).glowing(WINDOW_GLOW),
            );
        }
    }
}

/// A dark truss along a wall, which carries the cameras of a tracker.
fn truss(b: &mut Builder<'_>, wall: &Wall) {
    let look = Finish::of(Material::Paint).toned(0.0, 0.12);
    let [at, tall, pitch, bar] = TRUSS_M;
    let at = at.at_most(wall.height - 0.5);
    b.as_given(|b| {
        for z in [at, at + tall] {
            b.attach(&wall.panel(0.0, z, [wall.length, bar], bar), look);
        }
        for k in 0..(wall.length / pitch) as usize {
            b.attach(&wall.panel(k as f64 * pitch, at, [bar, tall], bar), look);
        }
    });
}

/// A dark strip with bright scraps on the floor.
fn strip(b: &mut Builder<'_>, bounds: &Bounds) {
    let foot = floor_place(b, bounds, 0.7);
    let (long, wide, yaw) = (b.draws.range(0.8, 3.0), b.draws.range(0.08, 0.14), b.draws.range(-1.5, 1.5));
    let look = Finish::of(Material::Scraps).toned(0.02, 1.0);
    b.as_given(|b| b.lay(&Solid::standing(foot, [long, wide, 0.004], yaw), look));
}
