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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_in_every_direction() {
        for k in 0..36 {
            let angle = f64::from(k) * 10.0_f64.to_radians();
            let (s, c) = angle.sin_cos();
            let mut moments = LineMoments::default();
            for i in -20..=20 {
                let along = f64::from(i);
                // Off the line by turns to both sides: the fit lies between.
                let across = if i % 2 == 0 { 0.5 } else { -0.5 } * f64::from(i32::from(i != 0));
                let px = Vector2::new(300.0 + along * c - across * s, 200.0 + along * s + across * c);
                moments.add(&px, 1.0);
            }
            let (centroid, axis) = moments.line().expect("has a direction");
            assert!((centroid - Vector2::new(300.0, 200.0)).norm() < 0.1);
            let sine = axis.perp(&Vector2::new(c, s)).abs();
            assert!(sine < 0.01, "{k}: {sine}");
        }
    }
}
