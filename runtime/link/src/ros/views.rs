//! Views for RViz 2: paths, clouds of points, and markers.

use super::frames::RosFrames;
use super::interface::Bytes;
use super::landmarks::MapLandmarks;
use super::messages::{
    ColorRgba, CompressedImage, Duration, Header, Marker, MarkerArray, MeshFile, Path, Point, PointCloud2,
    PointField, Pose, PoseStamped, Time, Vector3,
};
use nalgebra::Isometry3;
use plumbline_config::Timestamp;
use plumbline_estimator::places::MapPath;

/// `FLOAT32` of `sensor_msgs/msg/PointField`.
const FLOAT32: u8 = 7;
/// Bytes of a point: x, y, z.
const POINT_BYTES: u32 = 12;

/// Types of `visualization_msgs/msg/Marker`.
const LINE_LIST: i32 = 5;
const SPHERE_LIST: i32 = 7;
/// Action of a marker: add or modify.
const ADD: i32 = 0;

/// Width of drawn lines, and diameter of drawn keyframes, m.
const LINE_M: f64 = 0.02;
const LOOP_M: f64 = 0.03;
const KEYFRAME_M: f64 = 0.08;

const LINES: ColorRgba = ColorRgba { r: 0.16, g: 0.71, b: 0.96, a: 1.0 };
const LOOPS: ColorRgba = ColorRgba { r: 0.97, g: 0.45, b: 0.2, a: 1.0 };
const KEYFRAMES: ColorRgba = ColorRgba { r: 0.95, g: 0.85, b: 0.3, a: 1.0 };

/// Path of the vehicle from poses of the body, each with its stamp. `time` gives stamps as headers have them.
#[must_use]
pub fn path<'a>(
    frames: &RosFrames<'a>,
    frame_id: &'a str,
    poses: impl IntoIterator<Item = (Timestamp, Isometry3<f64>)>,
    time: impl Fn(Timestamp) -> Time,
) -> Path<'a> {
    let stamped = |(stamp, pose_b): (Timestamp, Isometry3<f64>)| PoseStamped {
        header: Header { stamp: time(stamp), frame_id },
        pose: frames.vehicle(&pose_b).into(),
    };
    let poses: Vec<_> = poses.into_iter().map(stamped).collect();
    let stamp = poses.last().map_or_else(|| Time::from_nanos(0), |newest| newest.header.stamp);
    Path { header: Header { stamp, frame_id }, poses }
}

/// Cloud of points.
#[must_use]
pub fn cloud(
    header: Header<'_>,
    points: impl IntoIterator<Item = nalgebra::Vector3<f32>>,
) -> PointCloud2<'_> {
    let mut data = Vec::new();
    for number in points.into_iter().flat_map(|p| [p.x, p.y, p.z]) {
        data.extend_from_slice(&number.to_le_bytes());
    }
    let row_step = u32::try_from(data.len()).unwrap_or(u32::MAX);
    let field =
        |(name, k): (&'static str, u32)| PointField { name, offset: 4 * k, datatype: FLOAT32, count: 1 };
    PointCloud2 {
        header,
        height: 1,
        width: row_step / POINT_BYTES,
        fields: [("x", 0), ("y", 1), ("z", 2)].into_iter().map(field).collect(),
        is_bigendian: false,
        point_step: POINT_BYTES,
        row_step,
        data: Bytes(data),
        is_dense: true,
    }
}

/// Lines as one marker.
#[must_use]
pub fn lines<'a>(
    header: &Header<'a>,
    lines: impl IntoIterator<Item = [nalgebra::Vector3<f64>; 2]>,
) -> MarkerArray<'a> {
    let ends = lines.into_iter().flatten().map(Point::from).collect();
    MarkerArray { markers: vec![marker(header, "lines", LINE_LIST, LINE_M, LINES, ends)] }
}

