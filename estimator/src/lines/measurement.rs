//! A segment without the distortion of the lens: what the window measures.

use super::fit::LineMoments;
use super::segment::Segment;
use crate::points::rig::RigCamera;
use nalgebra::Vector2;
use plumbline_config::Portable;

/// A straight edge in ideal normalized coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageLine {
    /// Start and end, on the fitted line.
    pub ends_xy: [Vector2<f64>; 2],
    /// Unit vector from start to end.
    pub direction: Vector2<f64>,
    /// Pixels per unit of normalized coordinates across the line, at either end.
    pub px_per_unit: [f64; 2],
}

impl ImageLine {
    /// Fits the line through a segment's nodes, undistorted one by one: the image of a straight edge is
    /// bent by the lens, by more than the noise at the rim, and by the turns of the camera between its rows. `None` outside the
    /// model's range.
    pub fn of(segment: &Segment, camera: &RigCamera) -> Option<Self> {
        let bearing = |px: Vector2<f64>| camera.unproject(&px);
        let mut moments = LineMoments::default();
        for node in segment.nodes.iter().filter(|n| n.weight > 0.0) {
            moments.add(&bearing(node.px.cast())?, f64::from(node.weight));
        }
        let (point, direction) = moments.line()?;
        let end = |px: &Vector2<f32>| -> Option<Vector2<f64>> {
            let xy = bearing(px.cast())?;
            Some(point + direction * direction.dot(&(xy - point)))
        };
        let ends_xy = [end(&segment.start)?, end(&segment.end)?];
        let normal = Vector2::new(-direction.y, direction.x);
        let scale = |xy: &Vector2<f64>| -> Option<f64> {
            let px_by_xy = camera.model.project_normalized(xy).1;
            Some(1.0 / (px_by_xy.try_inverse()?.tr_mul(&normal)).norm())
        };
        Some(Self::between(ends_xy, [scale(&ends_xy[0])?, scale(&ends_xy[1])?]))
    }

    /// The edge between two ends.
    pub fn between(ends_xy: [Vector2<f64>; 2], px_per_unit: [f64; 2]) -> Self {
        let d = ends_xy[1] - ends_xy[0];
        Self { ends_xy, direction: d / d.norm().at_least(f64::MIN_POSITIVE), px_per_unit }
    }
}

#[cfg(test)]
mod tests {
    use super::super::segment::Place;
    use super::*;
    use plumbline_config::Config;

    #[test]
    fn a_line_bent_by_the_lens_is_straight_again() {
        let model = Config::preset("euroc").expect("is good").camera[0].model();
        // A straight line near the rim, as the lens shows it.
        let (a, b) = (Vector2::new(-0.6, -0.42), Vector2::new(0.5, -0.38));
        let places: Vec<Place> = (0..=200)
            .map(|i| {
                let px = model.project_normalized(&(a + (b - a) * (f64::from(i) / 200.0))).0;
                Place { px: px.cast(), weight: 1.0, strength: 10.0 }
            })
            .collect();
        let segment = Segment::through(&places, &Vector2::new(1.0, 0.0), 0.0).expect("has a direction");
        let bent = places.iter().map(|p| segment.direction().perp(&(p.px - segment.start)).abs());
        assert!(bent.fold(0.0, f32::max) > 3.0, "the lens bends it by pixels");
        let line = ImageLine::of(&segment, &RigCamera::new(model)).expect("is in range");
        for end in line.ends_xy {
            let off = (b - a).normalize().perp(&(end - a)).abs() * line.px_per_unit[0];
            assert!(off < 0.1, "{off} px off");
        }
        assert!((line.px_per_unit[0] - 400.0).abs() < 80.0);
    }
}
