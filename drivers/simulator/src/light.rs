//! Light baked into coarse maps: ambient light and a few lamps with Lambert's law and shadows.
//!
//! Maps are looked up bilinearly, so shadows have soft edges of about one grid step; the texture carries
//! all fine detail.

use super::solid::Solid;
use super::world::{LightMap, Surface};
use nalgebra::Vector3;
use plumbline_config::Portable;

/// Most points of a map along one edge.
const MAX_POINTS: usize = 64;
/// Grey level of a white surface in the mean light of the scene.
const MEAN_LEVEL: f32 = 215.0;
/// Light of a lamp that is not worth looking for its shadow, grey levels.
const MIN_LIGHT: f64 = 1.0;

/// A lamp below the ceiling.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp {
    /// Position in the world, m.
    pub(super) p_w: Vector3<f64>,
    /// Brightness of a white surface that faces the lamp from nearby, grey levels.
    pub(super) strength: f64,
    /// Distance at which the light has fallen to a half, m.
    pub(super) reach_m: f64,
}

/// Light that comes from everywhere, and the lamps.
#[derive(Clone, Debug)]
pub(super) struct Lighting {
    /// Brightness of a white surface that no lamp sees, grey levels.
    pub(super) ambient: f64,
    /// Distance of the points of the maps, m.
    pub(super) step_m: f64,
    /// The lamps.
    pub(super) lamps: Vec<Lamp>,
}

/// Computes the light maps of all surfaces; `casters` throw the shadows.
pub(super) fn bake(surfaces: &mut [Surface], casters: &[Solid], lighting: &Lighting) {
    for surface in surfaces.iter_mut() {
        surface.light = map(surface, casters, lighting);
    }
    expose(surfaces);
}

/// Brings the light of the whole scene to the range of the sensor: a white surface in mean light comes
/// out at [`MEAN_LEVEL`], and none much beyond white.
fn expose(surfaces: &mut [Surface]) {
    let lit = |s: &&mut Surface| s.finish.glow == 0.0;
    let (mut sum, mut area) = (0.0, 0.0);
    for surface in surfaces.iter_mut().filter(lit) {
        let size = surface.edge_u.norm() * surface.edge_v.norm();
        let values = &surface.light.values;
        sum += size * f64::from(values.iter().sum::<f32>()) / values.len() as f64;
        area += size;
    }
    let mean = (sum / area.at_least(1e-9)) as f32;
    let shape = |x: f32| 1.0 - libm::expf(-x);
    for surface in surfaces.iter_mut().filter(lit) {
        for value in &mut surface.light.values {
            *value = MEAN_LEVEL * shape(*value / mean) / shape(1.0);
        }
    }
}

fn map(surface: &Surface, casters: &[Solid], lighting: &Lighting) -> LightMap {
    if surface.finish.glow > 0.0 {
        return LightMap::uniform(surface.finish.glow);
    }
    let count = |edge: &Vector3<f64>| ((edge.norm() / lighting.step_m) as usize + 2).min(MAX_POINTS);
    let (columns, rows) = (count(&surface.edge_u), count(&surface.edge_v));
    let mut values = Vec::with_capacity(columns * rows);
    // A little inside the edges, so that a solid does not shade its neighbour's faces.
    let inner = |i: usize, n: usize| 0.01 + 0.98 * i as f64 / (n - 1) as f64;
    for row in 0..rows {
        for column in 0..columns {
            let (s, t) = (inner(column, columns), inner(row, rows));
            let point = surface.origin + surface.edge_u * s + surface.edge_v * t + surface.normal * 2e-3;
            values.push(brightness(&point, &surface.normal, casters, lighting) as f32);
        }
    }
    LightMap { columns, rows, values }
}

fn brightness(point: &Vector3<f64>, normal: &Vector3<f64>, casters: &[Solid], lighting: &Lighting) -> f64 {
    // Directional ambient light keeps the faces of a box apart.
    let side = 0.12 * normal.z + 0.07 * normal.x - 0.05 * normal.y;
    let mut sum = lighting.ambient * (0.85 + side);
    for lamp in &lighting.lamps {
        let to_lamp = lamp.p_w - point;
        let distance = to_lamp.norm();
        let cosine = normal.dot(&to_lamp) / distance;
        if cosine <= 0.0 {
            continue;
        }
        let light = lamp.strength * cosine / (1.0 + (distance / lamp.reach_m).squared());
        if light > MIN_LIGHT && !casters.iter().any(|solid| solid.blocks(point, &lamp.p_w)) {
            sum += light;
        }
    }
    sum
}
