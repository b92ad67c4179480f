//! The materials of the simulated world, as repeated patterns.
//!
//! Patterns are values of albedo. Textured ones carry detail at every scale from two texels to the whole
//! square, so that corners are found at any distance; [`Material::Paint`] and [`Material::Panels`] hold
//! next to none, for the scene in which points are scarce.

use super::canvas::Canvas;
use super::texture::Texture;
use std::sync::OnceLock;

/// Side of a detailed pattern, texels.
const SIDE: usize = 1024;
/// Side of a plain pattern, texels.
const PLAIN_SIDE: usize = 512;
/// Side of a cell of [`Material::Grid`], texels.
const GRID_CELL: usize = 64;
/// Side of that cell at the usual size of the pattern, m.
pub(super) const GRID_CELL_M: f64 = GRID_CELL as f64 / 400.0;

/// Materials of surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Material {
    Bricks,
    Plaster,
    Posters,
    Wood,
    Tiles,
    Concrete,
    Metal,
    Stones,
    Labels,
    Paint,
    Panels,
    Grid,
}

impl Material {
    /// All of them, in order, with what paints them.
    const ALL: [(Self, fn() -> Canvas); 12] = [
        (Self::Bricks, bricks),
        (Self::Plaster, plaster),
        (Self::Posters, posters),
        (Self::Wood, wood),
        (Self::Tiles, tiles),
        (Self::Concrete, concrete),
        (Self::Metal, metal),
        (Self::Stones, stones),
        (Self::Labels, labels),
        (Self::Paint, paint),
        (Self::Panels, panels),
        (Self::Grid, grid),
    ];

    /// Texels per metre at the usual size of the pattern.
    pub(super) const fn texels_per_m(self) -> f64 {
        match self {
            Self::Panels => 256.0,
            Self::Paint => 200.0,
            Self::Wood | Self::Labels => 500.0,
            _ => 400.0,
        }
    }

    /// The pattern, painted when it is first asked for: it is the same in every scenario. Painting takes a tenth of
    /// a second.
    #[inline]
    pub(super) fn texture(self) -> &'static Texture {
        const COUNT: usize = Material::ALL.len();
        static PAINTED: [OnceLock<Texture>; COUNT] = [const { OnceLock::new() }; COUNT];
        PAINTED[self as usize].get_or_init(|| {
            let canvas = Self::ALL[self as usize].1();
            Texture::new(canvas.side, &canvas.values)
        })
    }
}

fn bricks() -> Canvas {
    let mut c = Canvas::new(SIDE, 0.72, 1);
    c.add_octaves(64, 0.06, 0.8);
    let (rows, columns) = (32, 10);
    let (height, width) = (SIDE as f32 / rows as f32, SIDE as f32 / columns as f32);
    for row in 0..rows {
        for column in 0..columns {
            let shift = if row % 2 == 0 { 0.0 } else { 0.5 };
            let centre = [(column as f32 + shift) * width, (row as f32 + 0.5) * height];
            let level = c.range(0.18, 0.62);
            let (u, v) = (c.range(2.0, 4.0), c.range(2.0, 4.0));
            c.paint_box(centre, [0.5 * width - u, 0.5 * height - v], 0.0, level);
        }
    }
    c.paint_specks(9000, [1.0, 3.2], [0.05, 0.75]);
    c.add_octaves(16, 0.05, 0.9);
    c
}

fn plaster() -> Canvas {
    let mut c = Canvas::new(SIDE, 0.62, 2);
    c.add_octaves(4, 0.12, 0.85);
    c.paint_specks(9000, [0.9, 3.0], [0.25, 0.95]);
    c.paint_specks(500, [4.0, 9.0], [0.3, 0.9]);
    c.add_octaves(128, 0.06, 0.9);
    c
}

fn posters() -> Canvas {
    let mut c = Canvas::new(SIDE, 0.5, 3);
    c.paint_leaves(14_000, [3.0, 180.0], [0.04, 0.98]);
    c.add_octaves(32, 0.03, 0.9);
    c
}

fn wood() -> Canvas {
    let mut c = Canvas::new(SIDE, 0.5, 4);
    let (planks, long) = (16, 2);
    let width = SIDE as f32 / planks as f32;
    let length = SIDE as f32 / long as f32;
    for plank in 0..planks {
        let shift = c.range(0.0, length);
        for piece in 0..long {
            let centre = [piece as f32 * length + shift, (plank as f32 + 0.5) * width];
            let level = c.range(0.3, 0.68);
            c.paint_box(centre, [0.5 * length, 0.5 * width], 0.0, 0.08);
            c.paint_box(centre, [0.5 * length - 1.5, 0.5 * width - 1.5], 0.0, level);
        }
    }
    c.add_noise([8, 128], 0.09);
    c.add_noise([16, 256], 0.09);
    c.add_noise([64, 512], 0.08);
    c.paint_specks(2600, [1.2, 5.0], [0.06, 0.3]);
    c.paint_specks(1500, [1.0, 2.5], [0.6, 0.9]);
    c
}

fn tiles() -> Canvas {
    let mut c = Canvas::new(SIDE, 0.22, 5);
    let count = 8;
    let size = SIDE as f32 / count as f32;
    for i in 0..count * count {
        let (x, y) = (i % count, i / count);
        let level = if (x + y) % 2 == 0 { c.range(0.3, 0.45) } else { c.range(0.55, 0.8) };
        let centre = [(x as f32 + 0.5) * size, (y as f32 + 0.5) * size];
        c.paint_box(centre, [0.5 * size - 2.5; 2], 0.0, level);
    }
    c.paint_specks(16_000, [0.9, 3.0], [0.1, 0.95]);
    c.paint_specks(900, [3.0, 8.0], [0.15, 0.9]);
    c.add_octaves(32, 0.04, 0.9);
    c
}

