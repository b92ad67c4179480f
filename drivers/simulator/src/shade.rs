//! Brightness of pixels, tile by tile.
//!
//! Runs of pixels whose neighbourhood sees one facet are shaded at once. The other pixels of a tile wait until there are
//! enough samples of a facet for a run: one of a pixel that sees a single facet, and one for each facet that an edge pixel
//! shares itself between.

use super::cover::{Cover, NONE};
use super::facet::RUN;
use super::lens::{Lens, Span, TILE};
use super::world::World;

/// Facets that share one pixel, at most.
const PIXEL_FACETS: usize = 16;
/// Rays through a pixel on an edge: a 4x4 grid, sheared so that edges along rows, columns and diagonals
/// meet the rays one after another. As many as a tile has columns, so that both are covered in the same way.
const RAYS: [[f32; 2]; TILE] = rays();
/// Samples of a tile, at most.
const SAMPLES: usize = TILE * TILE * PIXEL_FACETS;

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

/// Input of the rendering.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) world: &'a World,
    pub(super) lens: &'a Lens,
    pub(super) cover: &'a Cover,
}

/// A place that a facet is shaded at.
#[derive(Clone, Copy, Debug, Default)]
struct Sample {
    /// Rays of the pixel that it stands for.
    share: f32,
    value: f32,
}

/// Samples of a facet that wait for more.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    count: usize,
    x: [f32; RUN],
    y: [f32; RUN],
    sample: [u16; RUN],
}

/// A pixel and the end of its samples, which follow those of the pixel before.
#[derive(Clone, Copy, Debug)]
struct Pixel {
    place: u32,
    end: u16,
}

/// Working memory of shading.
#[derive(Clone, Debug)]
pub(super) struct Shader {
    /// By facet.
    waiting: Vec<Waiting>,
    /// Facets that may have samples.
    touched: Vec<u16>,
    samples: Vec<Sample>,
    pixels: Vec<Pixel>,
}

/// Rays of a pixel, from its bearing, in a tile.
struct Rays {
    x: [[f32; TILE]; 2],
    y: [[f32; TILE]; 2],
    reach: [f32; 2],
}

impl Rays {
    /// Creates the rays of a tile with `step`, see [`Lens::steps`].
    fn new(step: &[f32; 4]) -> Self {
        let along = |factors: [f32; 2]| [0, 1].map(|k| RAYS.map(|ray| ray[k] * factors[k]));
        let reach = [0, 1].map(|k| 0.5 * (step[k].abs() + step[k + 2].abs()));
        Self { x: along([step[0], step[2]]), y: along([step[1], step[3]]), reach }
    }

    #[inline]
    fn from(at: f32, along: &[[f32; TILE]; 2]) -> [f32; TILE] {
        std::array::from_fn(|i| at + along[0][i] + along[1][i])
    }
}

impl Shader {
    /// Memory for a world with `surfaces`.
    pub(super) fn new(surfaces: usize) -> Self {
        let empty = Waiting { count: 0, x: [0.0; RUN], y: [0.0; RUN], sample: [0; RUN] };
        Self {
            waiting: vec![empty; surfaces],
            touched: Vec::with_capacity(surfaces + SAMPLES / RUN),
            samples: Vec::with_capacity(SAMPLES),
            pixels: Vec::with_capacity(TILE * TILE),
        }
    }

    /// Shades a tile of an image into `out`, all of it.
    pub(super) fn shade_tile(&mut self, view: &View<'_>, tile: usize, out: &mut [f32]) {
        let (lens, step) = (view.lens, &view.lens.steps[tile]);
        let (width, height) = (lens.model.width_px, lens.model.height_px);
        let (column, v0) = (tile % lens.columns, tile / lens.columns * TILE);
        let mut rays = None;
        for (v, [x, y]) in (v0..height).zip(lens.bearings(tile)) {
            let (x, y) = (x.as_chunks::<RUN>().0, y.as_chunks::<RUN>().0);
            let is_edge = view.cover.edges[v * lens.columns + column].as_chunks::<RUN>().0;
            let row = &view.cover.row(lens, v + 1)[1..];
            for (k, is_edge) in is_edge.iter().enumerate() {
                let u = column * TILE + k * RUN;
                if u >= width {
                    break;
                }
                let place = (v * width + u) as u32;
                if none(is_edge) {
                    let values = shaded(view, row[u], [&x[k], &y[k]], step, true);
                    out[place as usize..][..RUN].copy_from_slice(&values);
                    continue;
                }
                let rays = rays.get_or_insert_with(|| Rays::new(step));
                for i in 0..RUN.min(width - u) {
                    let at = [x[k][i], y[k][i]];
                    if is_edge[i] == 0 {
                        self.add(view, row[u + i], at, 1.0, step);
                    } else {
                        let ids = view.cover.around(lens, u + i, v);
                        self.add_edge(view, (tile, rays), &ids, at);
                    }
                    self.pixels.push(Pixel { place: place + i as u32, end: self.samples.len() as u16 });
                }
            }
        }
        self.finish(view, step, out);
    }

    /// Adds a sample of facet `id`.
    #[inline]
    fn add(&mut self, view: &View<'_>, id: u16, at: [f32; 2], share: f32, step: &[f32; 4]) {
        let waiting = &mut self.waiting[id as usize];
        let k = waiting.count % RUN;
        (waiting.x[k], waiting.y[k], waiting.sample[k]) = (at[0], at[1], self.samples.len() as u16);
        if k == 0 {
            self.touched.push(id);
        }
        waiting.count = k + 1;
        self.samples.push(Sample { share, value: 0.0 });
        if k + 1 == RUN {
            self.shade_waiting(view, id, step);
        }
    }

