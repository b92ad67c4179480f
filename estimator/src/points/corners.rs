//! Corners (Shi and Tomasi 1994), one in each empty cell of a grid.
//!
//! The score is the lesser eigenvalue of the structure tensor, averaged over a 7x7 window, with gradients by
//! central differences: grey levels squared per px². It is computed in the cells that need a point and
//! nowhere else. Where texture is poor, weaker corners are taken too, but never ones within the noise.

use crate::image::Plane;
use nalgebra::Vector2;

/// Half the window of the structure tensor: 7x7 px, the core of the tracked patch.
const WINDOW: usize = 3;
/// Pixels of the window.
const WINDOW_AREA: i32 = ((2 * WINDOW + 1) * (2 * WINDOW + 1)) as i32;
/// Score of a corner that is nothing but noise: white noise of one grey level has 0.5, and the best of a
/// cell's thousand windows about twice that.
const NOISE_SCORE: f32 = 1.2;
/// Weak corners are taken until this share of the wanted points is reached.
const POOR_SHARE: f32 = 0.6;
/// New points keep this distance from others, in cells.
const MIN_DISTANCE_CELLS: f32 = 0.4;
/// Scores computed at a time: two AVX2 registers.
const LANES: usize = 16;
/// Empty cells looked at in a frame that has half of its points: bounds the work where much of the image is
/// without texture and stays empty.
const MIN_CELLS: usize = 40;
/// Empty cells looked at per point wanted in a frame that has fewer.
const CELLS_PER_POINT: usize = 3;
/// Largest side of a cell, px: bounds the work buffers.
const MAX_CELL_PX: usize = 128;

/// A corner found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Pixel of the corner.
    pub px: Vector2<f32>,
    /// Shi-Tomasi score: the lesser eigenvalue of the structure tensor per pixel, squared grey levels per px².
    pub score: f32,
}

/// What is wanted of a detection.
#[derive(Clone, Copy, Debug)]
pub struct Demand {
    /// Points wanted in all, those that exist included.
    pub wanted: usize,
    /// Most new points this time.
    pub max_new: usize,
}

/// Finds corners in the empty cells of an image. Preallocated.
#[derive(Clone, Debug)]
pub struct CornerDetector {
    width: usize,
    height: usize,
    cell_px: usize,
    border_px: usize,
    min_score: f32,
    taken: Vec<bool>,
    /// The cell to be visited next, and the way to the one after: coprime to the number of cells.
    next_cell: usize,
    stride: usize,
    corners: Vec<Corner>,
    map: ScoreMap,
}

impl CornerDetector {
    /// A detector for images of `width` x `height` px. Corners keep `border_px` from the edge; one weaker than
    /// `min_score` is none.
    #[must_use]
    pub fn new(width: usize, height: usize, cell_px: usize, border_px: usize, min_score: f32) -> Self {
        let cell_px = cell_px.clamp(8, MAX_CELL_PX);
        let cells = width.div_ceil(cell_px) * height.div_ceil(cell_px);
        Self {
            width,
            height,
            cell_px,
            // The score needs the window, the gradient and a neighbour for the local maximum.
            border_px: border_px.max(WINDOW + 2),
            min_score,
            taken: vec![false; cells],
            next_cell: 0,
            stride: coprime_step(cells),
            corners: Vec::with_capacity(cells),
            map: ScoreMap::new(cell_px),
        }
    }

    /// The best corners of the cells that hold none of `existing`, best first (ties: by row, then column).
    pub fn detect(&mut self, plane: &Plane<'_>, existing: &[Vector2<f32>], demand: &Demand) -> &[Corner] {
        self.corners.clear();
        let max_new = demand.max_new.min(demand.wanted.saturating_sub(existing.len()));
        if max_new == 0 {
            return &self.corners;
        }
        self.mark(existing);
        let few = 2 * existing.len() < demand.wanted;
        self.visit_cells(
            plane,
            existing,
            if few { MIN_CELLS.max(CELLS_PER_POINT * max_new) } else { MIN_CELLS },
        );
        self.corners.sort_unstable_by(|a, b| {
            let place = |c: &Corner| (c.px.y as u32, c.px.x as u32);
            b.score.total_cmp(&a.score).then(place(a).cmp(&place(b)))
        });
        let strong = self.corners.partition_point(|c| c.score >= self.min_score);
        let poor = (POOR_SHARE * demand.wanted as f32) as usize;
        let count = strong.max(poor.saturating_sub(existing.len()).min(self.corners.len()));
        self.corners.truncate(count.min(max_new));
        &self.corners
    }

