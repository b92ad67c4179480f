//! Records that are protobuf messages, and back. What does not fit together is refused.

use super::picture::Shot;
use crate::schedule::ladder::Rung;
use crate::sensor_board::SensorNews;
use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use plumbline_config::{GrayImage, Timestamp};
use plumbline_drivers::clock::StampFigures;
use plumbline_estimator::MapSnapshot;
use plumbline_estimator::places::MapPath;
use plumbline_estimator::places::mapper::path::{LoopEnd, PathPose};
use plumbline_estimator::window::snapshot::{SnapshotKeyframe, SnapshotLine, SnapshotPoint};

/// The generated messages of `local.proto`.
#[allow(missing_docs, clippy::all, clippy::pedantic, rustdoc::all)]
pub mod proto {
    include!("../../generated/plumbline.v1.local.rs");
}

/// Numbers of a pose, of a place, and of both ends of a line.
const POSE: usize = 7;
const PLACE: usize = 3;
const LINE: usize = 6;

fn pose(pose: &Isometry3<f64>) -> impl Iterator<Item = f64> + '_ {
    pose.translation.vector.iter().chain(pose.rotation.coords.iter()).copied()
}

fn pose_of([x, y, z, qx, qy, qz, qw]: [f64; POSE]) -> Isometry3<f64> {
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(qw, qx, qy, qz));
    Isometry3::from_parts(Vector3::new(x, y, z).into(), rotation)
}

/// `numbers` in groups of `N`, one for each of `count` things.
fn groups<const N: usize, T: Copy>(numbers: &[T], count: usize) -> Result<&[[T; N]], &'static str> {
    match numbers.as_chunks::<N>() {
        (groups, []) if groups.len() == count => Ok(groups),
        _ => Err("lists of different lengths"),
    }
}

/// Message of the window.
#[must_use]
pub fn window(s: &MapSnapshot) -> proto::Window {
    let stamps = |stamp: Timestamp| stamp.as_nanos();
    proto::Window {
        stamp_ns: s.stamp.as_nanos(),
        reset_counter: s.reset_counter,
        keyframe_stamps_ns: s.keyframes.iter().map(|k| stamps(k.stamp)).collect(),
        keyframe_poses_o_b: s.keyframes.iter().flat_map(|k| pose(&k.pose_o_b)).collect(),
        point_hosts_ns: s.points.iter().map(|p| stamps(p.host)).collect(),
        points_o: s.points.iter().flat_map(|p| p.p_o.iter().copied()).collect(),
        line_hosts_ns: s.lines.iter().map(|l| stamps(l.host)).collect(),
        lines_o: s.lines.iter().flat_map(|l| l.ends_o.iter().flatten().copied()).collect(),
    }
}

/// Window of a message.
///
/// # Errors
/// When its lists do not fit together.
pub fn window_of(m: &proto::Window) -> Result<MapSnapshot, &'static str> {
    let poses = groups::<POSE, f64>(&m.keyframe_poses_o_b, m.keyframe_stamps_ns.len())?;
    let points = groups::<PLACE, f64>(&m.points_o, m.point_hosts_ns.len())?;
    let lines = groups::<LINE, f64>(&m.lines_o, m.line_hosts_ns.len())?;
    let stamp = |ns: &i64| Timestamp::from_nanos(*ns);
    let keyframes = m.keyframe_stamps_ns.iter().zip(poses);
    let line = |(host, [a, b, c, d, e, f]): (&i64, &[f64; LINE])| SnapshotLine {
        host: stamp(host),
        ends_o: [Vector3::new(*a, *b, *c), Vector3::new(*d, *e, *f)],
    };
    let point =
        |(host, p): (&i64, &[f64; PLACE])| SnapshotPoint { host: stamp(host), p_o: Vector3::from(*p) };
    Ok(MapSnapshot {
        stamp: stamp(&m.stamp_ns),
        reset_counter: m.reset_counter,
        keyframes: keyframes
            .map(|(ns, pose)| SnapshotKeyframe { stamp: stamp(ns), pose_o_b: pose_of(*pose) })
            .collect(),
        points: m.point_hosts_ns.iter().zip(points).map(point).collect(),
        lines: m.line_hosts_ns.iter().zip(lines).map(line).collect(),
    })
}

/// Message of a corrected path.
#[must_use]
pub fn path(p: &MapPath) -> proto::Path {
    let ends = || p.loops.iter().flatten();
    proto::Path {
        stamps_ns: p.poses.iter().map(|at| at.stamp.as_nanos()).collect(),
        reset_counters: p.poses.iter().map(|at| at.reset_counter).collect(),
        poses_m_b: p.poses.iter().flat_map(|at| pose(&at.pose_m_b)).collect(),
        loops_ns: ends().map(|end| end.stamp.as_nanos()).collect(),
        loops_m: ends().flat_map(|end| end.p_m_b.iter().copied()).collect(),
        drift_m: p.drift_m,
    }
}

