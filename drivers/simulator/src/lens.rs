//! A camera as a table: the bearing of every pixel, and bounds of bearings for tiles of pixels.
//!
//! A bearing is `(x, y)` with the ray `(x, y, 1)` in the camera frame: distortion is undone once, so that
//! any camera model is rendered at the same cost and as exactly as it can be inverted. A pixel without
//! inverse has the bearing NaN, which no surface covers.

use nalgebra::{Isometry3, Matrix3, Rotation3, Vector2, Vector3};
use plumbline_config::{CameraModel, Portable};

/// Side of a tile, px.
pub(super) const TILE: usize = 16;
/// Side of a block, tiles.
pub(super) const BLOCK: usize = 6;

/// Bounds of the bearings of some pixels, half a pixel beyond their centres included.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub(super) x: [f32; 2],
    pub(super) y: [f32; 2],
}

impl Span {
    const EMPTY: Self = Self { x: [f32::MAX, f32::MIN], y: [f32::MAX, f32::MIN] };

    fn joined(self, other: &Self) -> Self {
        Self {
            x: [self.x[0].at_most(other.x[0]), self.x[1].at_least(other.x[1])],
            y: [self.y[0].at_most(other.y[0]), self.y[1].at_least(other.y[1])],
        }
    }

    fn grown(&self, margin: f32) -> Self {
        let grow = |r: [f32; 2]| [r[0] - margin, r[1] + margin];
        Self { x: grow(self.x), y: grow(self.y) }
    }

    /// Least and greatest value of `a x + b y + c` over the span.
    #[inline]
    pub(super) fn range(&self, f: &[f32; 3]) -> [f32; 2] {
        let (ax, bx) = (f[0] * self.x[0], f[0] * self.x[1]);
        let (ay, by) = (f[1] * self.y[0], f[1] * self.y[1]);
        [f[2] + ax.at_most(bx) + ay.at_most(by), f[2] + ax.at_least(bx) + ay.at_least(by)]
    }
}

/// One camera of the rig, tabulated.
#[derive(Clone, Debug)]
pub(super) struct Lens {
    pub(super) model: CameraModel,
    /// Takes coordinates from the camera to the body.
    pub(super) pose_b_c: Isometry3<f64>,
    /// Bearings, x and y, of each row of a tile, tile after tile; NaN beyond the image.
    bearings: Vec<[[f32; TILE]; 2]>,
    /// Tiles in a row of tiles.
    pub(super) columns: usize,
    /// Rows of tiles.
    pub(super) rows: usize,
    /// Bounds per tile, row-major.
    pub(super) tiles: Vec<Span>,
    /// Step of the bearing per pixel right and down, `[x_right, y_right, x_down, y_down]`, per tile.
    pub(super) steps: Vec<[f32; 4]>,
    /// Bounds of the whole image.
    pub(super) all: Span,
}

impl Lens {
    /// Tabulates `model`.
    pub(super) fn new(model: CameraModel, pose_b_c: Isometry3<f64>) -> Self {
        let (width, height) = (model.width_px, model.height_px);
        let bearing =
            |u: f64, v: f64| model.unproject(&Vector2::new(u, v)).unwrap_or(Vector2::new(f64::NAN, f64::NAN));
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let mut bearings = vec![[[f32::NAN; TILE]; 2]; columns * rows * TILE];
        for v in 0..height {
            for u in 0..width {
                let b = bearing(u as f64, v as f64);
                let [x, y] = &mut bearings[(v / TILE * columns + u / TILE) * TILE + v % TILE];
                (x[u % TILE], y[u % TILE]) = (b.x as f32, b.y as f32);
            }
        }
        let (mut tiles, mut steps) = (Vec::new(), Vec::new());
        for tile in 0..columns * rows {
            let (u0, v0) = (tile % columns * TILE, tile / columns * TILE);
            let (u1, v1) = ((u0 + TILE).min(width), (v0 + TILE).min(height));
            tiles.push(border(&bearing, [u0, u1], [v0, v1]));
            let (u, v) = (0.5 * (u0 + u1 - 1) as f64, 0.5 * (v0 + v1 - 1) as f64);
            let right = bearing(u + 0.5, v) - bearing(u - 0.5, v);
            let down = bearing(u, v + 0.5) - bearing(u, v - 0.5);
            steps.push([right.x, right.y, down.x, down.y].map(|s| s as f32));
        }
        let all = tiles.iter().fold(Span::EMPTY, |a, b| a.joined(b));
        Self { model, pose_b_c, bearings, columns, rows, tiles, steps, all }
    }

