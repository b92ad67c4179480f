//! Landmarks, lines and keyframes as a scene that Foxglove draws.
//!
//! A scene holds entities by their ids, and one of the same id takes the place of the other: so the window is three entities
//! that change, and each keyframe that has left it with its landmarks is one that stays.

use super::drawn::{pose, timestamp};
use super::foxglove;
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_estimator::MapSnapshot;

/// Diameter of a point, m.
const POINT_M: f64 = 0.03;
/// Length of the axes of a keyframe, m.
const AXIS_M: f64 = 0.12;
/// Thickness of lines, px.
const LINE_PX: f64 = 2.0;
/// Colours of landmarks in the window, and of those that have left it.
const WINDOW: [f64; 3] = [1.0, 0.65, 0.1];
const KEPT: [f64; 3] = [0.35, 0.6, 0.95];
/// Colours of x, y and z.
const AXES: [[f64; 3]; 3] = [[0.9, 0.2, 0.2], [0.2, 0.8, 0.2], [0.25, 0.4, 1.0]];

/// Kinds of landmarks: those in the window may still move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Landmarks {
    /// Landmarks in the window.
    InWindow,
    /// Landmarks of a keyframe that has left the window.
    Kept,
}

/// Content of a part of a scene.
#[derive(Clone, Debug, Default)]
pub struct SceneContent {
    /// Points.
    pub points: Vec<Vector3<f64>>,
    /// Lines by their ends.
    pub lines: Vec<[Vector3<f64>; 2]>,
    /// Poses of keyframes.
    pub keyframes: Vec<Isometry3<f64>>,
}

impl SceneContent {
    /// All of a window.
    #[must_use]
    pub fn of_window(snapshot: &MapSnapshot) -> Self {
        Self {
            points: snapshot.points.iter().map(|point| point.p_o).collect(),
            lines: snapshot.lines.iter().map(|line| line.ends_o).collect(),
            keyframes: snapshot.keyframes.iter().map(|keyframe| keyframe.pose_o_b).collect(),
        }
    }

    /// The keyframe of a window that was taken at `stamp`, with the landmarks that it hosts.
    #[must_use]
    pub fn of_keyframe(snapshot: &MapSnapshot, stamp: Timestamp) -> Self {
        let keyframes = snapshot.keyframes.iter().filter(|keyframe| keyframe.stamp == stamp);
        Self {
            points: snapshot
                .points
                .iter()
                .filter(|point| point.host == stamp)
                .map(|point| point.p_o)
                .collect(),
            lines: snapshot.lines.iter().filter(|line| line.host == stamp).map(|line| line.ends_o).collect(),
            keyframes: keyframes.map(|keyframe| keyframe.pose_o_b).collect(),
        }
    }

    /// From flat coordinates: x y z of each point, and of both ends of each line.
    #[must_use]
    pub fn of_coordinates(points: &[f32], lines: &[f32], keyframes: &[Isometry3<f64>]) -> Self {
        let point = |at: &[f32]| Vector3::new(f64::from(at[0]), f64::from(at[1]), f64::from(at[2]));
        Self {
            points: points.chunks_exact(3).map(point).collect(),
            lines: lines.chunks_exact(6).map(|ends| [point(&ends[..3]), point(&ends[3..])]).collect(),
            keyframes: keyframes.to_vec(),
        }
    }
}

/// The entity `id` in `frame`.
#[must_use]
pub fn entity(
    stamp: Timestamp,
    frame: &str,
    id: &str,
    content: &SceneContent,
    which: Landmarks,
) -> foxglove::SceneEntity {
    let colour = colour(if which == Landmarks::InWindow { WINDOW } else { KEPT });
    let ball = |point: &Vector3<f64>| foxglove::SpherePrimitive {
        pose: Some(place(point)),
        size: Some(foxglove::Vector3 { x: POINT_M, y: POINT_M, z: POINT_M }),
        color: Some(colour),
    };
    let lines = line_list(content.lines.iter().flatten().copied(), Some(colour), Vec::new());
    let axes = axes(&content.keyframes);
    foxglove::SceneEntity {
        timestamp: timestamp(stamp),
        frame_id: frame.to_owned(),
        id: id.to_owned(),
        spheres: content.points.iter().map(ball).collect(),
        lines: [lines, axes].into_iter().filter(|list| !list.points.is_empty()).collect(),
        ..foxglove::SceneEntity::default()
    }
}

