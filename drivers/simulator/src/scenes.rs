//! The scenes: a room full of texture, a large hall, and a room of plain painted walls.

use super::builder::{Builder, Wall};
use super::fittings::{
    beams, carpets, ceiling_lights, crate_finishes, floor_place, pictures, pilasters, skirting, wall_place,
};
use super::light::{Lighting, bake};
use super::pattern::{GRID_CELL_M, Material};
use super::solid::{Bounds, Solid};
use super::world::{Finish, World};
use nalgebra::Vector3;
use plumbline_config::Portable;

/// Height of the lowest pose above the floor, m: a drone on its legs.
const GROUND_M: f64 = 0.13;

/// Distance of everything in the far scene, m, and size of its patterns against the usual one.
const FAR_M: f64 = 80.0;
const FAR_ZOOM: f64 = 40.0;

/// A repeated pattern has its period in pixels of this focal length at this distance, m.
const REPEATED_AT_M: f64 = 3.0;
const REPEATED_FOCAL_PX: f64 = 458.0;
/// Side of a spot on a bare wall, m.
const SPOT_M: f64 = 0.06;
/// Views of a camera that cover the sphere: 1.25 sr each.
const VIEWS_OF_SPHERE: f64 = 10.0;

/// Scene of the flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Scene {
    /// A furnished room, walls 1 to 2 m beyond the flight, texture everywhere.
    Room,
    /// A large hall with pillars, machines and crates, walls up to 10 m beyond the flight.
    Hall,
    /// A room of plain painted walls: edges everywhere, points scarce.
    LowTexture,
    /// High above everything: ground, walls and ceiling some 80 m away.
    Far,
}

impl Scene {
    /// The scene that is called `room`, `hall`, `low-texture` or `far`.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "room" => Some(Self::Room),
            "hall" => Some(Self::Hall),
            "low-texture" => Some(Self::LowTexture),
            "far" => Some(Self::Far),
            _ => None,
        }
    }
}

/// Change of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Surroundings {
    /// It stays.
    #[default]
    Usual,
    /// One pattern on everything, which repeats itself.
    Repeated {
        /// Period at a distance of 3 m, px of the preset `sim` at full size.
        period_px: f64,
    },
    /// Plain walls without furniture.
    Bare {
        /// Dark spots in a view.
        spots: f64,
    },
}

const fn finish(material: Material) -> Finish {
    Finish::of(material)
}

/// Builds `scene` around the flight through `path` (positions in the world, m).
pub(super) fn build(scene: Scene, seed: u64, path: &[Vector3<f64>], surroundings: Surroundings) -> World {
    let flight = Bounds::around(path);
    let builder = Builder::new(seed, path);
    let mut builder = match surroundings {
        Surroundings::Usual => builder,
        Surroundings::Repeated { period_px } => {
            let zoom = period_px * REPEATED_AT_M / REPEATED_FOCAL_PX / GRID_CELL_M;
            builder.wrapped_in(Finish::of(Material::Grid).zoomed(zoom))
        }
        Surroundings::Bare { spots } => return bare(builder, &flight, spots),
    };
    let lighting = match scene {
        Scene::Room => room(&mut builder, &flight),
        Scene::Hall => hall(&mut builder, &flight),
        Scene::Far => far(&mut builder, &flight),
        Scene::LowTexture => plain_room(&mut builder, &flight),
    };
    bake(&mut builder.surfaces, &builder.casters, &lighting);
    World::new(builder.surfaces)
}