    /// Looks for a corner in at most `budget` empty cells, in turn: it goes on where the last frame ended.
    fn visit_cells(&mut self, plane: &Plane<'_>, existing: &[Vector2<f32>], budget: usize) {
        let columns = self.width.div_ceil(self.cell_px);
        let cells = self.taken.len();
        let mut left = budget;
        for _ in 0..cells {
            if left == 0 {
                break;
            }
            let cell = self.next_cell;
            // A step of many cells spreads the few that are visited over the image.
            self.next_cell = (self.next_cell + self.stride) % cells;
            if !self.taken[cell] {
                left -= 1;
                let found = self.best_of_cell(plane, cell % columns, cell / columns, existing);
                self.corners.extend(found);
            }
        }
    }

    fn mark(&mut self, existing: &[Vector2<f32>]) {
        self.taken.fill(false);
        let columns = self.width.div_ceil(self.cell_px);
        for px in existing {
            // A cast saturates: a position outside falls into a cell of the edge.
            let column = (px.x as usize / self.cell_px).min(columns - 1);
            let row = px.y as usize / self.cell_px;
            if let Some(taken) = self.taken.get_mut(row * columns + column) {
                *taken = true;
            }
        }
    }

    fn best_of_cell(
        &mut self,
        plane: &Plane<'_>,
        column: usize,
        row: usize,
        existing: &[Vector2<f32>],
    ) -> Option<Corner> {
        let span = |index: usize, size: usize| {
            let start = (index * self.cell_px).max(self.border_px);
            let end = ((index + 1) * self.cell_px).min(size.saturating_sub(self.border_px));
            (start < end).then_some((start, end))
        };
        let ((x0, x1), (y0, y1)) = (span(column, self.width)?, span(row, self.height)?);
        self.map.compute(plane, [x0, y0], [x1 - x0, y1 - y0]);
        let distance = MIN_DISTANCE_CELLS * self.cell_px as f32;
        self.map
            .best(NOISE_SCORE, |x, y| {
                let px = Vector2::new((x0 + x) as f32, (y0 + y) as f32);
                existing.iter().all(|other| (other - px).norm_squared() >= distance * distance)
            })
            .map(|(x, y, score)| Corner { px: Vector2::new((x0 + x) as f32, (y0 + y) as f32), score })
    }
}

/// A step by which all of `count` places are visited in turn, far from each other: near the golden section.
fn coprime_step(count: usize) -> usize {
    let is_coprime = |step: usize| {
        let (mut a, mut b) = (count, step);
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a == 1
    };
    (count * 618 / 1000..count).find(|&s| is_coprime(s)).unwrap_or(1)
}

/// Scores of a rectangle and of one pixel around it.
#[derive(Clone, Debug)]
struct ScoreMap {
    /// Row length of all buffers.
    stride: usize,
    /// Products of the gradients, one row: `gx gx`, `gx gy`, `gy gy`; ring of window rows.
    products: [Vec<i32>; 3],
    /// Sums of the products over the window's rows.
    columns: [Vec<i32>; 3],
    scores: Vec<f32>,
    width: usize,
    height: usize,
}

impl ScoreMap {
    fn new(cell_px: usize) -> Self {
        // A whole chunk may start within the last few pixels.
        let stride = cell_px + 2 * (WINDOW + 1) + LANES;
        let rows = 2 * WINDOW + 1;
        Self {
            stride,
            products: std::array::from_fn(|_| vec![0; stride * rows]),
            columns: std::array::from_fn(|_| vec![0; stride]),
            scores: vec![0.0; (cell_px + 2) * (cell_px + 2)],
            width: 0,
            height: 0,
        }
    }