/// A change that puts `entities` into a scene.
#[must_use]
pub fn update(entities: Vec<foxglove::SceneEntity>) -> foxglove::SceneUpdate {
    foxglove::SceneUpdate { deletions: Vec::new(), entities }
}

/// A change that empties a scene.
#[must_use]
pub fn cleared(stamp: Timestamp) -> foxglove::SceneUpdate {
    let deletion = foxglove::SceneEntityDeletion {
        timestamp: timestamp(stamp),
        r#type: foxglove::scene_entity_deletion::Type::All.into(),
        id: String::new(),
    };
    foxglove::SceneUpdate { deletions: vec![deletion], entities: Vec::new() }
}

/// A path.
#[must_use]
pub fn poses(stamp: Timestamp, frame: &str, poses: &[Isometry3<f64>]) -> foxglove::PosesInFrame {
    let poses = poses.iter().map(pose).collect();
    foxglove::PosesInFrame { timestamp: timestamp(stamp), frame_id: frame.to_owned(), poses }
}

fn place(at: &Vector3<f64>) -> foxglove::Pose {
    pose(&Isometry3::translation(at.x, at.y, at.z))
}

fn colour([r, g, b]: [f64; 3]) -> foxglove::Color {
    foxglove::Color { r, g, b, a: 1.0 }
}

/// Axes of all poses as one list of lines.
fn axes(poses: &[Isometry3<f64>]) -> foxglove::LinePrimitive {
    let arms = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| axis * AXIS_M);
    let ends = poses.iter().flat_map(|pose| {
        let from = pose.translation.vector;
        arms.iter().flat_map(move |arm| [from, from + pose.rotation * arm])
    });
    let colours = poses.iter().flat_map(|_| AXES).flat_map(|axis| [colour(axis); 2]).collect();
    line_list(ends, None, colours)
}

fn line_list(
    ends: impl Iterator<Item = Vector3<f64>>,
    color: Option<foxglove::Color>,
    colors: Vec<foxglove::Color>,
) -> foxglove::LinePrimitive {
    foxglove::LinePrimitive {
        r#type: foxglove::line_primitive::Type::LineList.into(),
        pose: Some(pose(&Isometry3::identity())),
        thickness: LINE_PX,
        scale_invariant: true,
        points: ends.map(|at| foxglove::Point3 { x: at.x, y: at.y, z: at.z }).collect(),
        color,
        colors,
        indices: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lines_and_axes_are_where_they_were() {
        let content = SceneContent::of_coordinates(
            &[1.0, 2.0, 3.0, 4.0],
            &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            &[Isometry3::translation(5.0, 0.0, 0.0)],
        );
        let made =
            entity(Timestamp::from_nanos(1_500_000_000), "odom", "window", &content, Landmarks::InWindow);
        let at = made.spheres[0].pose.as_ref().unwrap().position.unwrap();
        assert_eq!((made.spheres.len(), at.x, at.z), (1, 1.0, 3.0));
        assert_eq!(
            (made.lines[0].points.len(), made.lines[1].points.len(), made.lines[1].colors.len()),
            (2, 6, 6)
        );
        assert_eq!((made.lines[1].points[0].x, made.lines[1].points[1].x), (5.0, 5.0 + AXIS_M));
        assert_eq!(made.timestamp.unwrap().nanos, 500_000_000);
        let empty =
            entity(Timestamp::from_nanos(0), "odom", "window", &SceneContent::default(), Landmarks::Kept);
        assert!(empty.spheres.is_empty() && empty.lines.is_empty());
    }
}