fn concrete() -> Canvas {
    let mut c = Canvas::new(SIDE, 0.48, 6);
    c.add_octaves(4, 0.14, 0.8);
    c.paint_specks(14_000, [0.9, 2.8], [0.1, 0.85]);
    c.paint_leaves(500, [4.0, 40.0], [0.25, 0.75]);
    for _ in 0..60 {
        let (centre, angle, long) = (c.place(), c.range(0.0, 3.2), c.range(20.0, 140.0));
        c.paint_box(centre, [long, 1.0], angle, 0.14);
    }
    c.add_octaves(64, 0.08, 0.9);
    c
}

fn metal() -> Canvas {
    let mut c = Canvas::new(SIDE, 0.4, 7);
    let count = 6;
    let size = SIDE as f32 / count as f32;
    for i in 0..count * count {
        let centre = [(i % count) as f32 * size + 0.5 * size, (i / count) as f32 * size + 0.5 * size];
        let level = c.range(0.25, 0.7);
        c.paint_box(centre, [0.5 * size - 2.0; 2], 0.0, level);
        for corner in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
            let at = [0, 1].map(|k| centre[k] + corner[k] * (0.5 * size - 12.0));
            c.paint_disc(at, 4.5, 0.1);
            c.paint_disc([at[0] - 1.0, at[1] - 1.0], 2.0, 0.9);
        }
        match c.draws.index(4) {
            0 => {
                for k in 0..7 {
                    let y = centre[1] + (k as f32 - 3.0) * 12.0;
                    c.paint_box([centre[0], y], [45.0, 3.0], 0.0, 0.06);
                }
            }
            1 => c.paint_text([centre[0] - 55.0, centre[1] - 50.0], [110.0, 100.0], 14.0, 0.05),
            _ => {}
        }
    }
    c.paint_leaves(700, [2.5, 14.0], [0.08, 0.85]);
    c.add_noise([512, 8], 0.05);
    c.add_octaves(64, 0.04, 0.9);
    c
}

fn stones() -> Canvas {
    let mut c = Canvas::new(SIDE, 0.15, 8);
    for _ in 0..5200 {
        let (centre, level, angle) = (c.place(), c.range(0.15, 0.95), c.range(0.0, 3.2));
        let (a, b) = (c.range(5.0, 22.0), c.range(4.0, 14.0));
        c.paint_box(centre, [a + 1.5, b + 1.5], angle, 0.1);
        c.paint_box(centre, [a, b], angle, level);
    }
    c.paint_specks(6000, [0.9, 2.2], [0.1, 0.95]);
    c
}

fn labels() -> Canvas {
    let mut c = Canvas::new(SIDE, 0.56, 9);
    c.add_octaves(8, 0.05, 0.8);
    let count = 4;
    let size = SIDE as f32 / count as f32;
    for i in 0..count * count {
        let corner = [(i % count) as f32 * size, (i / count) as f32 * size];
        let centre = corner.map(|v| v + 0.5 * size);
        c.paint_box(centre, [0.5 * size - 1.5; 2], 0.0, 0.2);
        let level = c.range(0.35, 0.75);
        c.paint_box(centre, [0.5 * size - 5.0; 2], 0.0, level);
        let paper = c.range(0.8, 0.97);
        let (w, h) = (c.range(70.0, 110.0), c.range(60.0, 105.0));
        c.paint_box(centre, [w, h], 0.0, paper);
        let letter = c.range(10.0, 22.0);
        c.paint_text([centre[0] - w, centre[1] - h], [2.0 * w, 1.2 * h], letter, 0.08);
        c.paint_box([centre[0], centre[1] + 0.7 * h], [0.8 * w, 0.18 * h], 0.0, 0.1);
        for k in 0..9 {
            let (x, thick) = (centre[0] + (k as f32 - 4.0) * 0.17 * w, c.range(1.5, 4.0));
            c.paint_box([x, centre[1] + 0.7 * h], [thick, 0.14 * h], 0.0, paper);
        }
    }
    c.paint_specks(3000, [0.9, 2.6], [0.1, 0.9]);
    c
}

fn paint() -> Canvas {
    let mut c = Canvas::new(PLAIN_SIDE, 0.7, 10);
    c.add_octaves(2, 0.018, 0.6);
    c
}

fn panels() -> Canvas {
    let mut c = Canvas::new(PLAIN_SIDE, 0.42, 11);
    let count = 4;
    let size = PLAIN_SIDE as f32 / count as f32;
    for i in 0..count * count {
        let centre = [i % count, i / count].map(|k| (k as f32 + 0.5) * size);
        let level = c.range(0.66, 0.72);
        c.paint_box(centre, [0.5 * size - 1.3; 2], 0.0, level);
    }
    c.add_octaves(2, 0.012, 0.6);
    c
}

/// Cells that are all alike, [`GRID_CELL_M`] apart: no place tells itself from the next.
fn grid() -> Canvas {
    let mut c = Canvas::new(PLAIN_SIDE, 0.72, 12);
    let count = PLAIN_SIDE / GRID_CELL;
    let size = GRID_CELL as f32;
    for i in 0..count * count {
        let corner = [i % count, i / count].map(|k| k as f32 * size);
        let at = |x: f32, y: f32| [corner[0] + x * size, corner[1] + y * size];
        c.paint_box(at(0.36, 0.4), [0.26 * size, 0.3 * size], 0.0, 0.16);
        c.paint_box(at(0.8, 0.78), [0.12 * size, 0.14 * size], 0.0, 0.4);
    }
    c
}