    /// Scores of the rectangle at `from` of `size` (image pixels), and of its neighbours.
    fn compute(&mut self, plane: &Plane<'_>, from: [usize; 2], size: [usize; 2]) {
        (self.width, self.height) = (size[0] + 2, size[1] + 2);
        let span = self.width + 2 * WINDOW;
        // The first pixel whose gradient is needed, in coordinates of the plane.
        let left = from[0] + plane.origin - WINDOW - 1;
        let top = from[1] + plane.origin - WINDOW - 1;
        let rows = 2 * WINDOW + 1;
        self.columns.iter_mut().for_each(|c| c.fill(0));
        for y in 0..self.height + 2 * WINDOW {
            let slot = (y % rows) * self.stride;
            let row = |dy: usize| &plane.pixels[(top + y + dy - 1) * plane.columns + left - 1..][..span + 2];
            let [xx, xy, yy] = &mut self.products;
            let out = [&mut xx[slot..slot + span], &mut xy[slot..slot + span], &mut yy[slot..slot + span]];
            replace_row(
                [row(0), row(1), row(2)],
                out,
                self.columns.each_mut().map(|c| &mut c[..span]),
                y >= rows,
            );
            if y + 1 >= rows {
                let sums = self.columns.each_ref().map(Vec::as_slice);
                let start = (y + 1 - rows) * self.width;
                score_row(sums, &mut self.scores[start..start + self.width]);
            }
        }
    }

    /// The best local maximum above `floor` that `allowed` accepts (coordinates within the rectangle).
    fn best(&self, floor: f32, allowed: impl Fn(usize, usize) -> bool) -> Option<(usize, usize, f32)> {
        let mut best = None;
        let mut limit = floor;
        for y in 1..self.height - 1 {
            let row = &self.scores[y * self.width..(y + 1) * self.width];
            if !has_above(row, limit) {
                continue;
            }
            for (x, &score) in row[..self.width - 1].iter().enumerate().skip(1) {
                if score > limit && self.is_maximum(x, y) && allowed(x - 1, y - 1) {
                    limit = score;
                    best = Some((x - 1, y - 1, score));
                }
            }
        }
        best
    }

    fn is_maximum(&self, x: usize, y: usize) -> bool {
        let centre = self.scores[y * self.width + x];
        (y - 1..=y + 1).all(|v| {
            self.scores[v * self.width + x - 1..=v * self.width + x + 1].iter().all(|&s| s <= centre)
        })
    }
}

/// Puts a row's gradient products in the place of the row that leaves the window, and updates the sums.
fn replace_row(rows: [&[u8]; 3], products: [&mut [i32]; 3], columns: [&mut [i32]; 3], full: bool) {
    let n = products[0].len();
    let [above, middle, below] = rows.map(|r| &r[..n + 2]);
    let [xx, xy, yy] = products.map(|p| &mut p[..n]);
    let [sum_xx, sum_xy, sum_yy] = columns.map(|c| &mut c[..n]);
    let keep = i32::from(full);
    for i in 0..n {
        let gx = i32::from(middle[i + 2]) - i32::from(middle[i]);
        let gy = i32::from(below[i + 1]) - i32::from(above[i + 1]);
        let (new_xx, new_xy, new_yy) = (gx * gx, gx * gy, gy * gy);
        sum_xx[i] += new_xx - keep * xx[i];
        sum_xy[i] += new_xy - keep * xy[i];
        sum_yy[i] += new_yy - keep * yy[i];
        (xx[i], xy[i], yy[i]) = (new_xx, new_xy, new_yy);
    }
}

/// Scores from column sums: the lesser eigenvalue of the window's mean structure tensor.
fn score_row(columns: [&[i32]; 3], scores: &mut [f32]) {
    // The differences above are over two pixels, so their products are four times too large.
    const NORM: f32 = 1.0 / (4 * WINDOW_AREA) as f32;
    for (i, chunk) in scores.chunks_mut(LANES).enumerate() {
        let mut tensor = [[0.0f32; LANES]; 3];
        for (out, column) in tensor.iter_mut().zip(columns) {
            // The buffers are long enough for a whole last chunk.
            *out = window_sums(&column[i * LANES..i * LANES + LANES + 2 * WINDOW]).map(|s| s as f32 * NORM);
        }
        let [xx, xy, yy] = tensor;
        let mut lesser = [0.0; LANES];
        for k in 0..LANES {
            let difference = xx[k] - yy[k];
            lesser[k] = 0.5 * (xx[k] + yy[k] - (difference * difference + 4.0 * xy[k] * xy[k]).sqrt());
        }
        chunk.copy_from_slice(&lesser[..chunk.len()]);
    }
}