/// An empty room with dark spots on its walls, floor and ceiling: about `spots` of them in a view from its middle.
fn bare(mut b: Builder<'_>, flight: &Bounds, spots: f64) -> World {
    let bounds = room_around(flight);
    let plain = |level: f32| Finish::of(Material::Paint).toned(level, level);
    let tones = [0.62, 0.55, 0.66, 0.58].map(plain);
    let walls = b.shell(&bounds, plain(0.4), plain(0.7), tones);
    let size = bounds.high - bounds.low;
    let sides = [walls[0].length * size.z, walls[1].length * size.z, size.x * size.y];
    let total = 2.0 * sides.iter().sum::<f64>();
    let count = (spots * VIEWS_OF_SPHERE).round() as usize;
    for _ in 0..count {
        let place = b.draws.range(0.0, total);
        let mut at = |length: f64| b.draws.range(SPOT_M, (length - SPOT_M).at_least(2.0 * SPOT_M));
        let walls_end = 2.0 * (sides[0] + sides[1]);
        if place < walls_end {
            let wall = walls[usize::from(place >= 2.0 * sides[0]) + 2 * usize::from(place % 2.0 < 1.0)];
            let panel = wall.panel(at(wall.length), at(wall.height), [SPOT_M, SPOT_M], 0.002);
            b.attach(&panel, plain(0.12));
            continue;
        }
        let (x, y) = (bounds.low.x + at(size.x), bounds.low.y + at(size.y));
        if place < walls_end + sides[2] {
            b.lay(
                &Solid::standing(Vector3::new(x, y, bounds.low.z), [SPOT_M, SPOT_M, 0.002], 0.3),
                plain(0.12),
            );
        } else {
            b.hang(
                &Solid::standing(Vector3::new(x, y, bounds.high.z - 0.002), [SPOT_M, SPOT_M, 0.002], 0.3),
                plain(0.12),
            );
        }
    }
    bake(&mut b.surfaces, &b.casters, &Lighting { ambient: 200.0, step_m: 1.0, lamps: Vec::new() });
    World::new(b.surfaces)
}

fn grown(flight: &Bounds, sides_m: [f64; 2], above_m: f64) -> Bounds {
    let low = flight.low - Vector3::new(sides_m[0], sides_m[1], GROUND_M);
    Bounds { low, high: flight.high + Vector3::new(sides_m[1], sides_m[0], above_m) }
}

/// The room around a flight.
fn room_around(flight: &Bounds) -> Bounds {
    grown(flight, [1.6, 1.4], 1.1)
}

fn room(b: &mut Builder<'_>, flight: &Bounds) -> Lighting {
    let bounds = room_around(flight);
    let walls = [
        finish(Material::Bricks),
        finish(Material::Plaster),
        finish(Material::Concrete),
        finish(Material::Bricks).toned(0.2, 1.05).zoomed(1.2),
    ];
    let floor = finish(Material::Wood).zoomed(1.1);
    let walls = b.shell(&bounds, floor, finish(Material::Concrete).toned(0.1, 1.0), walls);
    let lamps = ceiling_lights(b, &bounds, 2.6, (135.0, 2.6));
    for wall in &walls {
        pictures(b, wall, 0.85, 0.75);
        skirting(b, wall, finish(Material::Wood).toned(0.0, 0.5));
    }
    carpets(b, &bounds, 2);
    let fill = crate_finishes();
    for wall in &walls {
        let foot = wall_place(b, wall, 1.2, 0.22);
        b.shelf(foot, [1.2, 0.36, 1.9], wall.yaw(), &fill[..3]);
        let foot = wall_place(b, wall, 1.4, 0.42);
        b.table(foot, [1.4, 0.7, 0.75], wall.yaw(), finish(Material::Wood).zoomed(0.6));
        for _ in 0..4 {
            let foot = wall_place(b, wall, 0.6, 0.45);
            let side = b.draws.range(0.35, 0.62);
            b.stack(foot, side, &fill);
        }
    }
    for _ in 0..12 {
        let foot = floor_place(b, &bounds, 0.5);
        let side = b.draws.range(0.3, 0.55);
        b.stack(foot, side, &fill);
    }
    Lighting { ambient: 105.0, step_m: 0.3, lamps }
}

