//! Makes the seeds of the targets of this crate: `cargo nextest run -p plumbline --run-ignored only fuzz_seeds`.

use crate::log::channel::Channel;
use crate::log::{about::About, about::METADATA_NAME, encode, image, proto};
use crate::net::{proto as net, wire};
use crate::pipeline::event::{Event, Severity};
use crate::pipeline::orders::{CorrectionOrder, FrameOrder, MapOrder, MapVerdict, ResetOrder, Verdict};
use mavlink::dialects::common::{HEARTBEAT_DATA, MavMessage, TIMESYNC_DATA};
use mcap::records::{MessageHeader, Metadata};
use nalgebra::{Isometry3, Vector3};
use plumbline_config::options::ImageRecording;
use plumbline_config::{Config, GrayImage, ImuSample, Timestamp};
use plumbline_drivers::{ImuReading, StereoFrame};
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{
    BiasVariances, Estimate, FrameFigures, HealthBits, NavCovariance, Odometry, ResetKind, TrackingState,
};
use prost::Message as _;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

fn put(target: &str, name: &str, bytes: &[u8]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds").join(target);
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join(name), bytes).unwrap();
}

const STAMP: Timestamp = Timestamp::from_nanos(1_403_715_273_262_142_976);

fn odometry() -> Odometry {
    Odometry {
        sequence: 7,
        stamp: STAMP,
        pose_o_b: Isometry3::new(Vector3::new(1.0, -2.0, 0.1), Vector3::new(0.1, 0.2, 1.5)),
        v_o_b: Vector3::new(0.1, 0.2, 0.3),
        angular_rate_b: Vector3::zeros(),
        covariance: NavCovariance::identity(),
        state: TrackingState::Tracking,
        quality: 80,
        reset_counter: 2,
        jumps: 0,
        origin: plumbline_estimator::OriginUncertainty::default(),
    }
}

