//! Building blocks of a scene: rectangles, solids and furniture that keep clear of the flight path.

use super::pattern::Material;
use super::solid::{Bounds, Solid};
use super::world::{Finish, LightMap, Surface};
use crate::random::{Draws, Purpose};
use nalgebra::Vector3;
use plumbline_config::Portable;
use std::f64::consts::FRAC_PI_2;

/// Least distance of furniture from the flight path, m.
pub(super) const CLEARANCE_M: f64 = 0.6;

/// Faces of a solid that may be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Face {
    Side,
    /// Towards negative y of the solid's own frame.
    Back,
    Above,
    Below,
}

/// One wall seen from inside: `origin` at the floor, on the left end when one looks from outside.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wall {
    pub(super) origin: Vector3<f64>,
    /// Direction along the wall, horizontal unit vector; the inside is on its left.
    pub(super) along: Vector3<f64>,
    pub(super) length: f64,
    pub(super) height: f64,
}

impl Wall {
    /// Heading of `along`, rad.
    pub(super) fn yaw(&self) -> f64 {
        libm::atan2(self.along.y, self.along.x)
    }

    /// Unit normal, into the room.
    pub(super) fn inward(&self) -> Vector3<f64> {
        Vector3::z().cross(&self.along)
    }

    /// A solid on the wall, from `at` along it and `z` above the floor.
    pub(super) fn panel(&self, at: f64, z: f64, size: [f64; 2], depth: f64) -> Solid {
        let centre = self.origin
            + self.along * (at + 0.5 * size[0])
            + self.inward() * (0.5 * depth)
            + Vector3::z() * (z + 0.5 * size[1]);
        Solid { centre, half: Vector3::new(size[0], depth, size[1]) * 0.5, yaw: self.yaw() }
    }
}

/// A scene under construction.
pub(super) struct Builder<'a> {
    pub(super) surfaces: Vec<Surface>,
    /// Solids that cast shadows.
    pub(super) casters: Vec<Solid>,
    pub(super) draws: Draws,
    path: &'a [Vector3<f64>],
    taken: Vec<Bounds>,
    wrapping: Option<Finish>,
}

impl<'a> Builder<'a> {
    /// An empty scene around the flight through `path`.
    pub(super) fn new(seed: u64, path: &'a [Vector3<f64>]) -> Self {
        let draws = Draws::new(seed, Purpose::Layout, 0);
        Self { surfaces: Vec::new(), casters: Vec::new(), draws, path, taken: Vec::new(), wrapping: None }
    }

    /// Returns the scene with `finish` on everything that does not shine.
    pub(super) fn wrapped_in(self, finish: Finish) -> Self {
        Self { wrapping: Some(finish), ..self }
    }

    /// A rectangle, seen from the side of `u x v`.
    pub(super) fn quad(&mut self, origin: Vector3<f64>, u: Vector3<f64>, v: Vector3<f64>, finish: Finish) {
        let finish = self.wrapped(finish);
        self.place(origin, u, v, finish);
    }

    /// Finish in place of `finish`, of everything that does not shine.
    fn wrapped(&self, finish: Finish) -> Finish {
        self.wrapping.filter(|_| finish.glow == 0.0).unwrap_or(finish)
    }

    fn place(&mut self, origin: Vector3<f64>, u: Vector3<f64>, v: Vector3<f64>, finish: Finish) {
        let density = finish.material.texels_per_m() / finish.zoom;
        let texel_origin = [(); 2].map(|()| self.draws.range(0.0, 1024.0).round() as f32);
        let texels = [(u.norm() * density) as f32, (v.norm() * density) as f32];
        let normal = u.cross(&v).normalize();
        let light = LightMap::uniform(0.0);
        let surface = Surface { origin, edge_u: u, edge_v: v, normal, finish, texel_origin, texels, light };
        self.surfaces.push(surface);
    }

