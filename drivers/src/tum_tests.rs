//! Tests of the TUM format: exact times, what people's tools write, and what must be refused.

use super::*;
use flate2::{Compression, write::GzEncoder};
use plumbline_test_support::shared;
use proptest::prelude::*;

fn nanos(text: &str) -> Option<i64> {
    parse_seconds(text).map(Timestamp::as_nanos)
}

#[test]
fn times_are_read_to_the_nanosecond() {
    assert_eq!(nanos("1403715273.262142976"), Some(1_403_715_273_262_142_976));
    assert_eq!(nanos("1403715273.26214"), Some(1_403_715_273_262_140_000));
    assert_eq!(nanos("1.403638538577829e+09"), Some(1_403_638_538_577_829_000));
    assert_eq!(nanos("1.403638538577829376E9"), Some(1_403_638_538_577_829_376));
    assert_eq!(nanos("12"), Some(12_000_000_000));
    assert_eq!(nanos("-0.000000005"), Some(-5));
    assert_eq!(nanos(".5"), Some(500_000_000));
    assert_eq!(nanos("0.0000000006"), Some(1));
    assert_eq!(nanos("0e999999"), Some(0));
    assert_eq!(nanos("1e-400"), Some(0));
}

#[test]
fn what_is_no_time_is_refused() {
    for text in
        ["", ".", "-", "e9", "nan", "inf", "1e", "1.2.3", "1e400", "99999999999999", "1_0", "0x1", "140/7"]
    {
        assert_eq!(nanos(text), None, "{text}");
    }
}

fn read_text(bytes: &[u8]) -> Result<Vec<StampedPose>, DriverError> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tum");
    std::fs::write(&path, bytes).unwrap();
    read_tum(&path)
}

#[test]
fn comments_blanks_tabs_and_windows_line_ends_are_read() {
    let poses = read_text(b"# t x y z\r\n\r\n1.5 1 2 3 0 0 0 1\r\n2.5\t1e0 2 3  0 0 0 -1 ").unwrap();
    assert_eq!(poses.len(), 2);
    assert_eq!(poses[0].stamp.as_nanos(), 1_500_000_000);
    assert_eq!(poses[1].pose.translation.y, 2.0);
}

#[test]
fn errors_name_the_line() {
    let cases: [(&[u8], &str); 8] = [
        (b"1 0 0 0 0 0 0 1\n2 0 0 0 0 0 1\n", "line 2: fewer than 8 columns"),
        (b"1 0 0 0 0 0 0 1 7\n", "line 1: more than 8"),
        (b"1 nan 0 0 0 0 0 1\n", "line 1: a column is not finite"),
        (b"1 0 0 0 0 0 0 0\n", "line 1: the quaternion"),
        (b"x 0 0 0 0 0 0 1\n", "line 1: the time"),
        (b"1 0 0 zero 0 0 0 1\n", "line 1: a column is not a number"),
        (b"\xff\xfe\n", "line 1: not text"),
        (b"# nothing\n", "holds no pose"),
    ];
    for (bytes, expected) in cases {
        let message = read_text(bytes).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
        assert!(!message.contains('\n'));
    }
}

#[test]
fn gzip_is_known_by_its_first_bytes() {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(b"1 1 2 3 0 0 0 1\n").unwrap();
    let packed = encoder.finish().unwrap();
    assert_eq!(read_text(&packed).unwrap().len(), 1);
    assert!(matches!(read_text(&packed[..packed.len() - 9]), Err(DriverError::Io { .. })));
}

#[test]
fn all_ground_truth_trajectories_read() {
    let Some(folder) = shared("euroc/trajectories") else { return };
    let mut files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let poses = read_tum(&entry.unwrap().path()).unwrap();
        assert!(poses.len() > 1000);
        assert!(poses.windows(2).all(|pair| pair[0].stamp < pair[1].stamp));
        files += 1;
    }
    assert_eq!(files, 11);
}

proptest! {
    #[test]
    fn writing_and_reading_keeps_the_stamp(
        t in any::<i64>(),
        p in prop::array::uniform3(-1e4..1e4),
        r in prop::array::uniform3(-3.0..3.0),
    ) {
        let rotation = UnitQuaternion::from_scaled_axis(r.into());
        let pose = Isometry3::from_parts(Translation3::new(p[0], p[1], p[2]), rotation);
        let item = StampedPose { stamp: Timestamp::from_nanos(t), pose };
        let mut text = Vec::new();
        write_pose(&mut text, &item).unwrap();
        let back = parse_pose(std::str::from_utf8(&text).unwrap().trim()).unwrap();
        prop_assert_eq!(back.stamp, item.stamp);
        prop_assert!((back.pose.translation.vector - item.pose.translation.vector).norm() < 2e-9);
        prop_assert!(back.pose.rotation.angle_to(&rotation) < 1e-8);
    }
}

#[test]
fn a_gzip_of_more_poses_than_any_flight_has_is_refused() {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    // Comments count as well, and are read quickly.
    let lines = format!("1 0 0 0 0 0 0 1\n{}", "#\n".repeat(1 << 17));
    for _ in 0..70 {
        encoder.write_all(lines.as_bytes()).unwrap();
    }
    let bytes = encoder.finish().unwrap();
    assert!(bytes.len() < 1 << 20);
    let error = read_tum_from(Path::new("bomb.tum.gz"), &bytes[..]).unwrap_err().to_string();
    assert!(error.contains("more than 4000000 poses"), "{error}");
}

#[test]
fn positions_beyond_all_measure_are_refused() {
    let error = read_tum_from(Path::new("far.tum"), &b"1 1e308 0 0 0 0 0 1\n"[..]).unwrap_err().to_string();
    assert!(error.contains("line 1: the position is further away"), "{error}");
}