fn estimate() -> Estimate {
    let Odometry { stamp, pose_o_b, v_o_b, covariance, state, quality, reset_counter, .. } = odometry();
    Estimate {
        frame_sequence: 3,
        stamp,
        state,
        pose_o_b,
        v_o_b,
        bias_gyro: Vector3::x() * 0.01,
        bias_accel: Vector3::y() * 0.02,
        covariance,
        origin: plumbline_estimator::OriginUncertainty::default(),
        bias_variances: BiasVariances::repeat(1e-6),
        time_offset_s: 0.001,
        time_offset_sigma_s: 0.0001,
        pose_b_c0: Isometry3::translation(0.1, 0.0, 0.0),
        quality,
        health: HealthBits(5),
        reset_counter,
        figures: FrameFigures {
            points_tracked: 90,
            keyframes: 7,
            is_keyframe: true,
            ..FrameFigures::default()
        },
    }
}

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
    let event = Event::new(STAMP, Severity::Info, format_args!("tracking"));
    let recording = proto::Recording { imu_dropped: 2, seal: vec![7; 32], ..proto::Recording::default() };
    vec![
        (Channel::Imu, encode::imu(&imu()).encode_to_vec()),
        (Channel::Left, picture(ImageRecording::Png)),
        (Channel::Right, picture(ImageRecording::Raw)),
        (Channel::Frame, image::frame(&frame).encode_to_vec()),
        (Channel::FrameOrder, encode::frame_order(&order).encode_to_vec()),
        (
            Channel::CorrectionOrder,
            encode::correction_order(&CorrectionOrder { frame: 3, readings_before: 9 }).encode_to_vec(),
        ),
        (
            Channel::ResetOrder,
            encode::reset_order(&ResetOrder { kind: ResetKind::Soft, before_frame: 3, is_renewal: true })
                .encode_to_vec(),
        ),
        (Channel::MapOrder, encode::map_order(&map_order).encode_to_vec()),
        (Channel::MapEstimate, encode::map_estimate(&map_estimate).encode_to_vec()),
        (Channel::Estimate, encode::estimate(&estimate()).encode_to_vec()),
        (Channel::Odometry, encode::odometry(&odometry()).encode_to_vec()),
        (Channel::Event, encode::event(&event).encode_to_vec()),
        (Channel::Recording, recording.encode_to_vec()),
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
    let mut metadata = About::new(&Config::preset("sim").unwrap()).unwrap().to_metadata().unwrap();
    metadata.insert("flight".into(), "0123456789abcdef".into());
    writer.write_metadata(&Metadata { name: METADATA_NAME.into(), metadata }).unwrap();
    for (sequence, (channel, payload)) in (0u32..).zip(log_messages()) {
        let id = writer.add_channel(0, channel.topic(), "protobuf", &BTreeMap::new()).unwrap();
        let time_ns = STAMP.as_nanos() as u64;
        let header = MessageHeader { channel_id: id, sequence, log_time: time_ns, publish_time: time_ns };
        writer.write_to_known_channel(&header, &payload).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    file.into_inner()
}

/// A message of every topic, each with its number and its length.
fn network_messages() -> Vec<Vec<u8>> {
    let header = wire::odom(&odometry(), 7, 5).header;
    let pose = wire::pose(&odometry().pose_o_b);
    let jpeg = vec![0xff, 0xd8, 0xff, 0xd9];
    let (points_o, lines_o) = (vec![1.0, 2.0, 3.0], vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    let messages = [
        (0, wire::odom(&odometry(), 7, 5).encode_to_vec()),
        (1, wire::state(&estimate(), 3, 5).encode_to_vec()),
        (
            2,
            net::Health {
                header,
                words: vec!["few points".into()],
                rung_words: "everything".into(),
                frame_rate_hz: 20.0,
                keyframes: 4,
                ..net::Health::default()
            }
            .encode_to_vec(),
        ),
        (
            3,
            net::Keyframe { header, pose, points_o: points_o.clone(), lines_o: lines_o.clone() }
                .encode_to_vec(),
        ),
        (4, net::MapCorrection { header, pose_m_o: pose, ..net::MapCorrection::default() }.encode_to_vec()),
        (5, net::Scene { header, keyframes: pose.into_iter().collect(), points_o, lines_o }.encode_to_vec()),
        (
            6,
            net::Picture { header, jpeg, width_px: 4, height_px: 4, ..net::Picture::default() }
                .encode_to_vec(),
        ),
        (
            7,
            net::MapPath {
                header,
                stamps_ns: vec![1, 2],
                poses_m_b: vec![0.5; 14],
                reset_counters: vec![0, 1],
                loops_ns: vec![1, 2],
                loops_m: vec![0.5; 6],
                drift_m: Some(0.1),
            }
            .encode_to_vec(),
        ),
        (b'c', net::Clock { received_ns: 5, answered_ns: 9 }.encode_to_vec()),
        (
            b't',
            net::Trajectory { stamps_ns: vec![1, 2], poses_o_b: vec![0.5; 14], reset_counters: vec![0, 2] }
                .encode_to_vec(),
        ),
        (b'r', net::ResetDone { words: "done".into(), ..net::ResetDone::default() }.encode_to_vec()),
        (b's', net::MapSaved { keyframes: 7, words: "saved".into() }.encode_to_vec()),
    ];
    let framed = |(topic, payload): &(u8, Vec<u8>)| {
        let length = u16::try_from(payload.len()).unwrap().to_le_bytes();
        [&[*topic][..], &length, payload].concat()
    };
    messages.iter().map(framed).collect()
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

#[test]
#[ignore = "writes the seeds of the fuzzers"]
fn fuzz_seeds() {
    put("mcap_log", "plain.mcap", &log(false));
    put("mcap_log", "chunks.mcap", &log(true));
    for (k, (channel, payload)) in log_messages().iter().enumerate() {
        put("log_messages", &format!("{k:02}"), &[&[*channel as u8][..], payload].concat());
    }
    let messages = network_messages();
    for (k, message) in messages.iter().enumerate() {
        put("network_messages", &format!("{k:02}"), message);
    }
    put("network_messages", "all", &messages.concat());
    put("network_messages", "twice", &[messages.concat(), messages.concat()].concat());
    put("mavlink", "messages", &mavlink_bytes());
    put("web_socket", "watch", br#"{"type":"watch","camera":["drone","other"]}"#);
    put("web_socket", "reset", br#"{"kind":"soft"}"#);
    put("web_socket", "record", br#"{"on":true}"#);
    put("web_socket", "host", b"localhost:8080");
    put("web_socket", "file", b"trajectory.tum");
}
