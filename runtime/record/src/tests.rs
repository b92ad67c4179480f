//! The tables, and what is made of them.

use crate::columns;
use crate::digest::Digest;
use crate::fields::{Parts, Record, Shape, Value};
use crate::layout;
use crate::messages::{Picture, SensorNews};
use crate::orders::{InstantAnswer, InstantOrder, InstantOutcome, InstantSource};
use crate::parts::{FrameAbout, ImageAbout, RecordingState};
use crate::protobuf::{decode, encode};
use crate::said::FullEstimate;
use crate::schema;
use crate::{CorrectionOrder, FrameOrder, MapOrder, ResetOrder};
use nalgebra::{Isometry3, Vector3};
use plumbline_config::Timestamp;
use plumbline_estimator::places::mapper::path::{LoopEnd, LoopEnds, PathPose};
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_estimator::window::snapshot::{SnapshotKeyframe, SnapshotLine, SnapshotPoint};
use plumbline_estimator::{Estimate, FrameFigures, MapSnapshot, Odometry, TrackingState};
use plumbline_fields::ImuReading;
use prost::Message as _;
use prost_types::{FieldDescriptorProto, FileDescriptorSet};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

#[path = "../../../fuzz/fixture.rs"]
#[allow(dead_code)]
mod fixture;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Checks the numbers of a table: each field has its own, and places in the digest have no gap either.
fn check_table<T: Record>() {
    let places = |of: &dyn Fn(&crate::fields::About) -> u32| -> Vec<u32> {
        let all: BTreeSet<u32> = T::FIELDS.iter().map(|field| of(&field.about)).filter(|k| *k > 0).collect();
        all.into_iter().collect()
    };
    let is_whole = |places: &[u32]| places.iter().zip(1..).all(|(place, expected)| *place == expected);
    let tags = places(&|about| about.tag);
    assert_eq!(tags.len(), T::FIELDS.len(), "{}: {tags:?}", T::NAME);
    let digest = places(&|about| about.digest.into());
    let digested = T::FIELDS.iter().filter(|field| field.about.digest > 0).count();
    assert!(digest.len() == digested && is_whole(&digest), "{}: {digest:?}", T::NAME);
}

#[test]
fn numbers_of_fields_have_no_double_and_places_in_the_digest_no_gap() {
    check_table::<ImuReading>();
    check_table::<ImageAbout>();
    check_table::<FrameAbout>();
    check_table::<FrameOrder>();
    check_table::<CorrectionOrder>();
    check_table::<ResetOrder>();
    check_table::<MapOrder>();
    check_table::<InstantOrder>();
    check_table::<InstantAnswer>();
    check_table::<FrameFigures>();
    check_table::<Estimate>();
    check_table::<FullEstimate>();
    check_table::<Odometry>();
    check_table::<MapEstimate>();
    check_table::<RecordingState>();
}

/// Messages of logs from before the tables wrote them are among the fuzzers' seeds.
#[test]
fn messages_of_earlier_builds_come_back_byte_for_byte() {
    fn again<T: Record>(bytes: &[u8]) -> Vec<u8> {
        encode(&decode::<T>(bytes).unwrap())
    }
    let mut read = 0;
    for entry in std::fs::read_dir(repository().join("fuzz/seeds/log_messages")).unwrap() {
        let path = entry.unwrap().path();
        if !path.file_name().unwrap().to_string_lossy().starts_with("earlier-") {
            continue;
        }
        let seed = std::fs::read(&path).unwrap();
        let Some((channel, bytes)) = seed.split_first() else { continue };
        // The numbers of the log's channels.
        let back = match channel {
            0 => again::<ImuReading>(bytes),
            3 => again::<FrameAbout>(bytes),
            4 => again::<FrameOrder>(bytes),
            5 => again::<CorrectionOrder>(bytes),
            6 => again::<ResetOrder>(bytes),
            7 => again::<MapOrder>(bytes),
            8 => again::<Estimate>(bytes),
            9 => again::<MapEstimate>(bytes),
            10 => again::<Odometry>(bytes),
            14 => again::<RecordingState>(bytes),
            _ => panic!("channel {channel} has no table"),
        };
        assert_eq!(back, bytes, "{}", path.display());
        read += 1;
    }
    assert_eq!(read, 18);
}

