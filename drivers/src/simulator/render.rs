//! The renderer: which surface each pixel sees, and how bright it is there.
//!
//! 1. Facets (see [`super::facet`]) that face the camera and may be seen are gathered, then by block and by tile.
//! 2. Each tile finds the nearest facet per pixel.
//! 3. Pixels whose neighbourhood sees one facet are shaded once with an anisotropic texture look-up;
//!    the others share themselves between their facets by 16 rays.

use super::facet::{Facet, RUN};
use super::lens::{BLOCK, Lens, Span, TILE};
use super::world::World;
use nalgebra::Isometry3;
use plumbline_config::Portable;

/// No facet.
const NONE: u16 = u16::MAX;
/// Facets of a tile that its edge pixels may show; a tile of more is a heap of specks anyway.
const TILE_FACETS: usize = 30;
/// Facets that share one pixel, at most.
const PIXEL_FACETS: usize = 16;
/// Rays through a pixel on an edge: a 4x4 grid, sheared so that edges along rows, columns and diagonals
/// meet the rays one after another. As many as a tile has columns, so that both are covered in the same way.
const RAYS: [[f32; 2]; TILE] = rays();

const fn rays() -> [[f32; 2]; TILE] {
    let mut all = [[0.0; 2]; TILE];
    let mut i = 0;
    while i < TILE {
        let (column, row) = ((i % 4) as f32, (i / 4) as f32);
        all[i] = [(column * 4.0 + row - 7.5) / 16.0, (row * 4.0 + (3.0 - column) - 7.5) / 16.0];
        i += 1;
    }
    all
}

/// What a tile knows about its pixels.
struct Tile<'a> {
    /// See [`Lens::steps`].
    step: &'a [f32; 4],
    facets: &'a [u16; TILE_FACETS],
}

/// Working memory of one rendering thread.
#[derive(Clone, Debug)]
pub(super) struct Renderer {
    facets: Vec<Facet>,
    block: Vec<u16>,
    tile: Vec<u16>,
    /// Facets per tile, ended by [`NONE`].
    tiles: Vec<[u16; TILE_FACETS]>,
    /// Nearest facet per pixel, with a border of one pixel all round.
    nearest: Vec<u16>,
}

impl Renderer {
    /// Memory for images up to `pixels` (with a border) of a world with `surfaces`.
    pub(super) fn new(surfaces: usize, size_px: (usize, usize)) -> Self {
        Self {
            facets: Vec::with_capacity(surfaces),
            block: Vec::with_capacity(surfaces),
            tile: Vec::with_capacity(surfaces),
            tiles: vec![[NONE; TILE_FACETS]; size_px.0.div_ceil(TILE) * size_px.1.div_ceil(TILE)],
            nearest: vec![NONE; (size_px.0 + 2) * (size_px.1 + 2)],
        }
    }

    /// Renders what the camera at `pose_w_c` sees, in grey levels before the sensor, into `out`.
    pub(super) fn render(&mut self, world: &World, lens: &Lens, pose_w_c: &Isometry3<f64>, out: &mut [f32]) {
        self.gather(world, lens, pose_w_c);
        for row in (0..lens.rows).step_by(BLOCK) {
            for column in (0..lens.columns).step_by(BLOCK) {
                let rows = row..(row + BLOCK).min(lens.rows);
                let columns = column..(column + BLOCK).min(lens.columns);
                let span = lens.block(columns.clone(), rows.clone());
                select(&self.facets, 0..self.facets.len() as u16, &span, &mut self.block);
                for row in rows {
                    for column in columns.clone() {
                        self.cover_tile(lens, row * lens.columns + column);
                    }
                }
            }
        }
        self.extend_border(lens);
        for v in 0..lens.model.height_px {
            self.shade_row(world, lens, v, &mut out[v * lens.model.width_px..][..lens.model.width_px]);
        }
    }

    /// The surface that the last image shows at a pixel.
    #[cfg(test)]
    pub(super) fn surface_at(&self, lens: &Lens, u: usize, v: usize) -> Option<usize> {
        let id = self.nearest[(v + 1) * (lens.model.width_px + 2) + u + 1];
        self.facets.get(id as usize).map(|f| f.surface as usize)
    }