    /// All six faces of a solid, which casts a shadow.
    pub(super) fn solid(&mut self, solid: &Solid, finish: Finish) {
        self.casters.push(*solid);
        self.faces(solid, finish, None);
    }

    /// A solid that stands on the floor: nobody sees its lower face.
    pub(super) fn stand(&mut self, solid: &Solid, finish: Finish) {
        self.casters.push(*solid);
        self.faces(solid, finish, Some(Face::Below));
    }

    /// A solid on a wall, too flat for a shadow; nobody sees its back.
    pub(super) fn attach(&mut self, panel: &Solid, finish: Finish) {
        self.faces(panel, finish, Some(Face::Back));
    }

    /// A solid on the floor, too flat for a shadow.
    pub(super) fn lay(&mut self, solid: &Solid, finish: Finish) {
        self.faces(solid, finish, Some(Face::Below));
    }

    /// A solid below the ceiling, without a shadow; nobody sees its upper face.
    pub(super) fn hang(&mut self, solid: &Solid, finish: Finish) {
        self.faces(solid, finish, Some(Face::Above));
    }

    fn faces(&mut self, solid: &Solid, finish: Finish, hidden: Option<Face>) {
        let ([a, b], h) = (solid.axes(), solid.half);
        let (x, y, z) = (a * h.x, b * h.y, Vector3::z() * h.z);
        let c = solid.centre;
        let finish = self.wrapped(finish);
        let all = [
            (Face::Side, c + x - y - z, 2.0 * y, 2.0 * z),
            (Face::Side, c - x + y - z, -2.0 * y, 2.0 * z),
            (Face::Side, c + x + y - z, -2.0 * x, 2.0 * z),
            (Face::Back, c - x - y - z, 2.0 * x, 2.0 * z),
            (Face::Above, c - x - y + z, 2.0 * x, 2.0 * y),
            (Face::Below, c - x + y - z, 2.0 * x, -2.0 * y),
        ];
        for (_, origin, u, v) in all.into_iter().filter(|(face, ..)| Some(*face) != hidden) {
            self.place(origin, u, v, finish);
        }
    }

    /// True if `bounds` keeps clear of the flight.
    pub(super) fn is_clear(&self, bounds: &Bounds) -> bool {
        self.path.iter().all(|p| bounds.distance(p) > CLEARANCE_M)
    }

    /// Takes the room of `bounds` if it is clear of the flight and of other furniture.
    pub(super) fn reserve(&mut self, bounds: &Bounds) -> bool {
        let free = self.is_clear(bounds) && !self.taken.iter().any(|t| t.overlaps(bounds));
        if free {
            self.taken.push(*bounds);
        }
        free
    }

    /// Floor, ceiling and walls of a hall over `bounds`.
    pub(super) fn shell(
        &mut self,
        bounds: &Bounds,
        floor: Finish,
        ceiling: Finish,
        walls: [Finish; 4],
    ) -> [Wall; 4] {
        let size = bounds.high - bounds.low;
        let (x, y, z) = (Vector3::x() * size.x, Vector3::y() * size.y, Vector3::z() * size.z);
        self.quad(bounds.low, x, y, floor);
        self.quad(bounds.low + y + z, x, -y, ceiling);
        let corners = [bounds.low, bounds.low + x, bounds.low + x + y, bounds.low + y];
        let edges = [x, y, -x, -y];
        [0, 1, 2, 3].map(|k| {
            self.quad(corners[k] + edges[k], -edges[k], z, walls[k]);
            let length = edges[k].norm();
            Wall { origin: corners[k], along: edges[k] / length, length, height: size.z }
        })
    }

