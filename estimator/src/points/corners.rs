//! Corners (Shi and Tomasi 1994), one in each empty cell of a grid.
//!
//! The score is the lesser eigenvalue of the structure tensor, averaged over a 7x7 window, with gradients by
//! central differences: grey levels squared per px². It is computed in the cells that need a point and
//! nowhere else. Where texture is poor, weaker corners are taken too, but never ones within the noise.

use crate::image::Plane;
use nalgebra::Vector2;

/// Half the window of the structure tensor: 7x7 px, the core of the tracked patch.
const WINDOW: usize = 3;
/// Rows of the window.
const ROWS: usize = 2 * WINDOW + 1;
/// Pixels of the window.
const WINDOW_AREA: i32 = (ROWS * ROWS) as i32;
/// Score of a corner that is nothing but noise: white noise of one grey level has 0.5, and the best of a
/// cell's thousand windows about twice that.
const NOISE_SCORE: f32 = 1.2;
/// Weak corners are taken until this share of the wanted points is reached.
const POOR_SHARE: f32 = 0.6;
/// New points keep this distance from others, in cells.
const MIN_DISTANCE_CELLS: f32 = 0.4;
/// Pixels worked on at a time: two AVX2 registers of whole numbers.
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

/// Whole numbers of neighbouring pixels.
type Lanes = [i32; LANES];

/// Scores of a rectangle and of one pixel around it. All rows are as long as whole vectors, so that none is worked on pixel by
/// pixel.
#[derive(Clone, Debug)]
struct ScoreMap {
    /// The last three rows of the image.
    pixels: [Vec<u8>; 3],
    /// Products of the gradients, `gx gx`, `gx gy`, `gy gy`, of the rows of the window.
    products: [Vec<[Lanes; 3]>; ROWS],
    /// Sums of the products over the window's rows.
    columns: [Vec<i32>; 3],
    scores: Vec<f32>,
    /// Scores of a row.
    stride: usize,
    width: usize,
    height: usize,
}

impl ScoreMap {
    fn new(cell_px: usize) -> Self {
        let stride = (cell_px + 2).next_multiple_of(LANES);
        let span = span_of(stride);
        Self {
            pixels: std::array::from_fn(|_| vec![0; span + 2]),
            products: std::array::from_fn(|_| vec![[[0; LANES]; 3]; span / LANES]),
            columns: std::array::from_fn(|_| vec![0; span]),
            scores: vec![0.0; stride * (cell_px + 2)],
            stride,
            width: 0,
            height: 0,
        }
    }

    /// Scores of the rectangle at `from` of `size` (image pixels), and of its neighbours.
    fn compute(&mut self, plane: &Plane<'_>, from: [usize; 2], size: [usize; 2]) {
        (self.width, self.height) = (size[0] + 2, size[1] + 2);
        self.stride = self.width.next_multiple_of(LANES);
        // The first pixel that has a say, in coordinates of the plane.
        let [left, top] = from.map(|first| first + plane.origin - WINDOW - 2);
        self.columns.iter_mut().for_each(|sums| sums.fill(0));
        self.products.iter_mut().for_each(|row| row.fill([[0; LANES]; 3]));
        let seen = self.width + 2 * WINDOW + 2;
        for y in 0..self.height + 2 * WINDOW + 2 {
            self.pixels[y % 3][..seen]
                .copy_from_slice(&plane.pixels[(top + y) * plane.columns + left..][..seen]);
            if y >= 2 {
                self.replace_row(y - 2);
            }
            if y >= 2 * WINDOW + 2 {
                self.score_row(y - 2 * WINDOW - 2);
            }
        }
    }