fn hall(b: &mut Builder<'_>, flight: &Bounds) -> Lighting {
    let mut bounds = grown(flight, [7.0, 4.5], 3.5);
    bounds.high.z = bounds.high.z.at_least(bounds.low.z + 7.0);
    let walls = [
        finish(Material::Bricks).zoomed(2.0),
        finish(Material::Concrete).zoomed(2.5),
        finish(Material::Metal).zoomed(3.0),
        finish(Material::Bricks).zoomed(1.6).toned(0.15, 1.1),
    ];
    let floor = finish(Material::Concrete).zoomed(1.1);
    let walls = b.shell(&bounds, floor, finish(Material::Metal).zoomed(4.0).toned(0.05, 0.9), walls);
    let lamps = ceiling_lights(b, &bounds, 7.5, (170.0, 7.0));
    for wall in &walls {
        pictures(b, wall, 2.2, 0.55);
        pilasters(b, wall);
    }
    beams(b, &bounds);
    carpets(b, &bounds, 6);
    let fill = crate_finishes();
    for wall in &walls {
        for _ in 0..(wall.length / 6.0) as usize {
            let foot = wall_place(b, wall, 2.0, 0.75);
            b.shelf(foot, [1.8, 0.6, 2.4], wall.yaw(), &fill[..3]);
        }
    }
    for i in 0..200 {
        let foot = floor_place(b, &bounds, 1.6);
        match i % 3 {
            0 => machine(b, foot),
            1 => pillar(b, foot, bounds.high.z - bounds.low.z),
            _ => {
                let side = b.draws.range(0.6, 1.2);
                b.stack(foot, side, &fill);
            }
        }
    }
    Lighting { ambient: 95.0, step_m: 0.7, lamps }
}

/// Detail at every scale, sixty times as large as in a room, and as far away.
fn far(b: &mut Builder<'_>, flight: &Bounds) -> Lighting {
    let mut bounds = grown(flight, [FAR_M, FAR_M], FAR_M);
    bounds.low.z -= FAR_M;
    let look = |material| finish(material).zoomed(FAR_ZOOM);
    let walls = [Material::Bricks, Material::Stones, Material::Concrete, Material::Posters].map(look);
    b.shell(&bounds, look(Material::Stones), look(Material::Concrete), walls);
    Lighting { ambient: 200.0, step_m: 8.0, lamps: Vec::new() }
}

fn pillar(b: &mut Builder<'_>, foot: Vector3<f64>, height: f64) {
    let side = b.draws.range(0.45, 0.8);
    let solid = Solid::standing(foot, [side, side, height], b.draws.range(0.0, 1.5));
    if b.reserve(&solid.bounds()) {
        let kind = [Material::Bricks, Material::Tiles, Material::Posters][b.draws.index(3)];
        b.stand(&solid, finish(kind));
    }
}

/// A block with smaller blocks on it.
fn machine(b: &mut Builder<'_>, foot: Vector3<f64>) {
    let size = [b.draws.range(1.4, 2.6), b.draws.range(0.9, 1.6), b.draws.range(0.8, 1.5)];
    let yaw = b.draws.range(-0.8, 0.8);
    let base = Solid::standing(foot, size, yaw);
    let tall = Solid::standing(foot, [size[0], size[1], size[2] + 0.9], yaw);
    let whole = if b.is_clear(&tall.bounds()) { tall } else { base };
    if !b.reserve(&whole.bounds()) {
        return;
    }
    b.stand(&base, finish(Material::Metal).zoomed(1.2));
    if whole.half.z > base.half.z {
        let [a, _] = base.axes();
        for side in [-0.28, 0.25] {
            let at = foot + a * (side * size[0]) + Vector3::z() * size[2];
            let part = [0.4 * size[0], 0.7 * size[1], b.draws.range(0.3, 0.88)];
            let kind = [Material::Labels, Material::Metal, Material::Stones][b.draws.index(3)];
            b.stand(&Solid::standing(at, part, yaw), finish(kind));
        }
    }
}

