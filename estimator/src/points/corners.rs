//! Corners (Shi and Tomasi 1994), one in each empty cell of a grid.
//!
//! The score is the lesser eigenvalue of the structure tensor, averaged over a 7x7 window, with gradients by
//! central differences: grey levels squared per px². It is computed in the cells that need a point and
//! nowhere else. Where texture is poor, weaker corners are taken too, but never ones within the noise.

use crate::image::Plane;
use crate::image::mask::ImageMask;
use nalgebra::Vector2;

/// Half the window of the structure tensor: 7x7 px, the core of the tracked patch.
const WINDOW: usize = 3;
/// Rows of the window.
const ROWS: usize = 2 * WINDOW + 1;
/// Divisor of sums over a window: its pixels times four, as differences over two pixels have products four
/// times too large.
const AREA: f32 = (4 * ROWS * ROWS) as f32;
/// Score of a corner that is nothing but noise: white noise of one grey level has 0.5, and the best of a
/// cell's thousand windows about twice that.
const NOISE_SCORE: f32 = 1.2;
/// More than a score can be too great by rounding: the greatest is 16256.
const ROUNDING: f32 = 0.01;
/// Weak corners are taken until this share of the wanted points is reached.
const POOR_SHARE: f32 = 0.6;
/// New points keep this distance from others, in cells.
const MIN_DISTANCE_CELLS: f32 = 0.4;
/// Pixels worked on at a time: an AVX2 register of whole numbers. With more of them more lie beyond a cell.
const LANES: usize = 8;
/// Empty cells looked at in a frame that has half of its points: bounds the work where much of the image is
/// without texture and stays empty.
const MIN_CELLS: usize = 40;
/// Empty cells looked at per point wanted in a frame that has fewer.
const CELLS_PER_POINT: usize = 3;
/// Largest side of a cell, px: bounds the work buffers.
const MAX_CELL_PX: usize = 128;
/// Most scores of a row of a cell and of its neighbours, and pixels of a row from which they are summed.
const MAX_STRIDE: usize = (MAX_CELL_PX + 2).next_multiple_of(LANES);
const MAX_SPAN: usize = span_of(MAX_STRIDE / LANES);

/// A corner found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectedCorner {
    /// Pixel of the corner.
    pub px: Vector2<f32>,
    /// Shi-Tomasi score: the lesser eigenvalue of the structure tensor per pixel, squared grey levels per px².
    pub score: f32,
}

