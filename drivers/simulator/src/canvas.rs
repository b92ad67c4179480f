//! Painting of repeated patterns: smooth noise and anti-aliased shapes on a square that wraps around.

use crate::random::{Draws, Purpose};
use plumbline_config::Portable;

/// A square of values around `[0, 1]` that continues on its other side.
#[derive(Clone, Debug)]
pub(super) struct Canvas {
    pub(super) side: usize,
    pub(super) values: Vec<f32>,
    pub(super) draws: Draws,
}

impl Canvas {
    /// A plain square of `side` texels, a power of two; `stream` keeps patterns apart.
    pub(super) fn new(side: usize, level: f32, stream: u64) -> Self {
        // The patterns are the same in every scenario: only layouts depend on the scenario's seed.
        Self { side, values: vec![level; side * side], draws: Draws::new(0, Purpose::Texture, stream) }
    }

    /// Uniform draw.
    pub(super) fn range(&mut self, low: f32, high: f32) -> f32 {
        self.draws.range(f64::from(low), f64::from(high)) as f32
    }

    /// Adds smooth noise of `amplitude` with `cells` by `rows` lattice cells over the square.
    pub(super) fn add_noise(&mut self, cells: [usize; 2], amplitude: f32) {
        let lattice: Vec<f32> = (0..cells[0] * cells[1]).map(|_| self.range(-amplitude, amplitude)).collect();
        let side = self.side;
        let columns: Vec<(usize, usize, f32)> = (0..side).map(|x| lattice_at(x, side, cells[0])).collect();
        // Of a row of the lattice, all that its rows of texels have in common.
        let across = |row: usize, into: &mut [f32]| {
            let row = &lattice[row * cells[0]..][..cells[0]];
            for (value, &(x0, x1, fx)) in into.iter_mut().zip(&columns) {
                *value = row[x0] + (row[x1] - row[x0]) * fx;
            }
        };
        let (mut upper, mut lower, mut between) = (vec![0.0; side], vec![0.0; side], None);
        for (y, values) in self.values.chunks_exact_mut(side).enumerate() {
            let (y0, y1, fy) = lattice_at(y, side, cells[1]);
            if between != Some((y0, y1)) {
                std::mem::swap(&mut upper, &mut lower);
                if between.is_none_or(|(_, before)| before != y0) {
                    across(y0, &mut upper);
                }
                across(y1, &mut lower);
                between = Some((y0, y1));
            }
            for ((value, a), b) in values.iter_mut().zip(&upper).zip(&lower) {
                *value += a + (b - a) * fy;
            }
        }
    }

    /// Noise in octaves from `cells` lattice cells to single texels, each of `decay` times the last.
    pub(super) fn add_octaves(&mut self, cells: usize, amplitude: f32, decay: f32) {
        let (mut cells, mut amplitude) = (cells, amplitude);
        while cells <= self.side && amplitude > 1e-3 {
            self.add_noise([cells, cells], amplitude);
            cells *= 2;
            amplitude *= decay;
        }
    }

    /// Paints the shape whose signed distance (texels, negative inside) from its centre is `distance`; its edge is one texel wide.
    /// The square that is looked at reaches `reach` texels from the centre, and of it what is within `extent`, which holds the shape.
    pub(super) fn paint(
        &mut self,
        centre: [f32; 2],
        (reach, extent): (f32, [f32; 2]),
        level: f32,
        distance: impl Fn(f32, f32) -> f32,
    ) {
        let side = self.side as i32;
        let bounds = |c: f32, reach: f32| ((c - reach - 1.0).floor() as i32, (c + reach + 1.0).ceil() as i32);
        let [(x0, x1), (y0, y1)] = [0, 1].map(|k| {
            let ((first, end), (low, high)) = (bounds(centre[k], reach), bounds(centre[k], extent[k]));
            (first.max(low), end.min(first + side).min(high))
        });
        for y in y0..y1 {
            let row = (y.rem_euclid(side) * side) as usize;
            let row = &mut self.values[row..row + side as usize];
            // In pieces that end where the square wraps around.
            let mut x = x0;
            while x < x1 {
                let begin = x.rem_euclid(side);
                let count = (x1 - x).min(side - begin);
                for (value, x) in row[begin as usize..][..count as usize].iter_mut().zip(x..) {
                    let d = distance(x as f32 + 0.5 - centre[0], y as f32 + 0.5 - centre[1]);
                    let cover = (0.5 - d).clamp(0.0, 1.0);
                    let painted = *value + (level - *value) * cover;
                    *value = if cover > 0.0 { painted } else { *value };
                }
                x += count;
            }
        }
    }