    /// Facets in view.
    fn gather(&mut self, world: &World, lens: &Lens, pose_w_c: &Isometry3<f64>) {
        self.facets.clear();
        for (index, surface) in world.surfaces.iter().enumerate() {
            if let Some(facet) = Facet::new(index, surface, pose_w_c)
                && facet.nearest_within(&lens.all).is_some()
            {
                self.facets.push(facet);
            }
        }
    }

    /// Finds the nearest facet of each pixel of a tile.
    fn cover_tile(&mut self, lens: &Lens, tile: usize) {
        let span = &lens.tiles[tile];
        select(&self.facets, self.block.iter().copied(), span, &mut self.tile);
        let known = self.tile.iter().copied().chain(std::iter::repeat(NONE));
        self.tiles[tile].iter_mut().zip(known).for_each(|(slot, index)| *slot = index);
        let (width, height) = (lens.model.width_px, lens.model.height_px);
        let (column, v0) = (tile % lens.columns, tile / lens.columns * TILE);
        let count = TILE.min(width - column * TILE);
        for v in v0..(v0 + TILE).min(height) {
            let bearings = lens.row(v);
            let (x, y) = (&bearings.0[column], &bearings.1[column]);
            let mut depth = [0.0_f32; TILE];
            let mut id = [u32::from(NONE); TILE];
            for &index in &self.tile {
                self.facets[index as usize].cover_row(u32::from(index), x, y, &mut depth, &mut id);
            }
            let row = &mut self.nearest[(v + 1) * (width + 2) + 1 + column * TILE..][..count];
            row.iter_mut().zip(&id).for_each(|(n, &id)| *n = id as u16);
        }
    }

    /// Repeats the outermost pixels in the border.
    fn extend_border(&mut self, lens: &Lens) {
        let (stride, height) = (lens.model.width_px + 2, lens.model.height_px);
        for row in self.nearest.chunks_exact_mut(stride).take(height + 2) {
            row[0] = row[1];
            row[stride - 1] = row[stride - 2];
        }
        self.nearest.copy_within(stride..2 * stride, 0);
        self.nearest.copy_within(height * stride..(height + 1) * stride, (height + 1) * stride);
    }

    fn shade_row(&self, world: &World, lens: &Lens, v: usize, out: &mut [f32]) {
        let stride = lens.model.width_px + 2;
        let around = [0, 1, 2].map(|k| &self.nearest[(v + k) * stride..][..stride]);
        let steps = &lens.steps[v / TILE * lens.columns..][..lens.columns];
        let tiles = &self.tiles[v / TILE * lens.columns..][..lens.columns];
        let bearings = lens.row(v);
        for (run, pixels) in out.chunks_mut(RUN).enumerate() {
            let (column, first) = (run * RUN / TILE, run * RUN % TILE);
            let piece =
                |table: &[[f32; TILE]]| -> [f32; RUN] { std::array::from_fn(|i| table[column][first + i]) };
            let (x, y) = (piece(bearings.0), piece(bearings.1));
            let tile = Tile { step: &steps[column], facets: &tiles[column] };
            let near = around.map(|row| &row[run * RUN..][..pixels.len() + 2]);
            let id = near[1][1];
            if pixels.len() == RUN && id != NONE && near.iter().all(|row| all_are(row, id)) {
                pixels.copy_from_slice(&self.facets[id as usize].shade(world, &x, &y, tile.step));
            } else {
                self.shade_pieces(world, &near, (&x, &y), &tile, pixels);
            }
        }
    }

    /// As [`Self::shade_row`], for a run of pixels that sees more than one facet.
    fn shade_pieces(
        &self,
        world: &World,
        near: &[&[u16]; 3],
        (x, y): (&[f32; RUN], &[f32; RUN]),
        tile: &Tile<'_>,
        pixels: &mut [f32],
    ) {
        let mut last = (NONE, [0.0; RUN]);
        for (i, pixel) in pixels.iter_mut().enumerate() {
            let ids = near.map(|row| [row[i], row[i + 1], row[i + 2]]);
            let id = ids[1][1];
            let differs = ids.as_flattened().iter().fold(0, |d, n| d | (n ^ id));
            if differs != 0 || id == NONE {
                *pixel = self.shade_edge(world, &ids, [x[i], y[i]], tile);
                continue;
            }
            if last.0 != id {
                last = (id, self.shade_some(world, id, near[1], (x, y), tile.step));
            }
            *pixel = last.1[i];
        }
    }

