//! Poses as files: TUM, CSV, MCAP. The last holds the map too, as Foxglove draws it.

use super::drawn::{self, DrawnTopic};
use super::map::{MAX_KEYFRAMES, Map};
use super::track::PoseSample;
use mcap::McapError;
use plumbline_config::Timestamp;
use plumbline_estimator::{Odometry, TrackingState};
use plumbline_link::net::outlet::key_of;
use plumbline_record::protobuf::encode;
use plumbline_record::{schema, topics};
use plumbline_scene::{descriptors, update};
use prost::Message;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Cursor;

/// A format of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// `t[s] x y z qx qy qz qw`.
    Tum,
    /// With velocity, quality and resets.
    Csv,
    /// `plumbline.v1.log.Odometry` messages, and poses, transforms, path and scene in Foxglove's schemas.
    Mcap,
}

impl ExportFormat {
    /// By the ending of a file.
    #[must_use]
    pub fn of(ending: &str) -> Option<Self> {
        [Self::Tum, Self::Csv, Self::Mcap].into_iter().find(|format| format.ending() == ending)
    }

    /// The ending of its files.
    #[must_use]
    pub fn ending(self) -> &'static str {
        match self {
            Self::Tum => "tum",
            Self::Csv => "csv",
            Self::Mcap => "mcap",
        }
    }

    /// Media type.
    #[must_use]
    pub fn mime(self) -> &'static str {
        match self {
            Self::Tum => "text/plain; charset=utf-8",
            Self::Csv => "text/csv; charset=utf-8",
            Self::Mcap => "application/octet-stream",
        }
    }
}

/// The samples as a file; with `map`, where a format has room for it.
///
/// # Errors
/// When a log cannot be written.
pub fn export(
    vehicle: &str,
    samples: &[PoseSample],
    map: &Map,
    format: ExportFormat,
) -> Result<Vec<u8>, McapError> {
    match format {
        ExportFormat::Tum => Ok(tum(samples).into_bytes()),
        ExportFormat::Csv => Ok(csv(samples).into_bytes()),
        ExportFormat::Mcap => mcap(vehicle, samples, map),
    }
}

fn tum(samples: &[PoseSample]) -> String {
    let mut text = String::new();
    for sample in samples {
        let (p, q) = (sample.pose_o_b.translation.vector, sample.pose_o_b.rotation.coords);
        let (s, ns) = (sample.stamp_ns.div_euclid(1_000_000_000), sample.stamp_ns.rem_euclid(1_000_000_000));
        let _ = writeln!(
            text,
            "{s}.{ns:09} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}",
            p.x, p.y, p.z, q.x, q.y, q.z, q.w
        );
    }
    text
}

fn csv(samples: &[PoseSample]) -> String {
    let mut text = String::from(
        "stamp [ns],x [m],y [m],z [m],qx,qy,qz,qw,vx [m/s],vy [m/s],vz [m/s],quality,reset_counter\n",
    );
    for sample in samples {
        let (p, q, v) = (sample.pose_o_b.translation.vector, sample.pose_o_b.rotation.coords, sample.v_o_b);
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{}",
            sample.stamp_ns,
            p.x,
            p.y,
            p.z,
            q.x,
            q.y,
            q.z,
            q.w,
            v.x,
            v.y,
            v.z,
            sample.quality,
            sample.reset_counter
        );
    }
    text
}

fn mcap(vehicle: &str, samples: &[PoseSample], map: &Map) -> Result<Vec<u8>, McapError> {
    let mut file = Cursor::new(Vec::new());
    let mut log = Log::new(mcap::WriteOptions::new().profile("plumbline").create(&mut file)?);
    let odometry = log.channel(
        &key_of(vehicle, topics::Topic::Odometry),
        topics::Topic::Odometry.row().message,
        &schema::descriptors(),
    )?;
    let mut drawn = |topic: DrawnTopic| {
        let schema = descriptors(topic.schema()).unwrap_or_default();
        log.channel(&topic.of(vehicle), topic.schema(), &schema)
    };
    let (pose, transform) = (drawn(DrawnTopic::Pose)?, drawn(DrawnTopic::Transform)?);
    let (path, scene) = (drawn(DrawnTopic::Path)?, drawn(DrawnTopic::Scene)?);
    if let Some(first) = samples.first() {
        // The path and the window are there from the beginning: a file is looked at as a whole.
        let stamp = Timestamp::from_nanos(first.stamp_ns);
        log.put(path, first.stamp_ns, &drawn::path(vehicle, stamp, samples.iter()))?;
        let window = drawn::window(vehicle, stamp, &map.scene);
        log.put(scene, first.stamp_ns, &update(vec![window]).encode_to_vec())?;
    }
    for (sequence, keyframe) in map.since(0, MAX_KEYFRAMES).1 {
        let entity = drawn::keyframe(vehicle, sequence, keyframe);
        log.put(scene, keyframe.stamp_ns, &update(vec![entity]).encode_to_vec())?;
    }
    for (sequence, sample) in (0..).zip(samples) {
        let stamp = Timestamp::from_nanos(sample.stamp_ns);
        log.put(odometry, sample.stamp_ns, &encode(&odom(sequence, sample)))?;
        log.put(pose, sample.stamp_ns, &DrawnTopic::Pose.pose_message(vehicle, stamp, &sample.pose_o_b))?;
        log.put(
            transform,
            sample.stamp_ns,
            &DrawnTopic::Transform.pose_message(vehicle, stamp, &sample.pose_o_b),
        )?;
    }
    log.writer.finish()?;
    drop(log);
    Ok(file.into_inner())
}