    /// Bearings, x and y, of the rows of a tile.
    #[inline]
    pub(super) fn bearings(&self, tile: usize) -> &[[[f32; TILE]; 2]] {
        &self.bearings[tile * TILE..][..TILE]
    }

    /// Takes over the bearings of `lens`, each turned with its row: rows of a tile belong to other times than the tile, and the
    /// camera turns by `turns` (a rotation vector, rad a row, in its own axes) in each row of tiles.
    pub(super) fn roll(&mut self, lens: &Self, turns: impl Iterator<Item = Vector3<f64>>) {
        let farthest = [lens.all.x, lens.all.y].map(|r| r[0].abs().at_least(r[1].abs()));
        let reach = 1.0 + farthest[0] * farthest[0] + farthest[1] * farthest[1];
        self.all = Span::EMPTY;
        for (row, turn) in turns.take(lens.rows).enumerate() {
            let margin = turn.norm() as f32 * 0.5 * TILE as f32 * reach;
            let rotations: [Matrix3<f32>; TILE] = std::array::from_fn(|k| {
                let turn = turn * (k as f64 - 0.5 * (TILE - 1) as f64);
                Rotation3::from_scaled_axis(turn).into_inner().map(|x| x as f32)
            });
            for tile in row * lens.columns..(row + 1) * lens.columns {
                self.tiles[tile] = lens.tiles[tile].grown(margin);
                self.all = self.all.joined(&self.tiles[tile]);
                let rows = self.bearings[tile * TILE..][..TILE].iter_mut().zip(lens.bearings(tile));
                for (([to_x, to_y], [x, y]), r) in rows.zip(&rotations) {
                    for i in 0..TILE {
                        let z = 1.0 / (r.m31 * x[i] + r.m32 * y[i] + r.m33);
                        to_x[i] = (r.m11 * x[i] + r.m12 * y[i] + r.m13) * z;
                        to_y[i] = (r.m21 * x[i] + r.m22 * y[i] + r.m23) * z;
                    }
                }
            }
        }
    }

    /// Bounds of a block of tiles.
    pub(super) fn block(&self, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> Span {
        let mut span = Span::EMPTY;
        for row in rows {
            for tile in &self.tiles[row * self.columns + columns.start..row * self.columns + columns.end] {
                span = span.joined(tile);
            }
        }
        span
    }

    /// Ray of a pixel in the camera frame, `z = 1`; `None` where the camera model has no inverse.
    pub(super) fn ray(&self, px: &Vector2<f64>) -> Option<Vector3<f64>> {
        self.model.unproject(px).map(|b| Vector3::new(b.x, b.y, 1.0))
    }
}

/// Bounds over the outline of a tile: bearings rise along rows and columns, so extremes are there.
fn border(bearing: &impl Fn(f64, f64) -> Vector2<f64>, u: [usize; 2], v: [usize; 2]) -> Span {
    let (u0, u1) = (u[0] as f64 - 0.5, u[1] as f64 - 0.5);
    let (v0, v1) = (v[0] as f64 - 0.5, v[1] as f64 - 0.5);
    let mut span = Span::EMPTY;
    let mut take = |b: Vector2<f64>| {
        if b.x.is_finite() && b.y.is_finite() {
            let (x, y) = (b.x as f32, b.y as f32);
            span = span.joined(&Span { x: [x, x], y: [y, y] });
        }
    };
    for i in 0..=8 {
        let part = f64::from(i) / 8.0;
        let (u, v) = (u0 + (u1 - u0) * part, v0 + (v1 - v0) * part);
        [bearing(u, v0), bearing(u, v1), bearing(u0, v), bearing(u1, v)].into_iter().for_each(&mut take);
    }
    // The outline is sampled: an extreme between samples is missed by less than this share.
    let grow = |r: [f32; 2]| {
        let extra = 0.01 * (r[1] - r[0]).at_least(0.0);
        [r[0] - extra, r[1] + extra]
    };
    Span { x: grow(span.x), y: grow(span.y) }
}
