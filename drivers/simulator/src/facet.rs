//! A rectangle as one image sees it.
//!
//! A rectangle `o + s u + t v` in camera coordinates meets the ray `d = (x, y, 1)` at depth `z` where
//! `(s, t, 1) / z = [u v o]^-1 d`: the inverse depth `w = 1/z` and the products `s w`, `t w` are linear in
//! the bearing `(x, y)` (Olano and Greer 1997). Coverage, depth test and texture coordinates of a pixel
//! are therefore three linear functions, without clipping, set up in double precision relative to the
//! camera and evaluated in single precision.

use super::lens::{Span, TILE};
use super::texture::{Footprints, Plan, Texture};
use super::world::{Surface, World};
use nalgebra::{Isometry3, Matrix3};
use plumbline_config::Portable;

/// Pixels shaded at a time.
pub(super) const RUN: usize = 8;

/// A surface as one image sees it: linear functions `[by x, by y, constant]` of the bearing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    pub(super) s: [f32; 3],
    pub(super) t: [f32; 3],
    pub(super) w: [f32; 3],
    pub(super) surface: u32,
}

#[inline]
fn linear(f: &[f32; 3], x: f32, y: f32) -> f32 {
    f[0] * x + f[1] * y + f[2]
}

impl Facet {
    /// A facet that nobody sees.
    pub(super) const fn hidden(surface: u32) -> Self {
        Self { s: [0.0; 3], t: [0.0; 3], w: [0.0, 0.0, -1.0], surface }
    }

    /// Facet of a surface for a camera at `pose_w_c` in the surface's frame. `None` when the surface shows its back.
    pub(super) fn new(index: usize, surface: &Surface, pose_w_c: &Isometry3<f64>) -> Option<Self> {
        let origin_w = surface.origin - pose_w_c.translation.vector;
        if surface.normal.dot(&origin_w) > -1e-6 {
            return None;
        }
        let to_camera = |v| pose_w_c.rotation.inverse_transform_vector(v);
        let columns = [to_camera(&surface.edge_u), to_camera(&surface.edge_v), to_camera(&origin_w)];
        let inverse = Matrix3::from_columns(&columns).try_inverse()?;
        let row = |i: usize| [0, 1, 2].map(|j| inverse[(i, j)] as f32);
        Some(Self { s: row(0), t: row(1), w: row(2), surface: index as u32 })
    }

    /// Greatest inverse depth within `span`, `None` when nothing of the facet is there (a few facets just
    /// outside pass as well).
    #[inline]
    pub(super) fn nearest_within(&self, span: &Span) -> Option<f32> {
        let nearest = span.range(&self.w)[1];
        let may_be_in = |f: &[f32; 3]| span.range(f)[1] >= 0.0 && span.range(&self.rest(f))[1] >= 0.0;
        (nearest > 0.0 && may_be_in(&self.s) && may_be_in(&self.t)).then_some(nearest)
    }

    /// Least inverse depth within `span` if the facet covers all of it, else 0.
    #[inline]
    fn covered(&self, span: &Span) -> f32 {
        let furthest = span.range(&self.w)[0];
        let is_in = |f: &[f32; 3]| span.range(f)[0] >= 0.0 && span.range(&self.rest(f))[0] >= 0.0;
        if furthest > 0.0 && is_in(&self.s) && is_in(&self.t) { furthest } else { 0.0 }
    }

    #[inline]
    fn rest(&self, f: &[f32; 3]) -> [f32; 3] {
        [self.w[0] - f[0], self.w[1] - f[1], self.w[2] - f[2]]
    }

    /// Selects, of the facets `from`, those that may be seen within `span`, in their order: not outside of it and not behind one
    /// that covers it.
    pub(super) fn select(
        facets: &[Self],
        from: impl Iterator<Item = u16>,
        span: &Span,
        into: &mut Vec<(u16, f32)>,
    ) {
        into.clear();
        let mut behind = 0.0_f32;
        for index in from {
            let facet = &facets[index as usize];
            if let Some(nearest) = facet.nearest_within(span) {
                behind = behind.at_least(facet.covered(span));
                into.push((index, nearest));
            }
        }
        into.retain(|(_, nearest)| *nearest >= behind);
    }

