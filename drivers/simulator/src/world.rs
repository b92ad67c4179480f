//! The simulated world: textured rectangles with baked light.
//!
//! Frame `W`: z up, metres. A surface is seen from the side its normal points to.

use super::pattern::Material;
use crate::random::{Draws, Purpose};
use nalgebra::{UnitQuaternion, Vector3};
use plumbline_config::Portable;
use std::ops::Range;

/// Finish of a surface: albedo goes from `dark` to `bright` along the values of the pattern.
#[derive(Clone, Copy, Debug)]
pub(super) struct Finish {
    pub(super) material: Material,
    /// Size of the pattern against its usual size.
    pub(super) zoom: f64,
    pub(super) dark: f32,
    pub(super) bright: f32,
    /// Brightness of a surface that shines by itself; 0 for one that is lit.
    pub(super) glow: f32,
}

impl Finish {
    /// `material` with its full contrast.
    pub(super) const fn of(material: Material) -> Self {
        Self { material, zoom: 1.0, dark: 0.0, bright: 1.0, glow: 0.0 }
    }

    /// Returns the finish with albedo between `dark` and `bright`.
    pub(super) const fn toned(self, dark: f32, bright: f32) -> Self {
        Self { dark, bright, ..self }
    }

    /// Returns the finish with its pattern enlarged by `zoom`.
    pub(super) const fn zoomed(self, zoom: f64) -> Self {
        Self { zoom, ..self }
    }

    /// Returns the finish with light of its own.
    pub(super) const fn glowing(self, glow: f32) -> Self {
        Self { glow, ..self }
    }
}

/// A float of this size holds whole numbers.
const ONES: f32 = 8_388_608.0;

/// Brightness (grey levels of a white surface) on a grid over a surface.
#[derive(Clone, Debug)]
pub(super) struct LightMap {
    /// At least two.
    pub(super) columns: usize,
    /// At least two.
    pub(super) rows: usize,
    /// By rows.
    pub(super) values: Vec<f32>,
}

impl LightMap {
    /// Creates a map of one brightness.
    pub(super) fn uniform(value: f32) -> Self {
        Self { columns: 2, rows: 2, values: vec![value; 4] }
    }

    /// Brightness at places `(s, t)`, all within 0 to 1.
    #[inline]
    pub(super) fn at<const N: usize>(&self, s: &[f32; N], t: &[f32; N]) -> [f32; N] {
        let size = [(self.columns - 1) as f32, (self.rows - 1) as f32];
        let (mut fx, mut fy, mut cells) = ([0.0; N], [0.0; N], [0; N]);
        for i in 0..N {
            let (x, y) = (s[i].clamp(0.0, 1.0) * size[0], t[i].clamp(0.0, 1.0) * size[1]);
            let (column, row) = (x.floor().at_most(size[0] - 1.0), y.floor().at_most(size[1] - 1.0));
            (fx[i], fy[i]) = (x - column, y - row);
            // The last bits of a number that is added to one whose last bit is worth one are those of the whole number.
            cells[i] = (row * self.columns as f32 + column + ONES).to_bits() ^ ONES.to_bits();
        }
        let mut corners = [[0.0; N]; 4];
        for i in 0..N {
            let upper = &self.values[cells[i] as usize..];
            let lower = &upper[self.columns..];
            [corners[0][i], corners[1][i], corners[2][i], corners[3][i]] =
                [upper[0], upper[1], lower[0], lower[1]];
        }
        let [a, after_a, b, after_b] = corners;
        std::array::from_fn(|i| {
            let (a, b) = (a[i] + (after_a[i] - a[i]) * fx[i], b[i] + (after_b[i] - b[i]) * fx[i]);
            a + (b - a) * fy[i]
        })
    }
}