fn odom(sequence: u64, sample: &PoseSample) -> Odometry {
    Odometry {
        sequence,
        stamp: Timestamp::from_nanos(sample.stamp_ns),
        pose_o_b: sample.pose_o_b,
        v_o_b: sample.v_o_b,
        state: TrackingState::Tracking,
        quality: i8::try_from(sample.quality).unwrap_or_default(),
        reset_counter: sample.reset_counter,
        ..Odometry::default()
    }
}

/// A log that is being made in memory.
struct Log<'a> {
    writer: mcap::Writer<&'a mut Cursor<Vec<u8>>>,
    messages: u32,
}

impl<'a> Log<'a> {
    fn new(writer: mcap::Writer<&'a mut Cursor<Vec<u8>>>) -> Self {
        Self { writer, messages: 0 }
    }

    fn channel(&mut self, topic: &str, schema: &str, descriptors: &[u8]) -> Result<u16, McapError> {
        let schema = self.writer.add_schema(schema, "protobuf", descriptors)?;
        self.writer.add_channel(schema, topic, "protobuf", &BTreeMap::new())
    }

    fn put(&mut self, channel_id: u16, stamp_ns: i64, payload: &[u8]) -> Result<(), McapError> {
        let time_ns = u64::try_from(stamp_ns).unwrap_or_default();
        let (sequence, log_time) = (self.messages, time_ns);
        self.messages = self.messages.wrapping_add(1);
        let header = mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time: time_ns };
        self.writer.write_to_known_channel(&header, payload)
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_messages::{heard, window};
    use super::*;
    use nalgebra::{Isometry3, Vector3};
    use plumbline_record::protobuf;
    use plumbline_scene::messages::SceneUpdate;

    fn samples() -> Vec<PoseSample> {
        let sample = |k: i64| PoseSample {
            stamp_ns: 1_403_715_273_262_142_976 + k * 5_000_000,
            pose_o_b: Isometry3::translation(k as f64, 0.5, -1.0),
            v_o_b: Vector3::new(1.0, 2.0, 3.0),
            quality: 90,
            reset_counter: 1,
        };
        (0..3).map(sample).collect()
    }

    #[test]
    fn text_keeps_every_nanosecond() {
        let text =
            String::from_utf8(export("drone", &samples(), &Map::default(), ExportFormat::Tum).unwrap())
                .unwrap();
        assert!(text.starts_with("1403715273.262142976 0.000000000 0.500000000 -1.000000000 0.0"));
        let text =
            String::from_utf8(export("drone", &samples(), &Map::default(), ExportFormat::Csv).unwrap())
                .unwrap();
        assert_eq!(text.lines().count(), 4);
        assert!(text.lines().nth(2).unwrap().starts_with("1403715273267142976,1,0.5,-1,"));
    }

    #[test]
    fn a_log_is_read_back() {
        let mut map = Map::default();
        map.insert(&heard(0, window(samples()[1].stamp_ns, 0, 1)));
        let bytes = export("drone", &samples(), &map, ExportFormat::Mcap).unwrap();
        let messages: Vec<_> = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).collect();
        let of = |topic: &str| {
            messages.iter().filter(|message| message.channel.topic == topic).collect::<Vec<_>>()
        };
        assert_eq!((of("/drone/pose").len(), of("/drone/tf").len(), of("/drone/path").len()), (3, 3, 1));
        let odometry = of("plumbline/drone/odom");
        let odom: Odometry = protobuf::decode(&odometry[1].data).unwrap();
        assert_eq!((odometry.len(), odom.stamp.as_nanos()), (3, samples()[1].stamp_ns));
        let scenes = of("/drone/scene");
        let keyframe = SceneUpdate::decode(&scenes[1].data[..]).unwrap().entities.remove(0);
        assert_eq!((scenes.len(), keyframe.id.as_str(), keyframe.spheres.len()), (2, "keyframe 0", 1));
        assert_eq!((scenes[1].log_time, keyframe.lines.len()), (samples()[1].stamp_ns as u64, 2));
    }
}