    /// Puts the facet, as number `index`, into the bearings of a row of a tile, or of the rays of a pixel, wherever it is the
    /// nearest so far.
    #[inline]
    pub(super) fn cover_row(
        &self,
        index: u32,
        x: &[f32; TILE],
        y: &[f32; TILE],
        depth: &mut [f32; TILE],
        id: &mut [u32; TILE],
    ) {
        for i in 0..TILE {
            let s = linear(&self.s, x[i], y[i]);
            let t = linear(&self.t, x[i], y[i]);
            let w = linear(&self.w, x[i], y[i]);
            let seen = (s >= 0.0) & (t >= 0.0) & (s <= w) & (t <= w) & (w > depth[i]);
            depth[i] = if seen { w } else { depth[i] };
            id[i] = if seen { index } else { id[i] };
        }
    }

    /// Sampling of the texture for a run of pixels of bearings `(x, y)` and of `step` (see [`Lens::steps`]),
    /// and the places of the pixels on the surface (`s`, `t`).
    ///
    /// [`Lens::steps`]: super::lens::Lens::steps
    #[inline]
    pub(super) fn plan(
        &self,
        world: &World,
        [x, y]: [&[f32; RUN]; 2],
        step: &[f32; 4],
    ) -> (Plan<RUN>, [[f32; RUN]; 2]) {
        let surface = &world.surfaces[self.surface as usize];
        let [columns, rows] = surface.texels;
        let zero = [0.0; RUN];
        let (mut s, mut t) = (zero, zero);
        let mut f = Footprints { u: zero, v: zero, u_right: zero, v_right: zero, u_down: zero, v_down: zero };
        for i in 0..RUN {
            let z = 1.0 / linear(&self.w, x[i], y[i]);
            s[i] = linear(&self.s, x[i], y[i]) * z;
            t[i] = linear(&self.t, x[i], y[i]) * z;
            f.u[i] = surface.texel_origin[0] + s[i] * columns;
            f.v[i] = surface.texel_origin[1] + t[i] * rows;
            let (scale_u, scale_v) = (z * columns, z * rows);
            let (ux, uy) = (self.s[0] - s[i] * self.w[0], self.s[1] - s[i] * self.w[1]);
            let (vx, vy) = (self.t[0] - t[i] * self.w[0], self.t[1] - t[i] * self.w[1]);
            f.u_right[i] = (ux * step[0] + uy * step[1]) * scale_u;
            f.u_down[i] = (ux * step[2] + uy * step[3]) * scale_u;
            f.v_right[i] = (vx * step[0] + vy * step[1]) * scale_v;
            f.v_down[i] = (vx * step[2] + vy * step[3]) * scale_v;
        }
        (self.texture(world).plan(&f), [s, t])
    }

    /// Texture of the surface's material.
    #[inline]
    pub(super) fn texture(&self, world: &World) -> &'static Texture {
        world.surfaces[self.surface as usize].finish.material.texture()
    }

    /// Light of a run of pixels side by side at places `(s, t)`. It is smooth: its ends will do for the few pixels of a run.
    #[inline]
    pub(super) fn light_along(&self, world: &World, [s, t]: &[[f32; RUN]; 2]) -> [f32; RUN] {
        let light = &world.surfaces[self.surface as usize].light;
        let [first, last] = light.at(&[s[0], s[RUN - 1]], &[t[0], t[RUN - 1]]);
        let slope = (last - first) / (RUN - 1) as f32;
        std::array::from_fn(|i| first + slope * i as f32)
    }

    /// As [`Self::light_along`], for pixels anywhere.
    #[inline]
    pub(super) fn light_at(&self, world: &World, [s, t]: &[[f32; RUN]; 2]) -> [f32; RUN] {
        world.surfaces[self.surface as usize].light.at(s, t)
    }

    /// Brightness in `light` of places where the pattern has `values`.
    #[inline]
    pub(super) fn lit(&self, world: &World, values: &[f32; RUN], light: &[f32; RUN]) -> [f32; RUN] {
        let finish = &world.surfaces[self.surface as usize].finish;
        let contrast = (finish.bright - finish.dark) / 255.0;
        std::array::from_fn(|i| (finish.dark + contrast * values[i]) * light[i])
    }
}
