//! Total least squares of a line through weighted places.

use nalgebra::Vector2;

/// Moments of first and second order of places in the image, taken about the first of them.
#[derive(Clone, Copy, Debug, Default)]
pub struct LineMoments {
    origin: Vector2<f64>,
    weight: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
}

impl LineMoments {
    /// Adds a place.
    pub fn add(&mut self, px: &Vector2<f64>, weight: f64) {
        if self.weight == 0.0 {
            self.origin = *px;
        }
        let (x, y, w) = (px.x - self.origin.x, px.y - self.origin.y, weight);
        self.weight += w;
        self.x += w * x;
        self.y += w * y;
        self.xx += w * x * x;
        self.xy += w * x * y;
        self.yy += w * y * y;
    }

    /// Centroid and direction of the line of least squared distances: the eigenvector of the larger
    /// eigenvalue of the covariance. `None` while the places have no direction.
    pub fn line(&self) -> Option<(Vector2<f64>, Vector2<f64>)> {
        if self.weight <= 0.0 {
            return None;
        }
        let (mx, my) = (self.x / self.weight, self.y / self.weight);
        let xx = self.xx - self.weight * mx * mx;
        let xy = self.xy - self.weight * mx * my;
        let yy = self.yy - self.weight * my * my;
        // (xx - l) a + xy b = 0 with l = (xx + yy) / 2 + root: the better conditioned of its two rows.
        let half = 0.5 * (xx - yy);
        let root = (half * half + xy * xy).sqrt();
        let (a, b) = if half >= 0.0 { (half + root, xy) } else { (xy, root - half) };
        let norm = (a * a + b * b).sqrt();
        (norm > 1e-9).then(|| {
            let centroid = self.origin + Vector2::new(mx, my);
            (centroid, Vector2::new(a / norm, b / norm))
        })
    }
}