    fn shade_waiting(&mut self, view: &View<'_>, id: u16, step: &[f32; 4]) {
        let waiting = &mut self.waiting[id as usize];
        let values = shaded(view, id, [&waiting.x, &waiting.y], step, false);
        for (number, value) in waiting.sample.iter().zip(values).take(waiting.count) {
            self.samples[*number as usize].value = value;
        }
        waiting.count = 0;
    }

    /// Shades what still waits, and sums the samples of each pixel.
    fn finish(&mut self, view: &View<'_>, step: &[f32; 4], out: &mut [f32]) {
        while let Some(id) = self.touched.pop() {
            let waiting = &mut self.waiting[id as usize];
            if waiting.count > 0 {
                // Lanes that are left over repeat one that is on this facet.
                let (x, y) = (waiting.x[0], waiting.y[0]);
                waiting.x[waiting.count..].fill(x);
                waiting.y[waiting.count..].fill(y);
                self.shade_waiting(view, id, step);
            }
        }
        let mut begin = 0;
        for pixel in &self.pixels {
            let (mut sum, mut total) = (0.0, 0.0);
            for sample in &self.samples[begin..pixel.end as usize] {
                sum += sample.share * sample.value;
                total += sample.share;
            }
            begin = pixel.end as usize;
            out[pixel.place as usize] = if total > 0.0 { sum / total } else { 0.0 };
        }
        self.samples.clear();
        self.pixels.clear();
    }

    /// Adds the samples of a pixel that several facets may share.
    fn add_edge(&mut self, view: &View<'_>, (tile, rays): (usize, &Rays), ids: &[[u16; 3]; 3], at: [f32; 2]) {
        let mut candidates = [NONE; PIXEL_FACETS];
        let count = candidates_of(view, tile, ids, at, &rays.reach, &mut candidates);
        let (x, y) = (Rays::from(at[0], &rays.x), Rays::from(at[1], &rays.y));
        let (mut depth, mut seen) = ([0.0; TILE], [PIXEL_FACETS as u32; TILE]);
        for (k, &id) in candidates[..count].iter().enumerate() {
            view.cover.facets[id as usize].cover_row(k as u32, &x, &y, &mut depth, &mut seen);
        }
        let mut left = TILE as u32;
        for (k, &id) in candidates[..count].iter().enumerate() {
            let (share, sums) = share(k as u32, &seen, &x, &y);
            if share > 0 {
                let share_px = share as f32;
                self.add(view, id, sums.map(|sum| sum / share_px), share_px, &view.lens.steps[tile]);
                left -= share;
            }
            if left == 0 {
                return;
            }
        }
    }
}

/// Brightness of a run of bearings that all see facet `id`, side by side or anywhere.
#[inline]
fn shaded(
    view: &View<'_>,
    id: u16,
    bearings: [&[f32; RUN]; 2],
    step: &[f32; 4],
    are_side_by_side: bool,
) -> [f32; RUN] {
    let facet = &view.cover.facets[id as usize];
    let (plan, on_surface) = facet.plan(view.world, bearings, step);
    let light = match are_side_by_side {
        true => facet.light_along(view.world, &on_surface),
        false => facet.light_at(view.world, &on_surface),
    };
    facet.lit(view.world, &facet.texture(view.world).means(&plan), &light)
}

/// Facets that a pixel may show: those of its neighbours, and any of the tile that touch it, however
/// thin. Returns their number.
fn candidates_of(
    view: &View<'_>,
    tile: usize,
    ids: &[[u16; 3]; 3],
    at: [f32; 2],
    reach: &[f32; 2],
    into: &mut [u16; PIXEL_FACETS],
) -> usize {
    let mut count = 0;
    let span = Span { x: [at[0] - reach[0], at[0] + reach[0]], y: [at[1] - reach[1], at[1] + reach[1]] };
    let touches = |id: &u16| view.cover.facets[*id as usize].nearest_within(&span).is_some();
    let near = ids.as_flattened().iter().copied().filter(|id| *id != NONE);
    for (id, is_near) in near.map(|id| (id, true)).chain(view.cover.facets_of(tile).map(|id| (id, false))) {
        let is_new = count < PIXEL_FACETS && !into[..count].contains(&id);
        if is_new && (is_near || touches(&id)) {
            into[count] = id;
            count += 1;
        }
    }
    count
}

/// True if no pixel is on an edge.
#[inline]
fn none(edges: &[u16]) -> bool {
    edges.iter().fold(0, |any, edge| any | edge) == 0
}

/// Returns the number of rays that see candidate `k`, and the sums of their bearings, in the order of the rays.
#[inline]
fn share(k: u32, seen: &[u32; TILE], x: &[f32; TILE], y: &[f32; TILE]) -> (u32, [f32; 2]) {
    let share = seen.iter().map(|id| u32::from(*id == k)).sum();
    if share == 0 {
        return (0, [0.0; 2]);
    }
    let own = |all: &[f32; TILE]| -> [f32; TILE] {
        std::array::from_fn(|i| if seen[i] == k { all[i] } else { 0.0 })
    };
    let (x, y) = (own(x), own(y));
    (share, x.iter().zip(&y).fold([0.0; 2], |sum, (x, y)| [sum[0] + x, sum[1] + y]))
}
