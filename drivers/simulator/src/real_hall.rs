//! A machine hall: cabinets with framed doors, machines with small parts, tanks and pipes, railings and pallets, mostly of plain
//! surfaces, so that edges and corners are those of things that stand one before another.

use super::builder::{Builder, Wall};
use super::fittings::{beams, ceiling_lights, crate_finishes, floor_place, pilasters, wall_place};
use super::light::Lighting;
use super::pattern::Material;
use super::real_things::{bar, framed_side, tube};
use super::solid::{Bounds, Solid};
use super::world::Finish;
use nalgebra::Vector3;
use plumbline_config::Portable;

/// Floor below the lowest pose, m: the vehicle starts from a platform.
const BELOW_M: f64 = 2.0;
/// Walls beyond the flight, m, and least height of the hall.
const SIDES_M: [f64; 2] = [6.0, 4.5];
const HEIGHT_M: f64 = 8.0;
/// Attempts to place a thing, for each square metre of the floor.
const THINGS_PER_M2: f64 = 0.9;
/// Attempts to place a pipe across the hall, and length of wall for each pipe along it, m.
const OVERHEAD: usize = 10;
const WALL_PIPES_M: f64 = 5.0;

/// Builds the hall around `flight`.
pub(super) fn real_hall(b: &mut Builder<'_>, flight: &Bounds) -> Lighting {
    let low = flight.low - Vector3::new(SIDES_M[0], SIDES_M[1], BELOW_M);
    let mut bounds = Bounds { low, high: flight.high + Vector3::new(SIDES_M[1], SIDES_M[0], 3.5) };
    bounds.high.z = bounds.high.z.at_least(bounds.low.z + HEIGHT_M);
    let metal = Finish::of(Material::Metal).zoomed(3.0);
    let walls =
        [metal, Finish::of(Material::Concrete).zoomed(2.5), Finish::of(Material::Bricks).zoomed(1.6), metal];
    let walls = b.shell(&bounds, Finish::of(Material::Tiles).zoomed(1.5), metal, walls);
    let lamps = ceiling_lights(b, &bounds, 7.5, (170.0, 7.0));
    for wall in &walls {
        pilasters(b, wall);
        wall_pipes(b, wall);
        for _ in 0..(wall.length / 5.0) as usize {
            let foot = wall_place(b, wall, 2.0, 0.75);
            b.shelf(foot, [1.8, 0.6, 2.4], wall.yaw(), &crate_finishes()[..3]);
        }
    }
    beams(b, &bounds);
    overhead_pipes(b, &bounds);
    let size = bounds.high - bounds.low;
    for i in 0..(size.x * size.y * THINGS_PER_M2) as usize {
        let foot = floor_place(b, &bounds, 1.2);
        match i % 7 {
            0 | 4 => cabinet(b, foot),
            1 => machine(b, foot),
            2 => tank(b, foot, size.z),
            3 | 6 => railing(b, foot),
            _ => pallets(b, foot),
        }
    }
    Lighting { ambient: 95.0, step_m: 0.7, lamps }
}

/// Pipes along a wall, one above the other.
fn wall_pipes(b: &mut Builder<'_>, wall: &Wall) {
    let count = (wall.length / WALL_PIPES_M) as usize;
    for _ in 0..count {
        let (radius, long) = (b.draws.range(0.06, 0.35), b.draws.range(2.0, 6.0).at_most(0.8 * wall.length));
        let from = b.draws.range(0.1, wall.length - long - 0.05);
        let out = wall.inward() * (radius + 0.4);
        let start =
            wall.origin + wall.along * from + out + Vector3::z() * b.draws.range(0.8, wall.height - 1.0);
        tube(b, start, wall.along * long, radius);
    }
}

/// Pipes across the hall, where the flight leaves room.
fn overhead_pipes(b: &mut Builder<'_>, bounds: &Bounds) {
    for _ in 0..OVERHEAD {
        let size = bounds.high - bounds.low;
        let radius = b.draws.range(0.12, 0.45);
        let height = b.draws.range(0.35, 0.9) * size.z;
        let (along, across) =
            if b.draws.unit() < 0.5 { (Vector3::x(), Vector3::y()) } else { (Vector3::y(), Vector3::x()) };
        let (reach, width) = (along.dot(&size), across.dot(&size));
        let at = b.draws.range(0.05, 0.95) * width;
        let start = bounds.low + across * at + Vector3::z() * height;
        let room = |end: Vector3<f64>| Bounds {
            low: start.inf(&end).add_scalar(-radius),
            high: start.sup(&end).add_scalar(radius),
        };
        if b.is_clear(&room(start + along * reach)) {
            tube(b, start, along * reach, radius);
        }
    }
}

/// A cabinet with framed doors.
fn cabinet(b: &mut Builder<'_>, foot: Vector3<f64>) {
    let size = [b.draws.range(0.8, 2.6), b.draws.range(0.5, 1.4), b.draws.range(0.9, 2.8)];
    let yaw = if b.draws.unit() < 0.7 { 0.0 } else { b.draws.range(-0.8, 0.8) };
    let solid = Solid::standing(foot, size, yaw);
    if !b.reserve(&solid.bounds()) {
        return;
    }
    b.stand(&solid, Finish::of(Material::Paint));
    let doors = b.draws.range(1.0, 4.99) as usize;
    framed_side(b, &solid, 1.0, doors);
    framed_side(b, &solid, -1.0, doors);
    if b.draws.unit() < 0.5 {
        clutter(b, &solid, 3);
    }
}