/// Corrected path of a message.
///
/// # Errors
/// When its lists do not fit together.
pub fn path_of(m: &proto::Path) -> Result<MapPath, &'static str> {
    let count = m.stamps_ns.len();
    let poses = groups::<POSE, f64>(&m.poses_m_b, count)?;
    let counters = groups::<1, u32>(&m.reset_counters, count)?;
    let places = groups::<PLACE, f64>(&m.loops_m, m.loops_ns.len())?;
    let loops = groups::<2, i64>(&m.loops_ns, m.loops_ns.len() / 2)?;
    let mut path = MapPath::new(0);
    path.drift_m = m.drift_m;
    let each = m.stamps_ns.iter().zip(counters).zip(poses);
    path.poses.extend(each.map(|((ns, [reset_counter]), pose)| PathPose {
        stamp: Timestamp::from_nanos(*ns),
        reset_counter: *reset_counter,
        pose_m_b: pose_of(*pose),
    }));
    let end = |ns: i64, place: [f64; PLACE]| LoopEnd {
        stamp: Timestamp::from_nanos(ns),
        p_m_b: Vector3::from(place),
    };
    let pairs = loops.iter().zip(places.as_chunks::<2>().0);
    path.loops.extend(pairs.map(|([a, b], [p, q])| [end(*a, *p), end(*b, *q)]));
    Ok(path)
}

/// Message of a rung of the ladder.
#[must_use]
pub fn ladder(level: u8) -> proto::Ladder {
    let name = Rung::of_level(level).unwrap_or(Rung::Full).name();
    proto::Ladder { level: level.into(), name: name.into() }
}

/// Message of live sensors.
#[must_use]
pub fn sensors(news: &SensorNews) -> proto::Sensors {
    let stamps = |figures: &StampFigures| proto::Stamps {
        used: figures.used,
        restamped: figures.restamped,
        refused: figures.refused,
    };
    proto::Sensors {
        notices: news.notices.clone(),
        frames: Some(stamps(&news.frames)),
        samples: Some(stamps(&news.samples)),
    }
}

/// Live sensors of a message.
#[must_use]
pub fn sensors_of(message: proto::Sensors) -> SensorNews {
    let stamps = |m: Option<proto::Stamps>| {
        let proto::Stamps { used, restamped, refused } = m.unwrap_or_default();
        StampFigures { used, restamped, refused, problem: None }
    };
    SensorNews { notices: message.notices, frames: stamps(message.frames), samples: stamps(message.samples) }
}

/// Message of a picture.
#[must_use]
pub fn picture(shot: &Shot) -> proto::Picture {
    let side = |length: usize| u32::try_from(length).unwrap_or(0);
    proto::Picture {
        frame: shot.frame,
        stamp_ns: shot.stamp.as_nanos(),
        width_px: side(shot.image.width()),
        height_px: side(shot.image.height()),
        pixels: shot.image.pixels().to_vec(),
        points: shot.points.as_flattened().to_vec(),
        lines: shot.lines.as_flattened().to_vec(),
    }
}

/// Picture of a message.
///
/// # Errors
/// When its pixels are not those of its size, or its lists are cut short.
pub fn picture_of(m: proto::Picture) -> Result<Shot, &'static str> {
    let (width, height) = (m.width_px as usize, m.height_px as usize);
    let fits = width.checked_mul(height) == Some(m.pixels.len());
    let image = GrayImage::from_pixels(width, height, if fits { m.pixels } else { Vec::new() });
    Ok(Shot {
        frame: m.frame,
        stamp: Timestamp::from_nanos(m.stamp_ns),
        image: image.filter(|_| fits).ok_or("pixels of another size")?,
        has_image: true,
        points: groups::<3, f32>(&m.points, m.points.len() / 3)?.to_vec(),
        lines: groups::<4, f32>(&m.lines, m.lines.len() / 4)?.to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fuzzing::fixture::STAMP;

    #[test]
    fn window_and_path_come_back_as_they_were() {
        let host = STAMP;
        let sent = MapSnapshot {
            stamp: STAMP,
            reset_counter: 2,
            keyframes: vec![SnapshotKeyframe {
                stamp: host,
                pose_o_b: Isometry3::translation(1.0, 2.0, 3.0),
            }],
            points: vec![SnapshotPoint { host, p_o: Vector3::x() }],
            lines: vec![SnapshotLine { host, ends_o: [Vector3::y(), Vector3::z()] }],
        };
        assert_eq!(window_of(&window(&sent)), Ok(sent));
        let end = |x: f64| LoopEnd { stamp: STAMP, p_m_b: Vector3::new(x, 0.0, 0.0) };
        let mut sent = MapPath::new(0);
        sent.poses.push(PathPose { stamp: STAMP, reset_counter: 1, pose_m_b: Isometry3::identity() });
        sent.loops.push([end(1.0), end(2.0)]);
        sent.drift_m = Some(0.5);
        assert_eq!(path_of(&path(&sent)), Ok(sent));
    }

    #[test]
    fn lists_that_do_not_fit_together_are_refused() {
        let odd = proto::Window { keyframe_stamps_ns: vec![1], ..proto::Window::default() };
        assert!(window_of(&odd).is_err());
        let odd = proto::Path { loops_ns: vec![1], loops_m: vec![0.0; 3], ..proto::Path::default() };
        assert!(path_of(&odd).is_err());
        let odd = proto::Picture { width_px: u32::MAX, height_px: u32::MAX, ..proto::Picture::default() };
        assert!(picture_of(odd).is_err());
    }
}