#[test]
fn a_state_at_an_instant_comes_back_from_log_and_socket() {
    let odometry = fixture::odometry();
    for (source, outcome) in [
        (InstantSource::Request, InstantOutcome::Answered),
        (InstantSource::Trigger, InstantOutcome::Ahead),
        (InstantSource::List, InstantOutcome::NoPose),
    ] {
        let instant = plumbline_estimator::Instant {
            stamp: odometry.stamp,
            pose_o_b: odometry.pose_o_b,
            v_o_b: odometry.v_o_b,
            angular_rate_b: odometry.angular_rate_b,
            covariance: odometry.covariance + odometry.covariance.transpose(),
            state: odometry.state,
            quality: -1,
            reset_counter: 7,
            estimated: odometry.stamp.plus_nanos(-3),
            is_settled: outcome == InstantOutcome::Answered,
        };
        let answer = InstantAnswer { sequence: 4, number: 9, source, outcome, instant };
        // The order has the source.
        let logged = InstantAnswer { source: InstantSource::Request, ..answer.clone() };
        assert_eq!(decode(&encode(&answer)), Ok(logged));
        let mut bytes = Vec::new();
        layout::put_instant(&answer, 11, &mut bytes);
        assert_eq!(bytes.len(), layout::INSTANT_BYTES);
        // The number on a socket is the order's; the header has the sequence.
        assert_eq!(layout::instant(&bytes), Ok((InstantAnswer { sequence: 0, ..answer }, 11)));
        assert!(layout::instant(&bytes[..511]).is_err());
        bytes[504] = 3;
        assert!(layout::instant(&bytes).is_err());
    }
}

#[test]
fn what_is_missing_in_a_message_is_refused() {
    let refused = |without: u32| {
        let estimate = fixture::estimate();
        let tags = (1..=Estimate::FIELDS.len() as u32).filter(|tag| *tag != without);
        decode::<Estimate>(&tags.flat_map(|tag| only(tag, &estimate)).collect::<Vec<_>>())
    };
    assert_eq!(refused(0), Ok(fixture::estimate()));
    assert_eq!(refused(3), Err("an unknown state"));
    assert_eq!(refused(4), Err("a pose has not seven numbers"));
    assert_eq!(refused(8), Err("a covariance has not 81 numbers"));
    assert_eq!(refused(14), Err("a part is missing"));
    // None in logs from before there were any.
    assert_eq!(refused(15).unwrap().bias_variances, plumbline_estimator::BiasVariances::zeros());
    assert_eq!(decode::<Odometry>(&[0xff; 3]), Err("not a message of its schema"));
}

/// The bytes of field `tag` in the message of `estimate`.
fn only(tag: u32, estimate: &Estimate) -> Vec<u8> {
    let (bytes, mut found) = (encode(estimate), Vec::new());
    let mut all = bytes.as_slice();
    while !all.is_empty() {
        let before = all;
        let (number, wire) = prost::encoding::decode_key(&mut all).unwrap();
        prost::encoding::skip_field(wire, number, &mut all, Default::default()).unwrap();
        if number == tag {
            found = before[..before.len() - all.len()].to_vec();
        }
    }
    found
}

#[test]
fn every_field_of_the_digest_changes_it() {
    let digest = |estimate: &Estimate| {
        let mut digest = Digest::default();
        digest.add(estimate);
        digest.hex()
    };
    let (was, mut left_out) = (fixture::estimate(), Vec::new());
    for field in Estimate::FIELDS {
        let mut changed = was.clone();
        match (field.get)(&was) {
            Value::Whole(number) => (field.set)(&mut changed, Value::Whole(number - 1)).unwrap(),
            Value::Floats([first, second]) => {
                let mut numbers: Vec<f64> = first.iter().chain(second).copied().collect();
                numbers[0] += 1.0;
                (field.set)(&mut changed, Value::floats(&numbers)).unwrap();
            }
            _ => changed.figures.iterations += 1,
        }
        assert_ne!(changed, was, "{}", field.about.name);
        if digest(&changed) == digest(&was) {
            left_out.push(field.about.name);
        }
    }
    assert_eq!(left_out, ["figures", "bias_variances"]);
}