fn plain_room(b: &mut Builder<'_>, flight: &Bounds) -> Lighting {
    let bounds = room_around(flight);
    let wall = finish(Material::Paint);
    let tones = [0.86, 0.78, 0.92, 0.82].map(|bright| wall.toned(0.0, bright));
    let floor = finish(Material::Panels).toned(0.05, 0.85).zoomed(1.3);
    let ceiling = finish(Material::Panels).zoomed(1.4);
    let walls = b.shell(&bounds, floor, ceiling, tones);
    let lamps = ceiling_lights(b, &bounds, 2.4, (130.0, 2.6));
    for (k, wall) in walls.iter().enumerate() {
        plain_wall(b, wall, k);
    }
    for wall in &walls {
        let top = finish(Material::Paint).toned(0.0, 0.7);
        let foot = wall_place(b, wall, 1.4, 0.45);
        b.table(foot, [1.4, 0.7, 0.75], wall.yaw(), top);
        for _ in 0..3 {
            let foot = wall_place(b, wall, 0.6, 0.45);
            let side = b.draws.range(0.35, 0.55);
            let looks = [0.45, 0.8, 1.15].map(|bright| finish(Material::Paint).toned(0.0, bright));
            b.stack(foot, side, &looks);
        }
    }
    Lighting { ambient: 105.0, step_m: 0.3, lamps }
}

/// Skirting, rail, panels, a door or windows, sockets: edges without texture.
fn plain_wall(b: &mut Builder<'_>, wall: &Wall, number: usize) {
    let trim = finish(Material::Paint).toned(0.0, 1.08);
    let dark = finish(Material::Paint).toned(0.0, 0.5);
    skirting(b, wall, finish(Material::Paint).toned(0.0, 0.62));
    b.attach(&wall.panel(0.0, 1.05, [wall.length, 0.07], 0.03), trim);
    let count = (wall.length / 0.95).floor().at_least(2.0);
    let pitch = wall.length / count;
    for i in 0..count as usize {
        let at = (i as f64) * pitch;
        frame(b, wall, [at + 0.12, 0.2], [pitch - 0.24, 0.72], 0.035, trim);
        if i % 3 == 1 {
            b.attach(&wall.panel(at + 0.45 * pitch, 0.28, [0.085, 0.085], 0.015), dark);
        }
        if (i + number).is_multiple_of(4) && wall.height > 2.0 {
            let pane = finish(Material::Paint).toned(0.0, 0.3 + 0.12 * (i % 3) as f32);
            let (w, h) = (pitch - 0.2, (wall.height - 1.55).at_most(1.1));
            b.attach(&wall.panel(at + 0.1, 1.3, [w, h], 0.01), pane);
            frame(b, wall, [at + 0.1, 1.3], [w, h], 0.06, trim);
            b.attach(&wall.panel(at + 0.1 + 0.5 * w - 0.02, 1.3, [0.04, h], 0.03), trim);
            b.attach(&wall.panel(at + 0.1, 1.3 + 0.6 * h, [w, 0.035], 0.028), trim);
        } else if (i + number) % 4 == 2 {
            let (w, h) = (pitch - 0.2, (wall.height - 1.5).at_most(1.1));
            frame(b, wall, [at + 0.1, 1.3], [w, h], 0.03, dark);
            let field = finish(Material::Paint).toned(0.0, 0.6);
            b.attach(&wall.panel(at + 0.1 + 0.3 * w, 1.3 + 0.3 * h, [0.4 * w, 0.4 * h], 0.012), field);
        }
    }
    b.attach(&wall.panel(0.0, wall.height - 0.12, [wall.length, 0.1], 0.06), trim);
}

/// Four bars around a rectangle on a wall.
fn frame(b: &mut Builder<'_>, wall: &Wall, at: [f64; 2], size: [f64; 2], bar: f64, look: Finish) {
    let depth = 0.025;
    b.attach(&wall.panel(at[0], at[1], [size[0], bar], depth), look);
    b.attach(&wall.panel(at[0], at[1] + size[1] - bar, [size[0], bar], depth), look);
    b.attach(&wall.panel(at[0], at[1] + bar, [bar, size[1] - 2.0 * bar], depth), look);
    b.attach(&wall.panel(at[0] + size[0] - bar, at[1] + bar, [bar, size[1] - 2.0 * bar], depth), look);
}
