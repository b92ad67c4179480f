//! Makes the seeds of the targets of this crate: `cargo nextest run -p plumbline-flight --run-ignored only fuzz_seeds`.

use super::fixture::{STAMP, estimate, odometry, put};
use crate::local::record::{Kind, Kinds, MAGIC, encoded};
use crate::local::request::{Answer, At, Request, RequestStatus};
use crate::local::{Failure, SensorNews, Shot};
use crate::log::channel::Channel;
use crate::log::{image, part_header::METADATA_NAME, part_header::PartHeader};
use mavlink::dialects::common::{HEARTBEAT_DATA, MavMessage, TIMESYNC_DATA};
use mcap::records::{MessageHeader, Metadata};
use nalgebra::{Isometry3, Vector3};
use plumbline_config::options::ImageRecording;
use plumbline_config::{Config, GrayImage, ImuSample};
use plumbline_drivers::{ImuReading, StereoFrame};
use plumbline_estimator::places::mapper::path::PathPose;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_estimator::window::snapshot::{SnapshotKeyframe, SnapshotLine, SnapshotPoint};
use plumbline_estimator::{MapSnapshot, ResetKind, Trail, TrailState};
use plumbline_record::layout;
use plumbline_record::messages::{Configuration, LadderRung, Picture};
use plumbline_record::parts::RecordingState;
use plumbline_record::protobuf::encode;
use plumbline_record::said::FullEstimate;
use plumbline_record::{
    CorrectionOrder, Dropped, FrameOrder, InstantAnswer, InstantOrder, InstantSource, MapOrder, MapVerdict,
    ResetOrder, Severity, Verdict,
};
use prost::Message as _;
use std::collections::BTreeMap;
use std::io::Cursor;

fn imu() -> ImuReading {
    let sample = ImuSample { stamp: STAMP, gyro: Vector3::zeros(), accel: Vector3::z() * 9.81 };
    ImuReading { sequence: 4, sample }
}

/// A message of every channel, as a recorder writes it.
fn log_messages() -> Vec<(Channel, Vec<u8>)> {
    let picture = GrayImage::from_pixels(8, 6, (0..48).collect()).unwrap();
    let frame = StereoFrame {
        sequence: 3,
        stamp: STAMP,
        valid: [true; 2],
        images: [picture.clone(), picture.clone()],
    };
    let picture = |images| {
        let mut bytes = Vec::new();
        image::encode(&picture, STAMP, "left", images, &mut bytes).unwrap();
        bytes
    };
    let order = FrameOrder { frame: 3, readings_before: 9, verdict: Verdict::Taken { level: 1 } };
    let map_order = MapOrder { frame: 3, verdict: MapVerdict::Applied { at_frame: 9 } };
    let map_estimate = MapEstimate {
        frame_sequence: 3,
        stamp: STAMP,
        pose_m_o: Some(Isometry3::translation(1.0, 2.0, 3.0)),
        reset_counter: 1,
        keyframes: 20,
        sightings: 3,
        loops_used: 2,
    };
    let drawn = plumbline_scene::event(STAMP, Severity::Info, "plumbline", "tracking");
    let dropped = Dropped([2, 0, 0, 0, 0, 0, 0, 0]);
    let recording = RecordingState { dropped, seal: vec![7; 32], ..RecordingState::default() };
    vec![
        (Channel::Imu, encode(&imu())),
        (Channel::Left, picture(ImageRecording::Png)),
        (Channel::Right, picture(ImageRecording::Raw)),
        (Channel::Frame, encode(&image::frame(&frame))),
        (Channel::FrameOrder, encode(&order)),
        (Channel::CorrectionOrder, encode(&CorrectionOrder { frame: 3, readings_before: 9 })),
        (
            Channel::ResetOrder,
            encode(&ResetOrder { kind: ResetKind::Soft, before_frame: 3, is_renewal: true }),
        ),
        (Channel::MapOrder, encode(&map_order)),
        (
            Channel::InstantOrder,
            encode(&InstantOrder {
                number: 3,
                stamp: STAMP,
                readings_before: 9,
                source: InstantSource::List,
            }),
        ),
        (Channel::Instant, encode(&InstantAnswer { number: 3, ..InstantAnswer::default() })),
        (Channel::MapEstimate, encode(&map_estimate)),
        (Channel::Estimate, encode(&estimate())),
        (Channel::Odometry, encode(&odometry())),
        (Channel::Event, drawn.encode_to_vec()),
        (Channel::Recording, encode(&recording)),
    ]
}

