//! Fittings that scenes share: lamps, pictures, carpets, pilasters and beams, and places for furniture.

use super::builder::{Builder, Wall};
use super::light::Lamp;
use super::pattern::Material;
use super::solid::{Bounds, Solid};
use super::world::Finish;
use nalgebra::Vector3;
use plumbline_config::Portable;

/// Ceiling panels that shine, in a grid of about `pitch_m`, and their lamps.
pub(super) fn ceiling_lights(
    b: &mut Builder<'_>,
    bounds: &Bounds,
    pitch_m: f64,
    lamp: (f64, f64),
) -> Vec<Lamp> {
    let size = bounds.high - bounds.low;
    let count = [0, 1].map(|k| (size[k] / pitch_m).round().at_least(1.0));
    let mut lamps = Vec::new();
    for i in 0..count[0] as usize {
        for j in 0..count[1] as usize {
            let x = bounds.low.x + (i as f64 + 0.5) * size.x / count[0];
            let y = bounds.low.y + (j as f64 + 0.5) * size.y / count[1];
            let at = Vector3::new(x, y, bounds.high.z - 0.06);
            let glow = Finish::of(Material::Paint).glowing(b.draws.range(285.0, 330.0) as f32);
            b.hang(&Solid::standing(at, [1.2, 0.35, 0.06], 0.0), glow);
            let p_w = at - Vector3::new(0.0, 0.0, 0.15);
            lamps.push(Lamp { p_w, strength: lamp.0 * b.draws.range(0.85, 1.15), reach_m: lamp.1 });
        }
    }
    lamps
}

/// Pictures in a grid over a wall, at most `size_m` wide.
pub(super) fn pictures(b: &mut Builder<'_>, wall: &Wall, size_m: f64, chance: f64) {
    let cell = 1.35 * size_m;
    let columns = (wall.length / cell).floor().at_least(1.0);
    let rows = ((wall.height - 0.3) / cell).floor().at_least(1.0);
    for i in 0..columns as usize {
        for j in 0..rows as usize {
            if b.draws.unit() > chance {
                continue;
            }
            let size = [(); 2].map(|()| size_m * b.draws.range(0.55, 1.0));
            let pitch = [wall.length / columns, (wall.height - 0.3) / rows];
            let at = (i as f64 + 0.5) * pitch[0] - 0.5 * size[0] + b.draws.range(-0.1, 0.1) * size_m;
            let z = 0.2 + (j as f64 + 0.5) * pitch[1] - 0.5 * size[1];
            let kind = [Material::Posters, Material::Labels, Material::Stones][b.draws.index(3)];
            let look = Finish::of(kind).zoomed(b.draws.range(0.5, 1.3));
            let (dark, bright) = (b.draws.range(0.0, 0.15), b.draws.range(0.75, 1.05));
            b.attach(&wall.panel(at, z.at_least(0.05), size, 0.03), look.toned(dark as f32, bright as f32));
        }
    }
}

/// A random place on the floor, at least `inset_m` from the walls.
pub(super) fn floor_place(b: &mut Builder<'_>, bounds: &Bounds, inset_m: f64) -> Vector3<f64> {
    let x = b.draws.range(bounds.low.x + inset_m, bounds.high.x - inset_m);
    let y = b.draws.range(bounds.low.y + inset_m, bounds.high.y - inset_m);
    Vector3::new(x, y, bounds.low.z)
}

/// A place before a wall, `depth_m` from it to the centre.
pub(super) fn wall_place(b: &mut Builder<'_>, wall: &Wall, width_m: f64, depth_m: f64) -> Vector3<f64> {
    let at =
        b.draws.range(0.5 * width_m + 0.1, (wall.length - 0.5 * width_m - 0.1).at_least(0.5 * width_m + 0.2));
    wall.origin + wall.along * at + wall.inward() * depth_m
}

/// Finishes of crates and of what lies on shelves.
pub(super) fn crate_finishes() -> [Finish; 5] {
    [
        Finish::of(Material::Labels),
        Finish::of(Material::Wood).zoomed(0.7),
        Finish::of(Material::Posters).zoomed(0.6),
        Finish::of(Material::Stones).zoomed(0.7),
        Finish::of(Material::Metal).zoomed(0.8),
    ]
}

/// A board along the foot of a wall.
pub(super) fn skirting(b: &mut Builder<'_>, wall: &Wall, look: Finish) {
    b.attach(&wall.panel(0.0, 0.0, [wall.length, 0.1], 0.025), look);
}

/// Carpets, a few millimetres thick.
pub(super) fn carpets(b: &mut Builder<'_>, bounds: &Bounds, count: usize) {
    for i in 0..count {
        let foot = floor_place(b, bounds, 1.3);
        let size = [b.draws.range(1.4, 2.2), b.draws.range(1.0, 1.7), 0.006 + 0.003 * i as f64];
        let yaw = b.draws.range(-0.6, 0.6);
        let kind = [Material::Posters, Material::Stones, Material::Tiles][i % 3];
        b.lay(&Solid::standing(foot, size, yaw), Finish::of(kind).toned(0.05, 0.9));
    }
}

/// Pilasters along a wall.
pub(super) fn pilasters(b: &mut Builder<'_>, wall: &Wall) {
    let count = (wall.length / 5.0).floor().at_least(1.0);
    for i in 0..count as usize {
        let at = (i as f64 + 0.5) * wall.length / count - 0.3;
        b.attach(&wall.panel(at, 0.0, [0.6, wall.height], 0.35), Finish::of(Material::Tiles).zoomed(1.3));
    }
}

/// Beams below the ceiling, where the flight leaves room.
pub(super) fn beams(b: &mut Builder<'_>, bounds: &Bounds) {
    let size = bounds.high - bounds.low;
    let count = (size.x / 4.0).floor().at_least(1.0);
    for i in 0..count as usize {
        let x = bounds.low.x + (i as f64 + 0.5) * size.x / count;
        let foot = Vector3::new(x, bounds.low.y + 0.5 * size.y, bounds.high.z - 0.5);
        let beam = Solid::standing(foot, [0.35, size.y, 0.4], 0.0);
        if b.is_clear(&beam.bounds()) {
            b.solid(&beam, Finish::of(Material::Metal).zoomed(1.5).toned(0.0, 0.7));
        }
    }
}
