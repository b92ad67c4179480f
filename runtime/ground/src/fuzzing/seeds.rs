//! Makes the seeds of the targets of this crate: `cargo nextest run -p plumbline-ground --run-ignored only fuzz_seeds`.

use super::super::test_messages::window;
use super::fixture::{estimate, odometry, put};
use super::seed_number;
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_estimator::places::mapper::path::{LoopEnd, LoopEnds, PathPose};
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_record::fields::Parts;
use plumbline_record::messages::{
    Clock, Envelope, Health, LadderRung, MapSaved, PastPose, PastTrajectory, Picture, ResetDone,
};
use plumbline_record::protobuf::{encode, encode_brief};
use plumbline_record::said::FullEstimate;
use plumbline_record::topics::Topic;

/// A message of a key, in its envelope.
fn sent(topic: Topic, record: &dyn Parts) -> (u8, Vec<u8>) {
    let message = if topic == Topic::Odometry { encode_brief(record) } else { encode(record) };
    (seed_number(topic), encode(&Envelope::around(record, message, 7, 5)))
}

/// A message of every topic, each with its number and its length.
fn network_messages() -> Vec<Vec<u8>> {
    // A header alone, of the size that the message says.
    let jpeg = vec![0xff, 0xd8, 0xff, 0xc0, 0, 11, 8, 0, 4, 0, 4, 1, 1, 0x11, 0, 0xff, 0xd9];
    let stamp = Timestamp::from_nanos(1);
    let end = LoopEnd { stamp, p_m_b: Vector3::x() };
    let mut path = MapPath::new(0);
    path.poses = vec![PathPose { stamp, reset_counter: 0, pose_m_b: Isometry3::identity() }; 2];
    path.loops = vec![LoopEnds { seen: end, seen_by: end }];
    path.drift_m = Some(0.1);
    let past = PastPose { stamp, pose_o_b: Isometry3::identity(), reset_counter: 0 };
    let ladder = LadderRung { level: 0, name: "full".into() };
    let messages = [
        sent(Topic::Odometry, &odometry()),
        sent(Topic::FullEstimate, &FullEstimate { estimate: estimate(), frame_ms: 3.5 }),
        sent(
            Topic::Health,
            &Health { ladder, frame_rate_hz: 20.0, keyframes: 4, paths: 8, ..Health::default() },
        ),
        sent(Topic::Keyframe, &window(1, odometry().reset_counter, 1)),
        sent(
            Topic::MapEstimate,
            &MapEstimate { pose_m_o: Some(Isometry3::identity()), ..MapEstimate::default() },
        ),
        sent(Topic::Window, &window(2, odometry().reset_counter, 3)),
        sent(Topic::Picture, &Picture { jpeg, width_px: 4, height_px: 4, ..Picture::default() }),
        sent(Topic::Path, &path),
        (b'c', encode(&Clock { received_ns: 5, answered_ns: 9 })),
        (b't', encode(&PastTrajectory { poses: vec![past; 2] })),
        (b'r', encode(&ResetDone { words: "done".into(), ..ResetDone::default() })),
        (b's', encode(&MapSaved { keyframes: 7, words: "saved".into() })),
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
    put("web_socket", "host", b"localhost:8080");
}