/// A log in which bytes can change without a checksum to refuse them.
fn log(with_chunks: bool) -> Vec<u8> {
    let options = mcap::WriteOptions::new()
        .compression(None)
        .use_chunks(with_chunks)
        .calculate_chunk_crcs(false)
        .calculate_data_section_crc(false)
        .calculate_summary_section_crc(false);
    let mut file = Cursor::new(Vec::new());
    let mut writer = options.create(&mut file).unwrap();
    let mut metadata = PartHeader::new(&Config::preset("sim").unwrap()).unwrap().to_metadata().unwrap();
    metadata.insert("flight".into(), "0123456789abcdef".into());
    writer.write_metadata(&Metadata { name: METADATA_NAME.into(), metadata }).unwrap();
    for (sequence, (channel, payload)) in (0u32..).zip(log_messages()) {
        let id = writer.add_channel(0, channel.channel(), "protobuf", &BTreeMap::new()).unwrap();
        let time_ns = STAMP.as_nanos() as u64;
        let header = MessageHeader { channel_id: id, sequence, log_time: time_ns, publish_time: time_ns };
        writer.write_to_known_channel(&header, &payload).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    file.into_inner()
}

fn mavlink_bytes() -> Vec<u8> {
    let header = mavlink::MavHeader { system_id: 1, component_id: 1, sequence: 3 };
    let timesync =
        |tc1, ts1| MavMessage::TIMESYNC(TIMESYNC_DATA { tc1, ts1, target_system: 0, target_component: 0 });
    let mut bytes = vec![3];
    for (k, message) in [timesync(0, 5), MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()), timesync(900, 7)]
        .iter()
        .enumerate()
    {
        if k == 1 {
            mavlink::write_v1_msg(&mut bytes, header, message).unwrap();
        } else {
            mavlink::write_v2_msg(&mut bytes, header, message).unwrap();
        }
    }
    bytes
}

fn local_requests() -> Vec<u8> {
    let failure = Failure { is_usage: true, words: "port already in use".into() };
    let all = [
        Request::Subscribe(Kinds::SUBSCRIBABLE),
        Request::Reset(ResetKind::Hard),
        Request::SaveMap,
        Request::Watch(5_000),
        Request::Ready,
        Request::Failed(failure),
        Request::Alive,
        Request::At(At { stamp: STAMP, patience_ms: 500, is_settled: true }),
    ];
    (1..).zip(&all).flat_map(|(number, request)| request.encode(number)).collect()
}

/// A record of every kind.
fn local_records() -> Vec<Vec<u8>> {
    let picture = GrayImage::from_pixels(8, 6, (0..48).collect()).unwrap();
    let (points, lines) = (vec![[1.0, 2.0, 3.0]], vec![[1.0, 2.0, 3.0, 4.0]]);
    let shot = Shot { frame: 3, stamp: STAMP, image: picture, has_image: true, points, lines };
    let snapshot = MapSnapshot {
        stamp: STAMP,
        reset_counter: 1,
        keyframes: vec![SnapshotKeyframe { stamp: STAMP, pose_o_b: Isometry3::identity() }],
        points: vec![SnapshotPoint { host: STAMP, p_o: Vector3::x() }],
        lines: vec![SnapshotLine { host: STAMP, ends_o: [Vector3::y(), Vector3::z()] }],
    };
    let mut path = MapPath::new(0);
    path.poses.push(PathPose { stamp: STAMP, reset_counter: 1, pose_m_b: Isometry3::identity() });
    let configuration = Configuration { toml: "a = 1".into(), ..Configuration::default() };
    let map = MapEstimate {
        frame_sequence: 3,
        stamp: STAMP,
        pose_m_o: None,
        reset_counter: 1,
        keyframes: 20,
        sightings: 3,
        loops_used: 2,
    };
    let answer = Answer { number: 4, status: RequestStatus::Refused, value: 0, words: "no".into() };
    let instant = InstantAnswer { number: 3, source: InstantSource::Trigger, ..InstantAnswer::default() };
    let state =
        TrailState { stamp: STAMP, pose_o_b: Isometry3::translation(1.0, 2.0, 3.0), v_o_b: Vector3::x() };
    let trail = Trail { stamp: STAMP, states: vec![state; 3], ..Trail::default() };
    let record = |kind: Kind, content: Vec<u8>| encoded(kind.kind(), 1, |to| to.extend(content));
    let laid_out = |put: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = Vec::new();
        put(&mut bytes);
        bytes
    };
    vec![
        record(Kind::Hello, [&MAGIC[..], &[1, 0, 0, 0, 0, 0, 0, 0]].concat()),
        record(Kind::Lost, vec![7, 0, 0, 0, 0, 0, 0, 0]),
        answer.encode(),
        record(Kind::Odometry, laid_out(&|to| layout::put_odometry(&odometry(), 5, 1, to))),
        record(Kind::Estimate, laid_out(&|to| layout::put_estimate(&estimate(), 5, to))),
        record(Kind::Configuration, encode(&configuration)),
        record(Kind::FullEstimate, encode(&FullEstimate { estimate: estimate(), frame_ms: 3.5 })),
        record(Kind::MapEstimate, encode(&map)),
        record(Kind::Window, encode(&snapshot)),
        record(Kind::Path, encode(&path)),
        record(Kind::Ladder, encode(&LadderRung { level: 2, name: "no lines".into() })),
        record(Kind::Sensors, encode(&SensorNews::default())),
        record(Kind::Picture, encode(&Picture::from(&shot))),
        record(Kind::End, vec![0; 8]),
        record(Kind::Instant, laid_out(&|to| layout::put_instant(&instant, 5, to))),
        record(Kind::Trail, encode(&trail)),
    ]
}

#[test]
#[ignore = "writes the seeds of the fuzzers"]
fn fuzz_seeds() {
    put("mcap_log", "plain.mcap", &log(false));
    put("mcap_log", "chunks.mcap", &log(true));
    for (k, (channel, payload)) in log_messages().iter().enumerate() {
        put("log_messages", &format!("{k:02}"), &[&[*channel as u8][..], payload].concat());
    }
    put("mavlink", "messages", &mavlink_bytes());
    put("local_requests", "all", &[&[5][..], &local_requests()].concat());
    for (k, record) in local_records().iter().enumerate() {
        put("local_records", &format!("{k:02}"), record);
    }
}