/// Demand on a detection.
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
    corners: Vec<DetectedCorner>,
    map: ScoreMap,
    mask: Option<ImageMask>,
    /// Cells without a pixel that the mask leaves.
    hidden_cells: Vec<usize>,
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
            map: ScoreMap::EMPTY,
            mask: None,
            hidden_cells: Vec::new(),
        }
    }

    /// Takes no corners from now on that `mask` hides.
    pub fn set_mask(&mut self, mask: ImageMask) {
        let columns = self.width.div_ceil(self.cell_px);
        let is_hidden = |cell: &usize| {
            let start = [cell % columns, cell / columns].map(|k| k * self.cell_px);
            let (us, vs) = (start[0]..start[0] + self.cell_px, start[1]..start[1] + self.cell_px);
            let (us, vs) = (us.start..us.end.min(self.width), vs.start..vs.end.min(self.height));
            vs.clone().all(|v| us.clone().all(|u| mask.hides(u, v)))
        };
        self.hidden_cells = (0..self.taken.len()).filter(is_hidden).collect();
        self.mask = Some(mask);
    }

    /// The best corners of the cells that hold none of `existing`, best first (ties: by row, then column).
    pub fn detect(
        &mut self,
        plane: &Plane<'_>,
        existing: &[Vector2<f32>],
        demand: &Demand,
    ) -> &[DetectedCorner] {
        self.corners.clear();
        let max_new = demand.max_new.min(demand.wanted.saturating_sub(existing.len()));
        if max_new == 0 {
            return &self.corners;
        }
        self.mark(existing);
        let few = 2 * existing.len() < demand.wanted;
        let budget = if few { MIN_CELLS.max(CELLS_PER_POINT * max_new) } else { MIN_CELLS };
        self.visit_cells(plane, existing, budget, max_new);
        let strong = self.corners.partition_point(|c| c.score >= self.min_score);
        let poor = (POOR_SHARE * demand.wanted as f32) as usize;
        self.corners.truncate(strong.max(poor.saturating_sub(existing.len())));
        &self.corners
    }

    /// Looks for corners, at most `max_new`, in at most `budget` empty cells, in turn: it goes on where the last frame ended.
    fn visit_cells(&mut self, plane: &Plane<'_>, existing: &[Vector2<f32>], budget: usize, max_new: usize) {
        let columns = self.width.div_ceil(self.cell_px);
        let cells = self.taken.len();
        let (mut left, mut limit) = (budget, NOISE_SCORE);
        for _ in 0..cells {
            if left == 0 {
                break;
            }
            let cell = self.next_cell;
            // A step of many cells spreads the few that are visited over the image.
            self.next_cell = (self.next_cell + self.stride) % cells;
            if !self.taken[cell] {
                left -= 1;
                let Some(found) = self.best_of_cell(plane, [cell % columns, cell / columns], existing, limit)
                else {
                    continue;
                };
                let place = |c: &DetectedCorner| (c.px.y as u32, c.px.x as u32);
                let is_before = |c: &DetectedCorner| {
                    found.score.total_cmp(&c.score).then(place(c).cmp(&place(&found))).is_lt()
                };
                self.corners.insert(self.corners.partition_point(is_before), found);
                self.corners.truncate(max_new);
                if self.corners.len() == max_new {
                    // A weaker one would not be among them.
                    limit = self.corners[max_new - 1].score.next_down();
                }
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
        self.hidden_cells.iter().for_each(|cell| self.taken[*cell] = true);
    }

    fn best_of_cell(
        &mut self,
        plane: &Plane<'_>,
        [column, row]: [usize; 2],
        existing: &[Vector2<f32>],
        limit: f32,
    ) -> Option<DetectedCorner> {
        let span = |index: usize, size: usize| {
            let start = (index * self.cell_px).max(self.border_px);
            let end = ((index + 1) * self.cell_px).min(size.saturating_sub(self.border_px));
            (start < end).then_some((start, end))
        };
        let ((x0, x1), (y0, y1)) = (span(column, self.width)?, span(row, self.height)?);
        let place = |x: usize, y: usize| Vector2::new((x0 + x) as f32, (y0 + y) as f32);
        let distance = MIN_DISTANCE_CELLS * self.cell_px as f32;
        // All of them, without an end at the first that is near: many at a time.
        let mask = self.mask.as_ref();
        let is_free = |x: usize, y: usize| {
            let px = place(x, y);
            let is_far = existing
                .iter()
                .fold(true, |free, other| free & ((other - px).norm_squared() >= distance * distance));
            is_far && !mask.is_some_and(|mask| mask.hides(x0 + x, y0 + y))
        };
        let (x, y, score) = self.map.best(plane, [x0, y0], [x1 - x0, y1 - y0], limit, is_free)?;
        Some(DetectedCorner { px: place(x, y), score })
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

/// Whole numbers of neighbouring pixels.
type Lanes = [i32; LANES];

/// Scores of a rectangle and of one pixel around it, row by row. All rows are as long as whole vectors, so that none is worked
/// on pixel by pixel; what lies beyond the rectangle then is of no account.
#[derive(Clone, Debug)]
struct ScoreMap {
    /// Products of gradients, `gx gx`, `gx gy`, `gy gy`, of the window's rows, and their sums over these.
    products: [[[i32; MAX_SPAN]; 3]; ROWS],
    columns: [[i32; MAX_SPAN]; 3],
    /// The last three rows of scores. One that cannot be the best is zero.
    scores: [ScoreRow; 3],
}

/// Scores of a row, with a place before and after for neighbours.
type ScoreRow = [f32; MAX_STRIDE + 2];

impl ScoreMap {
    const EMPTY: Self = Self {
        products: [[[0; MAX_SPAN]; 3]; ROWS],
        columns: [[0; MAX_SPAN]; 3],
        scores: [[0.0; MAX_STRIDE + 2]; 3],
    };

    /// The best local maximum of the score, above `limit`, that `is_free` accepts in the rectangle at `from` of `size`
    /// (image pixels), in coordinates within it. The plane is one with a rim.
    fn best(
        &mut self,
        plane: &Plane<'_>,
        from: [usize; 2],
        size: [usize; 2],
        mut limit: f32,
        is_free: impl Fn(usize, usize) -> bool,
    ) -> Option<(usize, usize, f32)> {
        let [width, height] = size;
        let vectors = (width + 2).div_ceil(LANES);
        // The first pixel that has a say.
        let [left, top] = from.map(|first| first + plane.origin - WINDOW - 2);
        let pixels = &plane.pixels[top * plane.columns + left..];
        let span = span_of(vectors);
        let sums = self.products.iter_mut().chain([&mut self.columns]).flatten();
        sums.for_each(|sums| sums[..span].fill(0));
        let mut best = None;
        // Vectors with a score above the limit in the last row, one bit each.
        let mut last_above = 0;
        for y in 0..height + 2 * WINDOW + 2 {
            // A row takes the place of the one that leaves the window.
            let around = [0, 1, 2].map(|dy| &pixels[(y + dy) * plane.columns..][..span + 2]);
            let [xx, xy, yy] = self.columns.each_mut().map(|sums| &mut sums[..span]);
            let [old_xx, old_xy, old_yy] = self.products[y % ROWS].each_mut().map(|row| &mut row[..span]);
            replace(around, xx, xy, yy, old_xx, old_xy, old_yy);
            let Some(scored) = y.checked_sub(2 * WINDOW) else { continue };
            let above = last_above;
            last_above = score_row(&self.columns, vectors, limit, &mut self.scores[scored % 3]);
            // A row is looked at when the one below has its scores.
            let Some(row) = scored.checked_sub(2) else { continue };
            let scores = [0, 1, 2].map(|dy| &self.scores[(row + dy) % 3]);
            for k in ones(above) {
                for x in ones(maxima(scores, k * LANES, limit)).map(|lane| k * LANES + lane) {
                    let score = scores[1][x + 1];
                    if (1..=width).contains(&x) && score > limit && is_free(x - 1, row) {
                        limit = score;
                        best = Some((x - 1, row, score));
                    }
                }
            }
        }
        best
    }
}

/// Pixels of a row of products from which a row of so many vectors of scores is summed, in whole vectors.
const fn span_of(vectors: usize) -> usize {
    (vectors * LANES + 2 * WINDOW).next_multiple_of(LANES)
}

/// Places of the ones of a number.
fn ones(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = (bits != 0).then(|| bits.trailing_zeros() as usize)?;
        bits &= bits - 1;
        Some(place)
    })
}

// Functions of their own, whose results lie in memory: where they are many values in registers, the compiler takes them one
// by one.

/// Adds to sums the products of the gradients of a row, by the rows of pixels above, of it and below, which reach one beyond it on
/// both sides; and takes those of an old one away, whose place they take.
#[inline(never)]
fn replace(
    around: [&[u8]; 3],
    xx: &mut [i32],
    xy: &mut [i32],
    yy: &mut [i32],
    old_xx: &mut [i32],
    old_xy: &mut [i32],
    old_yy: &mut [i32],
) {
    let n = xx.len();
    let [above, row, below] = around.map(|row| &row[..n + 2]);
    let (xy, yy) = (&mut xy[..n], &mut yy[..n]);
    let (old_xx, old_xy, old_yy) = (&mut old_xx[..n], &mut old_xy[..n], &mut old_yy[..n]);
    for i in 0..n {
        let gx = i32::from(row[i + 2]) - i32::from(row[i]);
        let gy = i32::from(below[i + 1]) - i32::from(above[i + 1]);
        xx[i] += gx * gx - old_xx[i];
        xy[i] += gx * gy - old_xy[i];
        yy[i] += gy * gy - old_yy[i];
        (old_xx[i], old_xy[i], old_yy[i]) = (gx * gx, gx * gy, gy * gy);
    }
}

/// Scores from column sums, so many vectors; which of them have one above `limit`, one bit each. The lesser eigenvalue is no greater
/// than either entry of the diagonal: most have no sums from which it can exceed the limit, and are left at zero.
#[inline(never)]
fn score_row(columns: &[[i32; MAX_SPAN]; 3], vectors: usize, limit: f32, scores: &mut ScoreRow) -> u32 {
    let least = ((limit - ROUNDING) * AREA) as i32;
    let mut above = 0;
    for (k, scores) in scores[1..].as_chunks_mut().0[..vectors].iter_mut().enumerate() {
        let sums = |of: usize| window_sums(&columns[of][k * LANES..]);
        let may_exceed = |sums: &Lanes| sums.iter().fold(false, |found, sum| found | (*sum > least));
        *scores = [0.0; LANES];
        let xx = sums(0);
        if !may_exceed(&xx) {
            continue;
        }
        let yy = sums(2);
        if may_exceed(&std::array::from_fn(|i| xx[i].min(yy[i]))) {
            above |= u32::from(score(&xx, &sums(1), &yy, limit, scores)) << k;
        }
    }
    above
}

/// Scores from the sums of windows: the lesser eigenvalue of the window's mean structure tensor. Whether one exceeds `limit`.
#[inline(never)]
fn score(xx: &Lanes, xy: &Lanes, yy: &Lanes, limit: f32, scores: &mut [f32; LANES]) -> bool {
    const NORM: f32 = 1.0 / AREA;
    let [xx, xy, yy] = [xx, xy, yy].map(|sums| sums.map(|sum| sum as f32 * NORM));
    for k in 0..LANES {
        let difference = xx[k] - yy[k];
        scores[k] = 0.5 * (xx[k] + yy[k] - (difference * difference + 4.0 * xy[k] * xy[k]).sqrt());
    }
    scores.iter().fold(false, |found, score| found | (*score > limit))
}

/// Local maxima of a vector of scores at `x`, by the rows above, of it and below: above `limit` and no less than any neighbour.
#[inline(never)]
fn maxima(scores: [&ScoreRow; 3], x: usize, limit: f32) -> u32 {
    let [above, row, below] = scores.map(|scores| &scores[x..][..LANES + 2]);
    let mut bits = [0u32; LANES];
    for k in 0..LANES {
        let centre = row[k + 1];
        let mut is_maximum = centre > limit;
        for d in 0..3 {
            is_maximum &= (above[k + d] <= centre) & (row[k + d] <= centre) & (below[k + d] <= centre);
        }
        bits[k] = u32::from(is_maximum) << k;
    }
    bits.iter().fold(0, |all, bit| all | bit)
}

/// Sums over `2 WINDOW + 1` neighbours.
#[inline(always)]
fn window_sums(columns: &[i32]) -> Lanes {
    let columns = &columns[..LANES + 2 * WINDOW];
    let mut sums = [0; LANES];
    for k in 0..=2 * WINDOW {
        for i in 0..LANES {
            sums[i] += columns[k + i];
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Pyramid, synthetic::Texture};
    use plumbline_config::{GrayImage, Random};

    fn detect(image: &GrayImage, existing: &[Vector2<f32>], demand: &Demand) -> Vec<DetectedCorner> {
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
        let mut random = Random::new(9);
        let noise = texture.render_through(752, 480, |p| p, |_| 100.0 + 0.9 * random.gaussian());
        assert!(detect(&noise, &[], &demand).len() < 10);
        assert!(detect(&GrayImage::new(752, 480), &[], &demand).is_empty());
    }
}