#[test]
fn an_estimate_has_its_fields_where_its_document_has_them() {
    let sent = fixture::estimate();
    let mut bytes = Vec::new();
    layout::put_estimate(&sent, 9, &mut bytes);
    assert_eq!(bytes.len(), layout::ESTIMATE_BYTES);
    assert_eq!(bytes[8..16], 9i64.to_le_bytes());
    assert_eq!(bytes[16..24], sent.frame_sequence.to_le_bytes());
    assert_eq!(bytes[80..88], sent.v_o_b.x.to_le_bytes());
    assert_eq!(bytes[512..520], sent.time_offset_s.to_le_bytes());
    assert_eq!(bytes[524..528], sent.reset_counter.to_le_bytes());
    let state = [sent.state as u8, sent.quality.to_le_bytes()[0], 1, 0, 0, 0, 0, 0];
    assert_eq!(bytes[528..], state);
}

#[test]
fn fields_of_a_layout_do_not_overlap() {
    fn spans(record: &dyn Parts, to: &mut Vec<(usize, usize)>) {
        record.visit(&mut |about, value| match (about.at, about.shape, value) {
            (_, _, Value::Part(part)) => spans(part, to),
            (Some(at), Shape::Covariance, _) => to.push((at, 45 * 8)),
            (Some(at), _, Value::Floats([_, second])) if second.len() == 1 => to.push((at, 8)),
            (Some(at), _, Value::Floats([first, second])) => to.push((at, 8 * (first.len() + second.len()))),
            (Some(at), Shape::Uint64 | Shape::Int64, _) => to.push((at, 8)),
            (Some(at), Shape::Uint32, _) => to.push((at, 4)),
            (Some(at), ..) => to.push((at, 1)),
            (None, ..) => {}
        });
    }
    let mut of = (vec![(8, 8)], vec![(8, 8), (488, 4)]);
    spans(&fixture::estimate(), &mut of.0);
    spans(&fixture::odometry(), &mut of.1);
    for mut spans in [of.0, of.1] {
        spans.sort_unstable();
        assert!(spans.windows(2).all(|pair| pair[0].0 + pair[0].1 <= pair[1].0), "{spans:?}");
    }
}

/// An estimate whose numbers are all different.
fn row(seed: f64) -> Estimate {
    let mut estimate = fixture::estimate();
    let mut next = seed;
    let mut number = || {
        next += 0.37;
        (next * 1.7).fract() + 0.1 * next.fract()
    };
    estimate.v_o_b.iter_mut().for_each(|x| *x = number());
    estimate.bias_gyro.iter_mut().for_each(|x| *x = 1e-3 * number());
    estimate.bias_variances.iter_mut().for_each(|x| *x = 1e-6 * number());
    for row in 0..9 {
        for column in row..9 {
            let value = number();
            (estimate.covariance[(row, column)], estimate.covariance[(column, row)]) = (value, value);
        }
    }
    estimate.health = plumbline_estimator::HealthBits(0);
    estimate
}

#[test]
fn cells_stand_below_their_names_bit_for_bit_and_a_frame_without_a_pose_has_empty_ones() {
    let cells = |estimate: &Estimate| {
        let mut line = String::new();
        columns::write_row(&mut line, estimate);
        let cells = line.split(',').map(str::to_owned);
        columns::names().into_iter().zip(cells).collect::<std::collections::BTreeMap<_, _>>()
    };
    for seed in [0.1, -700.0, 1e3] {
        let estimate = row(seed);
        let blind = cells(&Estimate { state: TrackingState::Blind, ..estimate.clone() });
        assert_eq!(blind["tracking"], "blind");
        for (name, value) in [
            ("v_o_b_y_m_s", estimate.v_o_b.y),
            ("bias_gyro_z_rad_s", estimate.bias_gyro.z),
            ("var_theta_x_rad2", estimate.covariance[(3, 3)]),
            ("cov_p_x_theta_z_m_rad", estimate.covariance[(0, 5)]),
        ] {
            assert_eq!(blind[name].parse(), Ok(value), "{name}");
        }
        let none = cells(&Estimate { state: TrackingState::Failed, quality: -1, ..estimate });
        assert_eq!((none["quality"].as_str(), none["v_o_b_y_m_s"].as_str()), ("-1", ""));
    }
}