/// A block with blocks, pipes and small parts on it.
fn machine(b: &mut Builder<'_>, foot: Vector3<f64>) {
    let size = [b.draws.range(1.0, 2.6), b.draws.range(0.7, 1.6), b.draws.range(0.4, 1.3)];
    let yaw = b.draws.range(-0.8, 0.8);
    let base = Solid::standing(foot, size, yaw);
    let whole = Solid::standing(foot, [size[0], size[1], size[2] + 0.8], yaw);
    if !b.reserve(&whole.bounds()) {
        return;
    }
    b.stand(&base, Finish::of(Material::Metal).zoomed(1.2));
    clutter(b, &base, 9);
    let [a, c] = base.axes();
    for side in [-0.3, 0.25] {
        let (radius, rise) = (b.draws.range(0.05, 0.16), b.draws.range(0.3, 0.75));
        let from =
            foot + a * (side * size[0]) + c * (b.draws.range(-0.25, 0.25) * size[1]) + Vector3::z() * size[2];
        tube(b, from, Vector3::z() * rise, radius);
    }
}

/// Small things on top of a solid, where the flight leaves room.
fn clutter(b: &mut Builder<'_>, below: &Solid, count: usize) {
    let [a, c] = below.axes();
    let top = below.centre + Vector3::z() * below.half.z;
    for _ in 0..count {
        let size = [b.draws.range(0.06, 0.4), b.draws.range(0.06, 0.4), b.draws.range(0.05, 0.35)];
        let at = top
            + a * (b.draws.range(-0.8, 0.8) * below.half.x)
            + c * (b.draws.range(-0.8, 0.8) * below.half.y);
        let yaw = below.yaw + b.draws.range(-0.4, 0.4);
        let thing = Solid::standing(at, size, yaw);
        if b.is_clear(&thing.bounds()) {
            b.lay(&thing, Finish::of(Material::Labels).zoomed(0.5));
        }
    }
}

/// A standing tank of sheet metal.
fn tank(b: &mut Builder<'_>, foot: Vector3<f64>, height: f64) {
    let (radius, tall) = (b.draws.range(0.15, 0.6), b.draws.range(0.25, 0.7) * height);
    let solid = Solid::standing(foot, [2.2 * radius, 2.2 * radius, tall], 0.0);
    if b.reserve(&solid.bounds()) {
        b.casters.push(solid);
        tube(b, foot, Vector3::z() * (tall - 0.08), radius);
        let lid = foot + Vector3::z() * (tall - 0.08);
        b.lay(&Solid::standing(lid, [2.1 * radius, 2.1 * radius, 0.08], 0.0), Finish::of(Material::Metal));
    }
}

/// A railing: posts and rails, with a view of what is behind.
fn railing(b: &mut Builder<'_>, foot: Vector3<f64>) {
    let (long, tall) = (b.draws.range(1.5, 5.0), b.draws.range(0.9, 1.2));
    let yaw = if b.draws.unit() < 0.5 { 0.0 } else { std::f64::consts::FRAC_PI_2 };
    let lift = if b.draws.unit() < 0.5 { 0.0 } else { b.draws.range(0.5, 1.8) };
    let whole = Solid::standing(foot, [long, 0.1, lift + tall], yaw);
    if !b.reserve(&whole.bounds()) {
        return;
    }
    let ([a, _], up) = (whole.axes(), Vector3::z());
    let look = bar(b);
    let spans = (long / 0.9).ceil();
    for k in 0..=spans as usize {
        let at = foot + a * (long * (k as f64 / spans - 0.5));
        b.as_given(|b| b.lay(&Solid::standing(at, [0.045, 0.045, lift + tall], yaw), look));
    }
    for height in [0.35, 0.68, 1.0] {
        let at = foot + up * (lift + height * tall - 0.045);
        b.as_given(|b| b.hang(&Solid::standing(at, [long, 0.045, 0.045], yaw), look));
    }
}

/// A stack of pallets: boards with gaps.
fn pallets(b: &mut Builder<'_>, foot: Vector3<f64>) {
    let (count, yaw) = (1 + b.draws.index(5), b.draws.range(-0.8, 0.8));
    let whole = Solid::standing(foot, [1.2, 0.8, 0.15 * count as f64 + 0.1], yaw);
    if !b.reserve(&whole.bounds()) {
        return;
    }
    let [a, c] = whole.axes();
    let wood = Finish::of(Material::Wood).zoomed(0.6);
    for layer in 0..count {
        let at = foot + Vector3::z() * (0.15 * layer as f64);
        for side in [-0.35, 0.0, 0.35] {
            b.lay(&Solid::standing(at + c * side, [1.2, 0.1, 0.12], yaw), wood);
        }
        for slat in 0..6 {
            let at = at + a * (0.22 * slat as f64 - 0.55) + Vector3::z() * 0.12;
            b.lay(&Solid::standing(at, [0.14, 0.8, 0.025], yaw), wood);
        }
    }
    if b.draws.unit() < 0.5 {
        let load = Solid::standing(foot + Vector3::z() * (0.15 * count as f64), [1.1, 0.72, 0.0], yaw);
        clutter(b, &load, 5);
    }
}