    /// Puts the products of a row in the place of those of the row that leaves the window.
    fn replace_row(&mut self, y: usize) {
        let Self { pixels, products, columns: [xx, xy, yy], stride, .. } = self;
        let [above, middle, below] = [0, 1, 2].map(|dy| &pixels[(y + dy) % 3]);
        // All as long as each other, so that their bounds are checked once.
        let n = span_of(*stride) / LANES;
        let [right, left] = [2, 0].map(|first| &vectors(middle, first)[..n]);
        let [below, above] = [below, above].map(|row| &vectors(row, 1)[..n]);
        let old = &mut products[y % ROWS][..n];
        let [xx, xy, yy] = [xx, xy, yy].map(|sums| &mut sums.as_chunks_mut().0[..n]);
        for k in 0..n {
            let pixels = [&right[k], &left[k], &below[k], &above[k]];
            replace(pixels, &mut old[k], &mut xx[k], &mut xy[k], &mut yy[k]);
        }
    }

    fn score_row(&mut self, y: usize) {
        let row = &mut self.scores[y * self.stride..][..self.stride];
        let [xx, xy, yy] = self.columns.each_ref().map(|sums| &sums[..span_of(self.stride)]);
        for (k, scores) in row.as_chunks_mut().0.iter_mut().enumerate() {
            let at = k * LANES;
            score(&xx[at..], &xy[at..], &yy[at..], scores);
        }
    }

    /// The best local maximum above `floor` that `allowed` accepts (coordinates within the rectangle).
    fn best(&self, floor: f32, allowed: impl Fn(usize, usize) -> bool) -> Option<(usize, usize, f32)> {
        let mut best = None;
        let mut limit = floor;
        for y in 1..self.height - 1 {
            let row = &self.scores[y * self.stride..][..self.width];
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
        let centre = self.scores[y * self.stride + x];
        (y - 1..=y + 1).all(|v| {
            self.scores[v * self.stride + x - 1..=v * self.stride + x + 1].iter().all(|&s| s <= centre)
        })
    }
}

/// Pixels of a row of products from which a row of `stride` scores is summed, in whole vectors.
fn span_of(stride: usize) -> usize {
    (stride + 2 * WINDOW).next_multiple_of(LANES)
}

/// Pixels of a row from number `first` on.
fn vectors(row: &[u8], first: usize) -> &[[u8; LANES]] {
    row[first..].as_chunks().0
}

// Functions of their own, whose results lie in memory: where they are many values in registers, the compiler takes them one
// by one.

/// Puts the products of a vector of gradients, by the pixels around,, in the place of `old` ones, and
/// brings their sums up to date.
#[inline(never)]
fn replace(
    [right, left, below, above]: [&[u8; LANES]; 4],
    old: &mut [Lanes; 3],
    xx: &mut Lanes,
    xy: &mut Lanes,
    yy: &mut Lanes,
) {
    let gx: Lanes = std::array::from_fn(|i| i32::from(right[i]) - i32::from(left[i]));
    let gy: Lanes = std::array::from_fn(|i| i32::from(below[i]) - i32::from(above[i]));
    for i in 0..LANES {
        let new = gx[i] * gx[i];
        xx[i] += new - old[0][i];
        old[0][i] = new;
    }
    for i in 0..LANES {
        let new = gx[i] * gy[i];
        xy[i] += new - old[1][i];
        old[1][i] = new;
    }
    for i in 0..LANES {
        let new = gy[i] * gy[i];
        yy[i] += new - old[2][i];
        old[2][i] = new;
    }
}

/// Scores from column sums, as many as windows of a vector of scores cover: the lesser eigenvalue of the window's mean structure tensor.
#[inline(never)]
fn score(xx: &[i32], xy: &[i32], yy: &[i32], scores: &mut [f32; LANES]) {
    // The differences above are over two pixels, so their products are four times too large.
    const NORM: f32 = 1.0 / (4 * WINDOW_AREA) as f32;
    let [xx, xy, yy] = [xx, xy, yy].map(|columns| window_sums(columns).map(|sum| sum as f32 * NORM));
    for k in 0..LANES {
        let difference = xx[k] - yy[k];
        scores[k] = 0.5 * (xx[k] + yy[k] - (difference * difference + 4.0 * xy[k] * xy[k]).sqrt());
    }
}

/// Whether one of the scores exceeds `limit`: most rows have none, and all lanes at once tell.
#[inline(never)]
fn has_above(scores: &[f32], limit: f32) -> bool {
    scores.iter().fold(false, |found, score| found | (*score > limit))
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
