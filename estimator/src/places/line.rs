//! Lines of a keyframe: for those who look at the map, or plan a path in it. Nothing is located by them.

use nalgebra::{Isometry3, Point3, Vector3};

/// A line as its keyframe knows it, cut off where it saw it end.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MapLine {
    /// Both ends in the left camera, m.
    pub ends_c: [Vector3<f32>; 2],
}

impl MapLine {
    /// A line with these ends in another frame, of which the left camera has the pose `pose_c`.
    #[must_use]
    pub fn new(pose_c: &Isometry3<f64>, ends: &[Vector3<f64>; 2]) -> Self {
        let inverse = pose_c.inverse();
        Self { ends_c: ends.map(|end| (inverse * Point3::from(end)).coords.cast()) }
    }

    /// Both ends in the frame in which the left camera has the pose `pose_c`, m.
    pub fn ends(&self, pose_c: &Isometry3<f64>) -> [Vector3<f64>; 2] {
        self.ends_c.map(|end| (pose_c * Point3::from(end.cast())).coords)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_moves_with_its_keyframe() {
        let pose_o_c = Isometry3::new(Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.2, 0.1, -0.4));
        let ends_o = [Vector3::new(3.0, 1.0, 2.0), Vector3::new(3.0, 1.5, 2.0)];
        let line = MapLine::new(&pose_o_c, &ends_o);
        for (end, again) in ends_o.iter().zip(line.ends(&pose_o_c)) {
            assert!((end - again).norm() < 1e-6, "{end} {again}");
        }
        let moved = Isometry3::translation(0.0, 0.0, 1.0) * pose_o_c;
        assert!((line.ends(&moved)[0] - ends_o[0] - Vector3::z()).norm() < 1e-6);
    }
}