/// Whether one of the scores exceeds `limit`: most rows have none, and all lanes at once tell.
#[inline(never)]
fn has_above(scores: &[f32], limit: f32) -> bool {
    scores.iter().fold(false, |found, score| found | (*score > limit))
}

/// Sums over `2 WINDOW + 1` neighbours.
#[inline]
fn window_sums(column: &[i32]) -> [i32; LANES] {
    let mut sums = [0; LANES];
    for k in 0..=2 * WINDOW {
        let shifted = &column[k..k + LANES];
        for i in 0..LANES {
            sums[i] += shifted[i];
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{
        Pyramid,
        synthetic::{Random, Texture},
    };
    use plumbline_config::GrayImage;

    fn detect(image: &GrayImage, existing: &[Vector2<f32>], demand: &Demand) -> Vec<Corner> {
        let mut pyramid = Pyramid::new(image.width(), image.height(), 1);
        assert!(pyramid.build(&image.view()));
        let mut detector = CornerDetector::new(image.width(), image.height(), 42, 8, 12.0);
        detector.detect(&pyramid.plane(0), existing, demand).to_vec()
    }

    const ALL: Demand = Demand { wanted: 500, max_new: 500 };

    #[test]
    fn corners_are_spread_and_the_same_every_time() {
        let image = Texture::new(5).render(752, 480);
        let corners = detect(&image, &[], &ALL);
        assert!(corners.len() > 190, "{}", corners.len());
        assert_eq!(corners, detect(&image, &[], &ALL));
        for corner in &corners {
            assert!(corner.px.x >= 8.0 && corner.px.y >= 8.0 && corner.px.x < 744.0 && corner.px.y < 472.0);
        }
        let mut cells: Vec<_> =
            corners.iter().map(|c| (c.px.x as usize / 42, c.px.y as usize / 42)).collect();
        cells.sort_unstable();
        cells.dedup();
        assert_eq!(cells.len(), corners.len());
    }

    #[test]
    fn the_score_is_that_of_the_definition() {
        let image = Texture::new(6).render(128, 128);
        let g = |x: usize, y: usize| f64::from(image.pixels()[y * 128 + x]);
        for corner in detect(&image, &[], &ALL) {
            let (cx, cy) = (corner.px.x as usize, corner.px.y as usize);
            let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
            for y in cy - 3..=cy + 3 {
                for x in cx - 3..=cx + 3 {
                    let (gx, gy) = ((g(x + 1, y) - g(x - 1, y)) / 2.0, (g(x, y + 1) - g(x, y - 1)) / 2.0);
                    (xx, xy, yy) = (xx + gx * gx / 49.0, xy + gx * gy / 49.0, yy + gy * gy / 49.0);
                }
            }
            let lesser = 0.5 * (xx + yy - ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt());
            assert!((lesser - f64::from(corner.score)).abs() < 1e-3 * lesser, "{lesser} {}", corner.score);
        }
    }

    #[test]
    fn taken_cells_stay_free_and_distances_are_kept() {
        let image = Texture::new(7).render(376, 240);
        let first: Vec<_> =
            detect(&image, &[], &Demand { wanted: 30, max_new: 20 }).iter().map(|c| c.px).collect();
        assert_eq!(first.len(), 20);
        let more = detect(&image, &first, &Demand { wanted: 30, max_new: 20 });
        assert_eq!(more.len(), 10);
        for corner in &more {
            assert!(first.iter().all(|p| (p - corner.px).norm() >= 0.4 * 42.0));
        }
    }

    #[test]
    fn low_contrast_still_yields_corners_and_noise_does_not() {
        let texture = Texture::new(8);
        let faint = texture.render_through(752, 480, |p| p, |g| 100.0 + 0.12 * (g - 128.0));
        let demand = Demand { wanted: 200, max_new: 200 };
        let corners = detect(&faint, &[], &demand);
        assert!(corners.len() >= 60, "{}", corners.len());
        let mut random = Random(9);
        let noise = texture.render_through(752, 480, |p| p, |_| 100.0 + 0.9 * random.gaussian());
        assert!(detect(&noise, &[], &demand).len() < 10);
        assert!(detect(&GrayImage::new(752, 480), &[], &demand).is_empty());
    }
}