/// Keyframes, loops and lines in the map as three markers.
#[must_use]
pub fn map<'a>(header: &Header<'a>, path: &MapPath, landmarks: &MapLandmarks) -> MarkerArray<'a> {
    let keyframes = path.poses.iter().map(|at| at.pose_m_b.translation.vector.into()).collect();
    let loops =
        path.loops.iter().flat_map(|ends| [ends.seen, ends.seen_by]).map(|end| end.p_m_b.into()).collect();
    let lines = landmarks.lines.iter().flatten().map(|end| end.cast::<f64>().into()).collect();
    MarkerArray {
        markers: vec![
            marker(header, "keyframes", SPHERE_LIST, KEYFRAME_M, KEYFRAMES, keyframes),
            marker(header, "loops", LINE_LIST, LOOP_M, LOOPS, loops),
            marker(header, "lines", LINE_LIST, LINE_M, LINES, lines),
        ],
    }
}

/// Marker of many points. It stands until the next one of its namespace.
fn marker<'a>(
    header: &Header<'a>,
    ns: &'a str,
    kind: i32,
    size_m: f64,
    color: ColorRgba,
    points: Vec<Point>,
) -> Marker<'a> {
    // A list of spheres has all three sizes, one of lines has its width in the first.
    let other_m = if kind == SPHERE_LIST { size_m } else { 0.0 };
    Marker {
        header: header.clone(),
        ns,
        id: 0,
        r#type: kind,
        action: ADD,
        pose: Pose::from(Isometry3::identity()),
        scale: Vector3 { x: size_m, y: other_m, z: other_m },
        color,
        lifetime: Duration::default(),
        frame_locked: false,
        points,
        colors: Vec::new(),
        texture_resource: "",
        texture: CompressedImage {
            header: Header { stamp: Time::from_nanos(0), frame_id: "" },
            format: "",
            data: Bytes::default(),
        },
        uv_coordinates: Vec::new(),
        text: "",
        mesh_resource: "",
        mesh_file: MeshFile { filename: "", data: Bytes::default() },
        mesh_use_embedded_materials: false,
    }
}

#[cfg(test)]
mod tests {
    use super::super::frames::tests::upright;
    use super::*;

    const TIME: Time = Time { sec: 5, nanosec: 7 };

    #[test]
    fn a_path_has_the_vehicle_s_poses_and_the_newest_stamp() {
        let frames = upright();
        let poses = [1, 2].map(|k| (Timestamp::from_nanos(k), Isometry3::translation(k as f64, 0.0, 0.0)));
        let path = path(&frames, "odom", poses, |stamp| Time::from_nanos(stamp.as_nanos()));
        assert_eq!(path.header, Header { stamp: Time::from_nanos(2), frame_id: "odom" });
        assert_eq!(path.poses.len(), 2);
        assert_eq!(path.poses[0].pose.position, Point { x: 1.0, y: 0.0, z: 0.0 });
        assert_eq!(path.poses[0].pose.orientation, frames.rot_v_b.inverse().into());
    }

    #[test]
    fn a_cloud_is_as_wide_as_its_points() {
        let header = Header { stamp: TIME, frame_id: "odom" };
        let points = [nalgebra::Vector3::new(1.0, 2.0, 3.0), nalgebra::Vector3::new(4.0, 5.0, 6.0)];
        let cloud = cloud(header, points);
        assert_eq!((cloud.width, cloud.height, cloud.point_step, cloud.row_step), (2, 1, 12, 24));
        let numbers: Vec<f32> =
            cloud.data.0.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!(numbers, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let offsets: Vec<_> = cloud.fields.iter().map(|field| (field.name, field.offset)).collect();
        assert_eq!(offsets, [("x", 0), ("y", 4), ("z", 8)]);
    }

    #[test]
    fn lists_of_lines_have_two_points_a_line() {
        let header = Header { stamp: TIME, frame_id: "map" };
        let ends = [nalgebra::Vector3::x(), nalgebra::Vector3::y()];
        assert_eq!(lines(&header, [ends, ends]).markers[0].points.len(), 4);
        let landmarks = MapLandmarks { lines: vec![ends.map(|end| end.cast())], ..MapLandmarks::default() };
        let markers = map(&header, &MapPath::new(0), &landmarks).markers;
        let shown: Vec<_> = markers.iter().map(|m| (m.ns, m.points.len())).collect();
        assert_eq!(shown, [("keyframes", 0), ("loops", 0), ("lines", 2)]);
    }
}