/// A rectangle: `origin + s edge_u + t edge_v`, `s` and `t` from 0 to 1.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    /// Corner in the world, m.
    pub(super) origin: Vector3<f64>,
    /// First edge, m; along the columns of the pattern.
    pub(super) edge_u: Vector3<f64>,
    /// Second edge, m.
    pub(super) edge_v: Vector3<f64>,
    /// Unit normal, `edge_u x edge_v`.
    pub(super) normal: Vector3<f64>,
    /// Appearance.
    pub(super) finish: Finish,
    /// Texel at the corner.
    pub(super) texel_origin: [f32; 2],
    /// Texels along both edges.
    pub(super) texels: [f32; 2],
    /// Baked light.
    pub(super) light: LightMap,
}

impl Surface {
    /// Distance along `direction` (in its lengths) at which a ray meets the front of the surface, and
    /// where on it (`s`, `t`).
    pub(super) fn hit(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, f64, f64)> {
        let slope = self.normal.dot(direction);
        let height = self.normal.dot(&(origin - self.origin));
        if slope >= 0.0 || height <= 0.0 {
            return None;
        }
        let distance = -height / slope;
        let local = origin + direction * distance - self.origin;
        let s = local.dot(&self.edge_u) / self.edge_u.norm_squared();
        let t = local.dot(&self.edge_v) / self.edge_v.norm_squared();
        let inside = (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
        inside.then_some((distance, s, t))
    }
}

/// A point of the world seen along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The point, in the world, m.
    pub p_w: Vector3<f64>,
    /// Number of the surface it lies on.
    pub surface: usize,
    /// Distance from the ray's origin, in lengths of its direction.
    pub distance: f64,
}

/// All surfaces.
#[derive(Debug)]
pub(super) struct World {
    pub(super) surfaces: Vec<Surface>,
    /// Surfaces of each thing that moves, in its own frame; they come last.
    pub(super) movers: Vec<Range<usize>>,
}

impl World {
    /// Creates the world from surfaces and their light.
    pub(super) fn new(surfaces: Vec<Surface>) -> Self {
        Self { surfaces, movers: Vec::new() }
    }

    /// Adds a thing that moves, in its own frame and in light of one brightness.
    pub(super) fn add_mover(&mut self, surfaces: Vec<Surface>, brightness: f32) {
        let begin = self.surfaces.len();
        for mut surface in surfaces {
            surface.light = LightMap::uniform(brightness);
            self.surfaces.push(surface);
        }
        self.movers.push(begin..self.surfaces.len());
    }

    /// Surfaces that stand still.
    pub(super) fn still(&self) -> &[Surface] {
        &self.surfaces[..self.movers.first().map_or(self.surfaces.len(), |mover| mover.start)]
    }

    /// Tilts everything by `angle_rad` about a horizontal axis through the middle of `path`, in a direction that the seed
    /// draws. Light stays as it was baked.
    pub(super) fn lean(&mut self, angle_rad: f64, seed: u64, path: &[Vector3<f64>]) {
        let centre = path.iter().sum::<Vector3<f64>>() / (path.len() as f64).at_least(1.0);
        let heading = Draws::new(seed, Purpose::Lean, 0).range(0.0, std::f64::consts::TAU);
        let axis = Vector3::new(libm::cos(heading), libm::sin(heading), 0.0);
        let lean = UnitQuaternion::new(axis * angle_rad);
        for surface in &mut self.surfaces {
            surface.origin = centre + lean * (surface.origin - centre);
            surface.edge_u = lean * surface.edge_u;
            surface.edge_v = lean * surface.edge_v;
            surface.normal = lean * surface.normal;
        }
    }

    /// Paints what the surfaces are made of, so that nobody waits for it later.
    pub(super) fn paint(&self) {
        for surface in &self.surfaces {
            surface.finish.material.texture();
        }
    }

    /// The first surface at rest that the ray from `origin` along `direction` (both in the world) meets.
    pub(super) fn first_hit(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for (surface, s) in self.still().iter().enumerate() {
            if let Some((distance, ..)) = s.hit(origin, direction)
                && best.is_none_or(|b| distance < b.distance)
            {
                best = Some(Hit { p_w: origin + direction * distance, surface, distance });
            }
        }
        best
    }
}
