//! The light that falls on a surface, as a coarse grid.

use plumbline_config::Portable;

/// Brightness (grey levels of a white surface) on a grid over a surface.
#[derive(Clone, Debug, Default)]
pub(super) struct LightMap {
    /// At least two.
    pub(super) columns: usize,
    /// At least two.
    pub(super) rows: usize,
    /// By rows.
    pub(super) values: Vec<f32>,
}

impl LightMap {
    /// Creates a map of one brightness.
    pub(super) fn uniform(value: f32) -> Self {
        Self { columns: 2, rows: 2, values: vec![value; 4] }
    }
}

/// Light map prepared for lookup.
#[derive(Clone, Debug)]
pub(super) struct LightTable {
    /// Cells in a row and in a column.
    size: [f32; 2],
    /// By rows: brightness at a cell's first corner and how much more it is at the second, and so at its other end.
    cells: Vec<[f32; 4]>,
}

/// A float of this size holds whole numbers.
const ONES: f32 = 8_388_608.0;

impl LightTable {
    /// Creates the table of a map.
    pub(super) fn new(map: &LightMap) -> Self {
        let (columns, rows) = (map.columns - 1, map.rows - 1);
        let corner = |row: usize, column: usize| map.values[row * map.columns + column];
        let half = |row, column| [corner(row, column), corner(row, column + 1) - corner(row, column)];
        let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
        let cells = places.map(|(row, column)| {
            let ([a, rise_a], [b, rise_b]) = (half(row, column), half(row + 1, column));
            [a, rise_a, b, rise_b]
        });
        Self { size: [columns as f32, rows as f32], cells: cells.collect() }
    }

    /// Brightness at places `(s, t)`, all within 0 to 1.
    #[inline]
    pub(super) fn at<const N: usize>(&self, s: &[f32; N], t: &[f32; N]) -> [f32; N] {
        let (mut fx, mut fy, mut cells) = ([0.0; N], [0.0; N], [0; N]);
        for i in 0..N {
            let (x, y) = (s[i].clamp(0.0, 1.0) * self.size[0], t[i].clamp(0.0, 1.0) * self.size[1]);
            let column = x.floor().at_most(self.size[0] - 1.0);
            let row = y.floor().at_most(self.size[1] - 1.0);
            (fx[i], fy[i]) = (x - column, y - row);
            // The last bits of a number that is added to one whose last bit is worth one are those of the whole number.
            cells[i] = (row * self.size[0] + column + ONES).to_bits() ^ ONES.to_bits();
        }
        let mut corners = [[0.0; N]; 4];
        for i in 0..N {
            let cell = self.cells[cells[i] as usize];
            for k in 0..4 {
                corners[k][i] = cell[k];
            }
        }
        let [a, rise_a, b, rise_b] = corners;
        std::array::from_fn(|i| {
            let (a, b) = (a[i] + rise_a[i] * fx[i], b[i] + rise_b[i] * fx[i]);
            a + (b - a) * fy[i]
        })
    }
}
