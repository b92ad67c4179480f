//! Makes the seeds of the targets of this crate: `cargo nextest run -p plumbline-ground --run-ignored only fuzz_seeds`.

use super::fixture::{estimate, odometry, put};
use plumbline_link::net::{proto as net, wire};
use prost::Message as _;

/// A message of every topic, each with its number and its length.
fn network_messages() -> Vec<Vec<u8>> {
    let header = wire::odom(&odometry(), 7, 5).header;
    let pose = wire::pose(&odometry().pose_o_b);
    // A header alone, of the size that the message says.
    let jpeg = vec![0xff, 0xd8, 0xff, 0xc0, 0, 11, 8, 0, 4, 0, 4, 1, 1, 0x11, 0, 0xff, 0xd9];
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

#[test]
#[ignore = "writes the seeds of the fuzzers"]
fn fuzz_seeds() {
    let messages = network_messages();
    for (k, message) in messages.iter().enumerate() {
        put("network_messages", &format!("{k:02}"), message);
    }
    put("network_messages", "all", &messages.concat());
    put("network_messages", "twice", &[messages.concat(), messages.concat()].concat());
    put("web_socket", "watch", br#"{"type":"watch","camera":["drone","other"]}"#);
    put("web_socket", "reset", br#"{"kind":"soft"}"#);
    put("web_socket", "record", br#"{"on":true}"#);
    put("web_socket", "host", b"localhost:8080");
    put("web_socket", "file", b"trajectory.tum");
}
