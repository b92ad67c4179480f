//! A map as a point cloud (PLY, Turk 1994): the points of all keyframes, the keyframes' places, and lines as edges.

use nalgebra::Vector3;
use plumbline_estimator::places::PlaceMap;
use std::fmt::Write as _;

/// Colour of points, dark where they are known badly.
const POINT_GREY: [f64; 2] = [230.0, 60.0];
/// Colour of keyframes.
const KEYFRAME: &str = "255 80 0";
/// Colour of the ends of lines.
const LINE: &str = "0 150 220";

/// The text of the file.
#[must_use]
pub fn ply(map: &PlaceMap) -> String {
    let mut vertices = Vertices::default();
    for (slot, keyframe) in map.keyframes() {
        let pose_m_c = keyframe.pose_m_c();
        for feature in map.features(slot).iter().filter(|f| f.is_point()) {
            let p = pose_m_c * nalgebra::Point3::from(feature.position_c());
            let relative = f64::from(feature.sigma_inverse_depth / feature.inverse_depth);
            let grey = (POINT_GREY[0] - 700.0 * relative).max(POINT_GREY[1]) as u8;
            vertices.push(&p.coords, &format!("{grey} {grey} {grey}"));
        }
    }
    for (_, keyframe) in map.keyframes() {
        vertices.push(&keyframe.pose_m_b.translation.vector, KEYFRAME);
    }
    let (mut edges, mut edge_count) = (String::new(), 0);
    for (slot, keyframe) in map.keyframes() {
        for line in map.lines(slot) {
            let [from, to] = line.ends(&keyframe.pose_m_c()).map(|end| vertices.push(&end, LINE));
            let _ = writeln!(edges, "{from} {to}");
            edge_count += 1;
        }
    }
    let (count, text) = (vertices.count, vertices.text);
    let properties = "property float x\nproperty float y\nproperty float z\n\
                      property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let of_edges = "property int vertex1\nproperty int vertex2\n";
    format!(
        "ply\nformat ascii 1.0\ncomment map of Plumbline, metres, z up\nelement vertex {count}\n{properties}\
         element edge {edge_count}\n{of_edges}end_header\n{text}{edges}"
    )
}

/// The vertices of the file.
#[derive(Default)]
struct Vertices {
    text: String,
    count: usize,
}

impl Vertices {
    /// Adds one, and returns its number.
    fn push(&mut self, p: &Vector3<f64>, colour: &str) -> usize {
        let _ = writeln!(self.text, "{:.4} {:.4} {:.4} {colour}", p.x, p.y, p.z);
        self.count += 1;
        self.count - 1
    }
}
