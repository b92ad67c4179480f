//! Poses as files: TUM, CSV, MCAP.

use super::track::PoseSample;
use mcap::McapError;
use plumbline_link::net::{DESCRIPTORS, proto, wire};
use prost::Message;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Cursor;

/// A format of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `t[s] x y z qx qy qz qw`.
    Tum,
    /// With velocity, quality and resets.
    Csv,
    /// `plumbline.v1.Odom` messages.
    Mcap,
}

impl Format {
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

    /// Its media type.
    #[must_use]
    pub fn mime(self) -> &'static str {
        match self {
            Self::Tum => "text/plain; charset=utf-8",
            Self::Csv => "text/csv; charset=utf-8",
            Self::Mcap => "application/octet-stream",
        }
    }
}

/// The samples as a file.
///
/// # Errors
/// When a log cannot be written.
pub fn export(vehicle: &str, samples: &[PoseSample], format: Format) -> Result<Vec<u8>, McapError> {
    match format {
        Format::Tum => Ok(tum(samples).into_bytes()),
        Format::Csv => Ok(csv(samples).into_bytes()),
        Format::Mcap => mcap(vehicle, samples),
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

fn mcap(vehicle: &str, samples: &[PoseSample]) -> Result<Vec<u8>, McapError> {
    let mut file = Cursor::new(Vec::new());
    let mut writer = mcap::WriteOptions::new().profile("plumbline").create(&mut file)?;
    let schema = writer.add_schema("plumbline.v1.Odom", "protobuf", DESCRIPTORS)?;
    let topic = format!("plumbline/{vehicle}/odom");
    let channel = writer.add_channel(schema, &topic, "protobuf", &BTreeMap::new())?;
    for (sequence, sample) in (0u32..).zip(samples) {
        let v = sample.v_o_b;
        let message = proto::Odom {
            header: Some(proto::Header {
                stamp_ns: sample.stamp_ns,
                sequence: u64::from(sequence),
                reset_counter: sample.reset_counter,
                quality: sample.quality,
                ..proto::Header::default()
            }),
            pose: wire::pose(&sample.pose_o_b),
            velocity_o_b: Some(proto::Vector3 { x: v.x, y: v.y, z: v.z }),
            ..proto::Odom::default()
        };
        let time_ns = u64::try_from(sample.stamp_ns).unwrap_or_default();
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence,
            log_time: time_ns,
            publish_time: time_ns,
        };
        writer.write_to_known_channel(&header, &message.encode_to_vec())?;
    }
    writer.finish()?;
    drop(writer);
    Ok(file.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};

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
        let text = String::from_utf8(export("drone", &samples(), Format::Tum).unwrap()).unwrap();
        assert!(text.starts_with("1403715273.262142976 0.000000000 0.500000000 -1.000000000 0.0"));
        let text = String::from_utf8(export("drone", &samples(), Format::Csv).unwrap()).unwrap();
        assert_eq!(text.lines().count(), 4);
        assert!(text.lines().nth(2).unwrap().starts_with("1403715273267142976,1,0.5,-1,"));
    }

    #[test]
    fn a_log_is_read_back() {
        let bytes = export("drone", &samples(), Format::Mcap).unwrap();
        let messages: Vec<_> = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).collect();
        assert_eq!(messages.len(), 3);
        assert_eq!(messages[1].channel.topic, "plumbline/drone/odom");
        let odom = proto::Odom::decode(&messages[1].data[..]).unwrap();
        assert_eq!(odom.header.unwrap().stamp_ns, samples()[1].stamp_ns);
    }
}