    /// Paints a box with half extents `half`, turned by `angle`.
    pub(super) fn paint_box(&mut self, centre: [f32; 2], half: [f32; 2], angle: f32, level: f32) {
        let (sin, cos) = libm::sincosf(angle);
        let reach = (half[0] * half[0] + half[1] * half[1]).sqrt();
        let extent = [[cos, sin], [sin, cos]].map(|[u, v]| u.abs() * half[0] + v.abs() * half[1]);
        self.paint(centre, (reach, extent), level, |x, y| {
            let (u, v) = (cos * x + sin * y, cos * y - sin * x);
            (u.abs() - half[0]).at_least(v.abs() - half[1])
        });
    }

    /// Paints a disc.
    pub(super) fn paint_disc(&mut self, centre: [f32; 2], radius: f32, level: f32) {
        self.paint(centre, (radius, [radius; 2]), level, |x, y| (x * x + y * y).sqrt() - radius);
    }

    /// Paints a regular triangle of circumscribed radius `radius`, turned by `angle`.
    pub(super) fn paint_triangle(&mut self, centre: [f32; 2], radius: f32, angle: f32, level: f32) {
        let sides = [0.0, 1.0, 2.0].map(|k| libm::sincosf(angle + k * std::f32::consts::TAU / 3.0));
        self.paint(centre, (radius, [radius; 2]), level, |x, y| {
            sides.iter().map(|(s, c)| c * x + s * y).fold(f32::MIN, |most, x: f32| x.at_least(most))
                - 0.5 * radius
        });
    }

    /// A random place.
    pub(super) fn place(&mut self) -> [f32; 2] {
        let side = self.side as f32;
        [self.range(0.0, side), self.range(0.0, side)]
    }

    /// Random shapes one over another ("dead leaves", Matheron 1968): detail at all scales with the
    /// statistics of natural images. Radii follow a power law between the bounds.
    pub(super) fn paint_leaves(&mut self, count: usize, radius: [f32; 2], levels: [f32; 2]) {
        for _ in 0..count {
            let centre = self.place();
            // Density of radii falling with their third power: equal cover for each octave.
            let [low, high] = radius.map(|r| 1.0 / (r * r));
            let size = 1.0 / self.range(high, low).sqrt();
            let (level, angle) = (self.range(levels[0], levels[1]), self.range(0.0, 6.3));
            match self.draws.index(4) {
                0 => self.paint_disc(centre, size, level),
                1 => self.paint_triangle(centre, 1.3 * size, angle, level),
                2 => self.paint_box(centre, [size, size * 0.7], angle, level),
                _ => {
                    let long = self.range(0.8, 2.0);
                    self.paint_box(centre, [size * long, size * 0.5], 0.0, level);
                }
            }
        }
    }

    /// Small specks.
    pub(super) fn paint_specks(&mut self, count: usize, radius: [f32; 2], levels: [f32; 2]) {
        for _ in 0..count {
            let centre = self.place();
            let (size, level) = (self.range(radius[0], radius[1]), self.range(levels[0], levels[1]));
            self.paint_disc(centre, size, level);
        }
    }

    /// Rows of text-like marks within the box at `corner` of `extent` texels.
    pub(super) fn paint_text(&mut self, corner: [f32; 2], extent: [f32; 2], height: f32, level: f32) {
        let mut y = corner[1] + height;
        while y + height < corner[1] + extent[1] {
            let mut x = corner[0] + height;
            while x + height < corner[0] + extent[0] {
                let glyph = [x + 0.3 * height, y];
                match self.draws.index(6) {
                    0 => {}
                    1 => self.paint_disc(glyph, 0.32 * height, level),
                    2 => self.paint_box(glyph, [0.09 * height, 0.45 * height], 0.0, level),
                    3 => {
                        self.paint_box(glyph, [0.28 * height, 0.09 * height], 0.0, level);
                        self.paint_box(glyph, [0.09 * height, 0.45 * height], 0.0, level);
                    }
                    4 => {
                        self.paint_box(glyph, [0.3 * height, 0.45 * height], 0.0, level);
                        self.paint_box(glyph, [0.13 * height, 0.25 * height], 0.0, 1.0 - level);
                    }
                    _ => self.paint_box(glyph, [0.08 * height, 0.45 * height], 0.5, level),
                }
                x += 0.8 * height;
            }
            y += 1.7 * height;
        }
    }
}

/// Lattice neighbours of texel `at` and the smooth weight of the second.
fn lattice_at(at: usize, side: usize, cells: usize) -> (usize, usize, f32) {
    let position = (at as f32 + 0.5) * cells as f32 / side as f32;
    let (low, part) = (position as usize, position.fract());
    (low % cells, (low + 1) % cells, part * part * (3.0 - 2.0 * part))
}
