//! Poses, transforms, landmarks, lines and keyframes as Foxglove's messages, for flight logs and for the ground station.
//!
//! A scene holds entities by their ids, and one of the same id takes the place of the other: so the window is one entity that
//! changes, and each keyframe that has left it with its landmarks is one that stays.

use foxglove::Encode;
use foxglove::messages::{
    CameraCalibration, Color, CompressedImage, FrameTransform, FrameTransforms, LinePrimitive, Log, Point3,
    Pose, PoseInFrame, PosesInFrame, Quaternion, RawImage, SceneEntity, SceneEntityDeletion, SceneUpdate,
    SpherePrimitive, Timestamp as MessageTime, line_primitive, log, scene_entity_deletion,
};
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_record::Severity;
use std::borrow::Cow;

/// Messages of Foxglove.
pub use foxglove::messages;

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

/// `FileDescriptorSet` of the message `name`, such as `foxglove.Log`; `None` for a message that nobody here draws.
pub fn descriptors(name: &str) -> Option<Cow<'static, [u8]>> {
    let schemas = [
        CameraCalibration::get_schema(),
        CompressedImage::get_schema(),
        FrameTransform::get_schema(),
        FrameTransforms::get_schema(),
        Log::get_schema(),
        PoseInFrame::get_schema(),
        PosesInFrame::get_schema(),
        RawImage::get_schema(),
        SceneUpdate::get_schema(),
    ];
    schemas.into_iter().flatten().find(|schema| schema.name == name).map(|schema| schema.data)
}

/// Time of a message, ns; the format knows none before its origin.
pub fn log_time(stamp: Timestamp) -> u64 {
    u64::try_from(stamp.as_nanos()).unwrap_or(0)
}

/// Time of a message as Foxglove's messages carry it: none before 1970 or after 2106.
pub fn timestamp(stamp: Timestamp) -> Option<MessageTime> {
    let (nanos, second) = (log_time(stamp), 1_000_000_000);
    MessageTime::new_checked(u32::try_from(nanos / second).ok()?, (nanos % second) as u32)
}

/// Takes coordinates from `child` to `parent`, as a transform to be drawn.
pub fn frame_transform(
    stamp: Timestamp,
    parent: &str,
    child: &str,
    pose_parent_child: &Isometry3<f64>,
) -> FrameTransform {
    let (translation, rotation) = drawn_pose(pose_parent_child);
    FrameTransform {
        timestamp: timestamp(stamp),
        parent_frame_id: parent.into(),
        child_frame_id: child.into(),
        translation: Some(translation),
        rotation: Some(rotation),
    }
}

fn drawn_pose(pose: &Isometry3<f64>) -> (messages::Vector3, Quaternion) {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    (messages::Vector3 { x: p.x, y: p.y, z: p.z }, Quaternion { x: q.x, y: q.y, z: q.z, w: q.w })
}

fn pose(of: &Isometry3<f64>) -> Pose {
    let (position, orientation) = drawn_pose(of);
    Pose { position: Some(position), orientation: Some(orientation) }
}

/// A pose in a frame.
pub fn pose_in(stamp: Timestamp, frame: &str, of: &Isometry3<f64>) -> PoseInFrame {
    PoseInFrame { timestamp: timestamp(stamp), frame_id: frame.to_owned(), pose: Some(pose(of)) }
}

/// An event of `name` as a line of a log.
pub fn event(stamp: Timestamp, severity: Severity, name: &str, text: &str) -> Log {
    let level = match severity {
        Severity::Info => log::Level::Info,
        Severity::Warning => log::Level::Warning,
        Severity::Error => log::Level::Error,
    };
    Log {
        timestamp: timestamp(stamp),
        level: level.into(),
        message: text.into(),
        name: name.into(),
        ..Log::default()
    }
}

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
    /// From flat coordinates: x y z of each point, and of both ends of each line.
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
pub fn entity(
    stamp: Timestamp,
    frame: &str,
    id: &str,
    content: &SceneContent,
    which: Landmarks,
) -> SceneEntity {
    let colour = colour(if which == Landmarks::InWindow { WINDOW } else { KEPT });
    let ball = |point: &Vector3<f64>| SpherePrimitive {
        pose: Some(place(point)),
        size: Some(messages::Vector3 { x: POINT_M, y: POINT_M, z: POINT_M }),
        color: Some(colour),
    };
    let lines = line_list(content.lines.iter().flatten().copied(), Some(colour), Vec::new());
    let axes = axes(&content.keyframes);
    SceneEntity {
        timestamp: timestamp(stamp),
        frame_id: frame.to_owned(),
        id: id.to_owned(),
        spheres: content.points.iter().map(ball).collect(),
        lines: [lines, axes].into_iter().filter(|list| !list.points.is_empty()).collect(),
        ..SceneEntity::default()
    }
}

/// A change that puts `entities` into a scene.
pub fn update(entities: Vec<SceneEntity>) -> SceneUpdate {
    SceneUpdate { deletions: Vec::new(), entities }
}

/// A change that empties a scene.
pub fn cleared(stamp: Timestamp) -> SceneUpdate {
    let deletion = SceneEntityDeletion {
        timestamp: timestamp(stamp),
        r#type: scene_entity_deletion::Type::All.into(),
        id: String::new(),
    };
    SceneUpdate { deletions: vec![deletion], entities: Vec::new() }
}

/// A path.
pub fn poses(stamp: Timestamp, frame: &str, poses: &[Isometry3<f64>]) -> PosesInFrame {
    let poses = poses.iter().map(pose).collect();
    PosesInFrame { timestamp: timestamp(stamp), frame_id: frame.to_owned(), poses }
}

fn place(at: &Vector3<f64>) -> Pose {
    pose(&Isometry3::translation(at.x, at.y, at.z))
}

fn colour([r, g, b]: [f64; 3]) -> Color {
    Color { r, g, b, a: 1.0 }
}

/// Axes of all poses as one list of lines.
fn axes(poses: &[Isometry3<f64>]) -> LinePrimitive {
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
    color: Option<Color>,
    colors: Vec<Color>,
) -> LinePrimitive {
    LinePrimitive {
        r#type: line_primitive::Type::LineList.into(),
        pose: Some(pose(&Isometry3::identity())),
        thickness: LINE_PX,
        scale_invariant: true,
        points: ends.map(|at| Point3 { x: at.x, y: at.y, z: at.z }).collect(),
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
        assert_eq!(made.timestamp.unwrap().nsec(), 500_000_000);
        let empty =
            entity(Timestamp::from_nanos(0), "odom", "window", &SceneContent::default(), Landmarks::Kept);
        assert!(empty.spheres.is_empty() && empty.lines.is_empty());
    }
}
