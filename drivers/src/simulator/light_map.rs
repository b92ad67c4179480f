//! The light that falls on a surface, as a coarse grid.

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
    /// The same brightness everywhere.
    pub(super) fn uniform(value: f32) -> Self {
        Self { columns: 2, rows: 2, values: vec![value; 4] }
    }

    /// Brightness at `(s, t)`, both within 0 to 1.
    #[inline]
    pub(super) fn at(&self, s: f32, t: f32) -> f32 {
        let x = s.clamp(0.0, 1.0) * (self.columns - 1) as f32;
        let y = t.clamp(0.0, 1.0) * (self.rows - 1) as f32;
        // By way of a signed word, which one instruction makes of a float.
        let (column, row) = (x as i32 as usize, y as i32 as usize);
        let (column, row) = (column.min(self.columns - 2), row.min(self.rows - 2));
        let (fx, fy) = (x - column as f32, y - row as f32);
        let first = row * self.columns + column;
        let upper = &self.values[first..first + 2];
        let lower = &self.values[first + self.columns..first + self.columns + 2];
        let a = upper[0] + (upper[1] - upper[0]) * fx;
        let b = lower[0] + (lower[1] - lower[0]) * fx;
        a + (b - a) * fy
    }
}
