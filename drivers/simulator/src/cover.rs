//! Surface seen by each pixel of an image.
//!
//! Facets (see [`super::facet`]) that face the camera and may be seen are gathered, then by block and by tile; each tile finds
//! the nearest facet of its pixels.

use super::facet::Facet;
use super::lens::{BLOCK, Lens, TILE};
use super::shot::Shot;
use super::world::World;
use std::ops::Range;

/// No facet.
pub(super) const NONE: u16 = u16::MAX;
/// Facets of a tile that its edge pixels may show; a tile of more is a heap of specks anyway.
pub(super) const TILE_FACETS: usize = 30;

/// Surface seen by each pixel.
#[derive(Clone, Debug)]
pub(super) struct Cover {
    pub(super) facets: Vec<Facet>,
    /// By surface: whether any instant sees it.
    is_seen: Vec<bool>,
    /// Facets of a block, and of a tile, with their greatest inverse depth.
    block: Vec<(u16, f32)>,
    chosen: Vec<(u16, f32)>,
    /// Facets per tile, ended by [`NONE`].
    tiles: Vec<[u16; TILE_FACETS]>,
    /// Nearest facet per pixel, with a border of one pixel all round.
    nearest: Vec<u16>,
    /// Not zero for each pixel that has a neighbour which sees another facet, or sees none, or is not there; row-major in
    /// runs of a tile's width.
    pub(super) edges: Vec<[u16; TILE]>,
}

impl Cover {
    /// Memory for images up to `size_px` of a world with `surfaces`.
    pub(super) fn new(surfaces: usize, size_px: (usize, usize)) -> Self {
        Self {
            facets: Vec::with_capacity(surfaces),
            is_seen: Vec::with_capacity(surfaces),
            block: Vec::with_capacity(surfaces),
            chosen: Vec::with_capacity(surfaces),
            tiles: vec![[NONE; TILE_FACETS]; size_px.0.div_ceil(TILE) * size_px.1.div_ceil(TILE)],
            nearest: vec![NONE; (size_px.0 + 2) * (size_px.1 + 2)],
            edges: vec![[1; TILE]; size_px.0.div_ceil(TILE) * size_px.1],
        }
    }

    /// Finds what a camera sees: all of it at one instant, or each row of tiles at its own.
    pub(super) fn find(&mut self, world: &World, lens: &Lens, shots: &[Shot]) {
        match shots {
            [shot] => {
                self.gather(world, lens, shot);
                for row in (0..lens.rows).step_by(BLOCK) {
                    self.cover_rows(lens, row..(row + BLOCK).min(lens.rows));
                }
            }
            _ => {
                self.gather_all(world, lens, shots);
                for (row, shot) in shots.iter().enumerate() {
                    self.turn_to(world, shot);
                    self.cover_rows(lens, row..row + 1);
                }
            }
        }
        self.extend_border(lens);
        self.find_edges(lens);
    }

    /// Finds the nearest facets in some rows of tiles.
    fn cover_rows(&mut self, lens: &Lens, rows: Range<usize>) {
        for column in (0..lens.columns).step_by(BLOCK) {
            let columns = column..(column + BLOCK).min(lens.columns);
            let span = lens.block(columns.clone(), rows.clone());
            Facet::select(&self.facets, 0..self.facets.len() as u16, &span, &mut self.block);
            for row in rows.clone() {
                for column in columns.clone() {
                    self.cover_tile(lens, row * lens.columns + column);
                }
            }
        }
    }

    /// Surfaces seen by pixel `(u, v)` and its neighbours.
    #[inline]
    pub(super) fn around(&self, lens: &Lens, u: usize, v: usize) -> [[u16; 3]; 3] {
        [0, 1, 2].map(|k| {
            let row = &self.row(lens, v + k)[u..u + 3];
            [row[0], row[1], row[2]]
        })
    }