    /// A table with four legs, if there is room.
    pub(super) fn table(&mut self, foot: Vector3<f64>, size: [f64; 3], yaw: f64, finish: Finish) -> bool {
        let whole = Solid::standing(foot, size, yaw);
        if !self.reserve(&whole.bounds()) {
            return false;
        }
        let top = Solid::standing(foot + Vector3::z() * (size[2] - 0.05), [size[0], size[1], 0.05], yaw);
        self.solid(&top, finish);
        let [a, b] = whole.axes();
        for (i, j) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let leg = foot + a * (i * (whole.half.x - 0.06)) + b * (j * (whole.half.y - 0.06));
            let leg = Solid::standing(leg, [0.06, 0.06, size[2] - 0.05], yaw);
            self.stand(&leg, Finish::of(Material::Paint).toned(0.0, 0.35));
        }
        true
    }

    /// A stack of up to three boxes, if there is room for all.
    pub(super) fn stack(&mut self, foot: Vector3<f64>, side: f64, finishes: &[Finish]) -> bool {
        let count = 1 + self.draws.index(3);
        let yaw = self.draws.range(-FRAC_PI_2, FRAC_PI_2);
        let mut whole = Solid::standing(foot, [1.15 * side, 1.15 * side, 0.85 * side * count as f64], yaw);
        if !self.is_clear(&whole.bounds()) {
            whole = Solid::standing(foot, [1.15 * side, 1.15 * side, 0.85 * side], yaw);
        }
        if !self.reserve(&whole.bounds()) {
            return false;
        }
        let mut top = 0.0;
        while top + 0.86 * side <= 2.0 * whole.half.z + 0.05 * side {
            let scale = self.draws.range(0.8, 1.0);
            let turn = yaw + self.draws.range(-0.15, 0.15);
            let finish = finishes[self.draws.index(finishes.len())];
            let size = [scale * side, scale * side * 0.9, 0.85 * side];
            self.stand(&Solid::standing(foot + Vector3::z() * top, size, turn), finish);
            top += 0.85 * side;
        }
        true
    }

    /// A shelf filled with boxes, its back towards `-y` of its own frame, if there is room.
    pub(super) fn shelf(&mut self, foot: Vector3<f64>, size: [f64; 3], yaw: f64, fill: &[Finish]) -> bool {
        let whole = Solid::standing(foot, size, yaw);
        if !self.reserve(&whole.bounds()) {
            return false;
        }
        let [a, b] = whole.axes();
        let frame = Finish::of(Material::Wood).toned(0.05, 0.7);
        let boards = (size[2] / 0.42).floor().at_least(2.0) as usize;
        let gap = size[2] / boards as f64;
        let back = foot - b * (whole.half.y - 0.01);
        self.stand(&Solid::standing(back, [size[0], 0.02, size[2]], yaw), frame);
        for side in [-1.0, 1.0] {
            let at = foot + a * (side * (whole.half.x - 0.015));
            self.stand(&Solid::standing(at, [0.03, size[1], size[2]], yaw), frame);
        }
        for level in 0..=boards {
            let z = Vector3::z() * (level as f64 * gap - if level == boards { 0.03 } else { 0.0 });
            self.solid(&Solid::standing(foot + z, [size[0] - 0.06, size[1], 0.03], yaw), frame);
            if level < boards {
                self.fill_board(&whole, level as f64 * gap + 0.03, gap - 0.08, fill);
            }
        }
        true
    }

    fn fill_board(&mut self, shelf: &Solid, z: f64, height: f64, fill: &[Finish]) {
        let [a, b] = shelf.axes();
        let mut x = -shelf.half.x + 0.06;
        loop {
            let width = self.draws.range(0.1, 0.34);
            if x + width > shelf.half.x - 0.05 {
                return;
            }
            let tall = height * self.draws.range(0.5, 1.0);
            let deep = shelf.half.y * self.draws.range(1.0, 1.7);
            let foot = shelf.centre + a * (x + 0.5 * width) - b * 0.02 + Vector3::z() * (z - shelf.half.z);
            let finish = fill[self.draws.index(fill.len())];
            self.faces(&Solid::standing(foot, [width, deep, tall], shelf.yaw), finish, Some(Face::Below));
            x += width + self.draws.range(0.02, 0.15);
        }
    }
}