    /// Those pixels of a run that see facet `id`; the others may hold anything.
    fn shade_some(
        &self,
        world: &World,
        id: u16,
        row: &[u16],
        (x, y): (&[f32; RUN], &[f32; RUN]),
        step: &[f32; 4],
    ) -> [f32; RUN] {
        let facet = &self.facets[id as usize];
        let own = |i: usize| row.get(i + 1) == Some(&id);
        let nearest = (0..RUN).find(|&i| own(i)).unwrap_or(0);
        // Lanes of other facets repeat one that is on this.
        let lane = |i: usize| if own(i) { i } else { nearest };
        let (x, y) = (std::array::from_fn(|i| x[lane(i)]), std::array::from_fn(|i| y[lane(i)]));
        facet.shade_exactly(world, &x, &y, step)
    }

    /// Facets that a pixel may show: those of its neighbours, and any of the tile that touch it, however
    /// thin. Returns their number.
    fn candidates(
        &self,
        ids: &[[u16; 3]; 3],
        at: [f32; 2],
        tile: &Tile<'_>,
        into: &mut [u16; PIXEL_FACETS],
    ) -> usize {
        let mut count = 0;
        for &id in ids.as_flattened() {
            if id != NONE && !into[..count].contains(&id) {
                into[count] = id;
                count += 1;
            }
        }
        let reach = [0, 1].map(|k| 0.5 * (tile.step[k].abs() + tile.step[k + 2].abs()));
        let span = Span { x: [at[0] - reach[0], at[0] + reach[0]], y: [at[1] - reach[1], at[1] + reach[1]] };
        for &id in tile.facets.iter().take_while(|id| **id != NONE) {
            let touches = self.facets[id as usize].nearest_within(&span).is_some();
            if touches && count < PIXEL_FACETS && !into[..count].contains(&id) {
                into[count] = id;
                count += 1;
            }
        }
        count
    }

    /// Brightness of a pixel that several facets may share.
    fn shade_edge(&self, world: &World, ids: &[[u16; 3]; 3], at: [f32; 2], tile: &Tile<'_>) -> f32 {
        let step = tile.step;
        let mut candidates = [NONE; PIXEL_FACETS];
        let count = self.candidates(ids, at, tile, &mut candidates);
        let x = RAYS.map(|[right, down]| at[0] + right * step[0] + down * step[2]);
        let y = RAYS.map(|[right, down]| at[1] + right * step[1] + down * step[3]);
        let (mut depth, mut seen) = ([0.0; TILE], [PIXEL_FACETS as u32; TILE]);
        for (k, &id) in candidates[..count].iter().enumerate() {
            self.facets[id as usize].cover_row(k as u32, &x, &y, &mut depth, &mut seen);
        }
        // Rays and sum of their bearings, per candidate; the last are those of the rays that meet none.
        let mut shares = [[0.0_f32; 3]; PIXEL_FACETS + 1];
        for (&k, (x, y)) in seen.iter().zip(x.iter().zip(&y)) {
            let share = &mut shares[k as usize];
            *share = [share[0] + 1.0, share[1] + x, share[2] + y];
        }
        let (mut sum, mut total) = (0.0, 0.0);
        for (share, &id) in shares.iter().zip(&candidates[..count]).filter(|(share, _)| share[0] > 0.0) {
            let facet = &self.facets[id as usize];
            let (x, y) = (share[1] / share[0], share[2] / share[0]);
            sum += share[0] * facet.shade_exactly(world, &[x], &[y], step)[0];
            total += share[0];
        }
        if total > 0.0 { sum / total } else { 0.0 }
    }
}

/// Those of `from` that may be seen within `span`: not outside of it and not behind one that covers it.
fn select(facets: &[Facet], from: impl Iterator<Item = u16>, span: &Span, into: &mut Vec<u16>) {
    into.clear();
    let mut behind = 0.0_f32;
    for index in from {
        let facet = &facets[index as usize];
        if let Some(nearest) = facet.nearest_within(span)
            && nearest >= behind
        {
            behind = behind.at_least(facet.covers(span).unwrap_or(0.0));
            into.push(index);
        }
    }
    into.retain(|&index| span.range(&facets[index as usize].w)[1] >= behind);
}

/// Whether a run and its neighbours in one row all see facet `id`.
#[inline]
fn all_are(row: &[u16], id: u16) -> bool {
    let Ok(row) = <&[u16; RUN + 2]>::try_from(row) else { return false };
    row.iter().fold(0, |differs, n| differs | (n ^ id)) == 0
}