/// Programs that read logs know these messages by their bytes; later ones come after them.
#[test]
fn the_schema_in_logs_begins_as_that_of_earlier_builds() {
    let mut set = FileDescriptorSet::decode(&*schema::descriptors()).unwrap();
    set.file[0].message_type.truncate(12);
    // The last of them has a count more since then.
    assert_eq!(set.file[0].message_type[11].field.pop().unwrap().name(), "instants_dropped");
    // Figures have gone since then; nothing else has their numbers.
    let figures = set.file[0].message_type.iter_mut().find(|message| message.name() == "Figures").unwrap();
    for (before, number, name, json) in [
        ("lines_kept", 6, "lines_merged", "linesMerged"),
        ("lines_in_window", 13, "lines_in_structure", "linesInStructure"),
    ] {
        assert!(figures.field.iter().all(|field| field.number() != number));
        let at = 1 + figures.field.iter().position(|field| field.name() == before).unwrap();
        let gone = FieldDescriptorProto {
            name: Some(name.into()),
            json_name: Some(json.into()),
            number: Some(number),
            ..figures.field[at - 1].clone()
        };
        figures.field.insert(at, gone);
    }
    let hash = crate::digest::hash_of_bytes(&set.encode_to_vec());
    assert_eq!(hash, "867ccf0743c615f774ea43909faa3c82b4ebae064097114b7f6ebb83779c88de");
}

#[test]
fn lists_of_records_come_back_as_they_were() {
    let stamp = Timestamp::from_nanos(1_403_715_273_262_142_976);
    let window = MapSnapshot {
        stamp,
        reset_counter: 2,
        keyframes: vec![SnapshotKeyframe { stamp, pose_o_b: Isometry3::translation(0.1, 2.0, 3.0) }; 2],
        points: vec![SnapshotPoint { host: stamp, p_o: Vector3::x() }],
        lines: vec![SnapshotLine { host: stamp, ends_o: [Vector3::y(), Vector3::z()] }],
    };
    assert_eq!(decode(&encode(&window)), Ok(window));
    let end = |x: f64| LoopEnd { stamp, p_m_b: Vector3::new(x, 0.0, 0.0) };
    let mut path = MapPath::new(0);
    path.poses.push(PathPose { stamp, reset_counter: 1, pose_m_b: Isometry3::identity() });
    path.loops.push(LoopEnds { seen: end(1.0), seen_by: end(2.0) });
    path.drift_m = Some(0.5);
    assert_eq!(decode(&encode(&path)), Ok(path));
    let picture = Picture { points: vec![[1.0, 2.5, 3.0]; 2], lines: vec![[0.5; 4]], ..Picture::default() };
    assert_eq!(decode(&encode(&picture)), Ok(picture));
    let news = SensorNews { notices: vec!["one".into(), String::new()], ..SensorNews::default() };
    assert_eq!(decode(&encode(&news)), Ok(news));
    // Its numbers have a gap.
    let figures = FrameFigures { is_keyframe: true, ..FrameFigures::default() };
    assert_eq!(decode(&encode(&figures)), Ok(figures));
}

#[test]
fn numbers_that_are_cut_short_and_texts_that_are_none_are_refused() {
    let of = |tag: u8, content: &[u8]| [&[tag << 3 | 2, content.len() as u8][..], content].concat();
    assert!(decode::<Picture>(&of(6, &[0; 12])).is_ok());
    for content in [&[0; 11][..], &[0; 16]] {
        assert!(decode::<Picture>(&of(6, content)).is_err());
    }
    assert!(decode::<SnapshotPoint>(&of(2, &[0; 8])).is_err(), "two numbers are no place");
    assert_eq!(decode::<SensorNews>(&of(1, &[]).repeat(300)), Err("a list is too long"));
    assert_eq!(decode::<SensorNews>(&of(1, &[0xff])), Err("a text is not UTF-8"));
    let point = encode(&SnapshotPoint { host: Timestamp::default(), p_o: Vector3::zeros() });
    let endless = of(4, &point).repeat(70_000);
    assert_eq!(decode::<MapSnapshot>(&endless), Err("a list is too long"));
}