    /// Row `v` of the nearest facets, the border included: the image's rows begin at 1, as do their pixels.
    #[inline]
    pub(super) fn row(&self, lens: &Lens, v: usize) -> &[u16] {
        let stride = lens.model.width_px + 2;
        &self.nearest[v * stride..][..stride]
    }

    /// Facets that pixels of a tile may show.
    pub(super) fn facets_of(&self, tile: usize) -> impl Iterator<Item = u16> {
        self.tiles[tile].iter().copied().take_while(|id| *id != NONE)
    }

    /// Facets in view.
    fn gather(&mut self, world: &World, lens: &Lens, shot: &Shot) {
        self.facets.clear();
        for (surfaces, pose) in shot.poses(world) {
            for index in surfaces {
                if let Some(facet) = Facet::new(index, &world.surfaces[index], &pose)
                    && facet.nearest_within(&lens.all).is_some()
                {
                    self.facets.push(facet);
                }
            }
        }
    }

    /// Facets in view at any of the instants, in the order of their surfaces: a facet has one number in all of them.
    fn gather_all(&mut self, world: &World, lens: &Lens, shots: &[Shot]) {
        self.is_seen.clear();
        self.is_seen.resize(world.surfaces.len(), false);
        for shot in shots {
            self.gather(world, lens, shot);
            self.facets.iter().for_each(|facet| self.is_seen[facet.surface as usize] = true);
        }
        self.facets.clear();
        let seen = (0..world.surfaces.len()).filter(|index| self.is_seen[*index]);
        self.facets.extend(seen.map(|index| Facet::hidden(index as u32)));
    }

    /// Sees the gathered facets as they are at another instant.
    pub(super) fn turn_to(&mut self, world: &World, shot: &Shot) {
        let mut facets = self.facets.iter_mut().peekable();
        for (surfaces, pose) in shot.poses(world) {
            while let Some(facet) = facets.next_if(|facet| surfaces.contains(&(facet.surface as usize))) {
                let index = facet.surface as usize;
                let now = Facet::new(index, &world.surfaces[index], &pose);
                *facet = now.unwrap_or(Facet::hidden(facet.surface));
            }
        }
    }

    /// Finds the nearest facet of each pixel of a tile.
    fn cover_tile(&mut self, lens: &Lens, tile: usize) {
        let block = self.block.iter().map(|(index, _)| *index);
        Facet::select(&self.facets, block, &lens.tiles[tile], &mut self.chosen);
        let known = self.chosen.iter().map(|(index, _)| *index).chain(std::iter::repeat(NONE));
        self.tiles[tile].iter_mut().zip(known).for_each(|(slot, index)| *slot = index);
        let (width, height) = (lens.model.width_px, lens.model.height_px);
        let (column, v0) = (tile % lens.columns, tile / lens.columns * TILE);
        let count = TILE.min(width - column * TILE);
        for (v, [x, y]) in (v0..height).zip(lens.bearings(tile)) {
            let mut depth = [0.0_f32; TILE];
            let mut id = [u32::from(NONE); TILE];
            for &(index, _) in &self.chosen {
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

    /// Finds pixels whose neighbourhood does not see one facet.
    fn find_edges(&mut self, lens: &Lens) {
        let (width, stride) = (lens.model.width_px, lens.model.width_px + 2);
        let rows = self.edges.chunks_exact_mut(lens.columns).take(lens.model.height_px);
        for (v, out) in rows.enumerate() {
            let out = out.as_flattened_mut();
            out[width..].fill(1);
            let out = &mut out[..width];
            let own = &self.nearest[(v + 1) * stride + 1..][..width];
            out.iter_mut().zip(own).for_each(|(out, id)| *out = u16::from(*id == NONE));
            for near in self.nearest[v * stride..].chunks_exact(stride).take(3) {
                let (left, middle, right) = (&near[..width], &near[1..][..width], &near[2..][..width]);
                for u in 0..width {
                    out[u] |= (left[u] ^ own[u]) | (middle[u] ^ own[u]) | (right[u] ^ own[u]);
                }
            }
        }
    }
}
