//! Reads messages from the network: whatever is malformed, too large or not finite is refused.

use super::picture::jpeg_size;
use nalgebra::{Quaternion, Vector4};
use plumbline_record::fields::{About, Parts, Record, Shape, Value};
use plumbline_record::messages::{Clock, Envelope, Picture};
use plumbline_record::protobuf;

/// The longest message that is looked at, bytes.
pub const MAX_MESSAGE_BYTES: usize = 256 * 1024;
/// Most numbers in a list, and most items, where the field has no bound of its own.
const MAX_NUMBERS: usize = 32 * 1024;
/// Largest side of a picture, px.
const MAX_SIDE_PX: u32 = 4_096;
/// Longest text, bytes, where the field has no bound of its own.
const MAX_TEXT: usize = 512;
/// Longest text of a configuration, bytes.
const MAX_TOML: usize = MAX_MESSAGE_BYTES;
/// Largest number of single precision that is accepted: coordinates of landmarks, m or px.
const MAX_PLACE: f64 = 1e6;
/// Deviation of a quaternion's length from 1, at most.
const NORM_TOLERANCE: f64 = 1e-3;

/// Message of a key with its envelope.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heard<T> {
    /// The envelope, emptied.
    pub envelope: Envelope,
    /// The message.
    pub message: T,
}

/// Reads a message in its envelope; `None` for what is too long, malformed or not a number.
pub fn heard<T: Record>(payload: &[u8]) -> Option<Heard<T>> {
    // What has not been published is no envelope: of no bytes at all others would make a message.
    let mut envelope = decode::<Envelope>(payload).filter(|envelope| envelope.published_ns > 0)?;
    let message = decode::<T>(&std::mem::take(&mut envelope.message))?;
    Some(Heard { envelope, message })
}

/// Reads a message without an envelope, as the answer to a question; `None` for what is too long, malformed or not a number.
pub fn decode<T: Record>(payload: &[u8]) -> Option<T> {
    if payload.len() > MAX_MESSAGE_BYTES {
        return None;
    }
    protobuf::decode::<T>(payload).ok().filter(|record| is_sound(record))
}

/// True if all numbers of a record are finite, its rotations are such, and its lists and texts within bounds.
pub fn is_sound(record: &dyn Parts) -> bool {
    let mut is_so = true;
    record.visit(&mut |about, value| is_so &= is_sound_value(about, value));
    is_so
}

fn is_sound_value(about: &About, value: Value<'_>) -> bool {
    let most = |otherwise: usize| if about.most > 0 { about.most } else { otherwise };
    let is_believable = |x: f64| x.is_finite() && (about.shape != Shape::Singles || x.abs() <= MAX_PLACE);
    match value {
        Value::Floats([first, second]) => {
            let is_rotation =
                |q: &[f64; 4]| (Quaternion::from(Vector4::from(*q)).norm() - 1.0).abs() < NORM_TOLERANCE;
            first.iter().chain(second).all(|x| is_believable(*x))
                && <&[f64; 4]>::try_from(second).map_or(true, is_rotation)
        }
        Value::Singles(numbers) => {
            numbers.len() <= most(MAX_NUMBERS) && numbers.iter().all(|x| is_believable(f64::from(*x)))
        }
        Value::Text(text) => text.len() <= if about.wire == "toml" { MAX_TOML } else { most(MAX_TEXT) },
        Value::Items(items) => {
            items.count() <= most(MAX_NUMBERS)
                && (0..items.count()).all(|at| match items.item(at) {
                    Value::Part(part) => is_sound(part),
                    Value::Text(text) => text.len() <= MAX_TEXT,
                    _ => true,
                })
        }
        Value::Part(part) => is_sound(part),
        Value::Whole(_) | Value::Bytes(_) | Value::Missing => true,
    }
}

/// Reads a picture, whose JPEG has the size that it says: the browser decodes the rest, and makes room for the size that the JPEG
/// itself says.
pub fn picture(payload: &[u8]) -> Option<Heard<Picture>> {
    let sides = 1..=MAX_SIDE_PX;
    heard::<Picture>(payload).filter(|Heard { message: m, .. }| {
        sides.contains(&m.width_px)
            && sides.contains(&m.height_px)
            && jpeg_size(&m.jpeg) == Some((m.width_px, m.height_px))
    })
}

/// Reads an answer about the clock.
pub fn clock(payload: &[u8]) -> Option<Clock> {
    decode::<Clock>(payload).filter(|clock| clock.received_ns > 0 && clock.answered_ns >= clock.received_ns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};
    use plumbline_config::Timestamp;
    use plumbline_estimator::places::mapper::path::{LoopEnd, LoopEnds, PathPose};
    use plumbline_estimator::places::{MapEstimate, MapPath};
    use plumbline_estimator::window::snapshot::{SnapshotKeyframe, SnapshotPoint};
    use plumbline_estimator::{MapSnapshot, NavCovariance, Odometry, TrackingState};
    use plumbline_record::messages::{Health, SensorNews};
    use plumbline_record::protobuf::{encode, encode_brief};
    use plumbline_record::said::FullEstimate;

    const STAMP: Timestamp = Timestamp::from_nanos(1_403_715_273_262_142_976);

    fn odometry() -> Odometry {
        Odometry {
            sequence: 7,
            stamp: STAMP,
            pose_o_b: Isometry3::from_parts(
                Vector3::new(1.0, -2.0, 0.1).into(),
                UnitQuaternion::from_euler_angles(0.1, 0.2, 3.0),
            ),
            v_o_b: Vector3::new(0.1, 0.2, 0.3),
            covariance: NavCovariance::identity(),
            state: TrackingState::Tracking,
            quality: 80,
            reset_counter: 2,
            ..Odometry::default()
        }
    }

    fn sent(record: &dyn Parts, message: Vec<u8>) -> Vec<u8> {
        encode(&Envelope::around(record, message, 9, 5))
    }

    #[test]
    fn odometry_comes_over_the_network_bit_for_bit_with_the_diagonal_of_its_covariance() {
        let odometry = odometry();
        let brief = encode_brief(&odometry);
        assert!(brief.len() < 330, "{}", brief.len());
        let Heard { envelope, message } = heard::<Odometry>(&sent(&odometry, brief)).unwrap();
        assert_eq!(message, odometry);
        assert_eq!((envelope.stamp_ns, envelope.sequence), (STAMP.as_nanos(), 9));
        assert_eq!((envelope.reset_counter, envelope.quality, envelope.published_ns), (2, 80, 5));
    }

    #[test]
    fn an_estimate_is_relayed_byte_by_byte() {
        let estimate = plumbline_estimator::Estimate { stamp: STAMP, quality: 60, ..Default::default() };
        let full = FullEstimate { estimate, frame_ms: 3.5 };
        let message = encode(&full);
        let Heard { envelope, message: back } = heard::<FullEstimate>(&sent(&full, message.clone())).unwrap();
        assert_eq!((envelope.stamp_ns, envelope.quality), (STAMP.as_nanos(), 60), "of the record inside");
        assert_eq!((encode(&back), back), (message, full));
    }

    #[test]
    fn what_is_not_a_number_is_refused() {
        let mut wrong = odometry();
        wrong.v_o_b.x = f64::NAN;
        assert!(heard::<Odometry>(&sent(&wrong, encode(&wrong))).is_none());
        let mut wrong = odometry();
        wrong.pose_o_b.rotation = UnitQuaternion::new_unchecked(Quaternion::new(2.0, 0.0, 0.0, 0.0));
        assert!(heard::<Odometry>(&sent(&wrong, encode(&wrong))).is_none());
        assert!(heard::<Odometry>(&[]).is_none());
        assert!(heard::<Odometry>(&vec![0; MAX_MESSAGE_BYTES + 1]).is_none());
    }

    #[test]
    fn landmarks_are_believable_and_not_too_many() {
        let window = |points: usize, x: f64, keyframes: usize| MapSnapshot {
            keyframes: vec![SnapshotKeyframe { stamp: STAMP, pose_o_b: Isometry3::identity() }; keyframes],
            points: vec![SnapshotPoint { host: STAMP, p_o: Vector3::new(x, 0.0, 0.0) }; points],
            ..MapSnapshot::default()
        };
        assert!(is_sound(&window(3, 1.0, 64)));
        assert!(!is_sound(&window(1, f64::INFINITY, 1)) && !is_sound(&window(1, 1e7, 1)));
        assert!(!is_sound(&window(10_001, 0.0, 0)) && !is_sound(&window(0, 0.0, 65)));
    }

    #[test]
    fn a_path_is_bounded_and_a_place_in_the_map_may_be_unknown() {
        assert!(is_sound(&MapEstimate::default()));
        let end = LoopEnd { stamp: STAMP, p_m_b: Vector3::zeros() };
        let at = PathPose { stamp: STAMP, reset_counter: 0, pose_m_b: Isometry3::identity() };
        let path = |poses: usize, loops: usize, drift_m| {
            let mut path = MapPath::new(0);
            path.poses = vec![at; poses];
            path.loops = vec![LoopEnds { seen: end, seen_by: end }; loops];
            path.drift_m = drift_m;
            path
        };
        assert!(is_sound(&path(0, 0, None)) && is_sound(&path(2_000, 2_000, Some(0.5))));
        assert!(!is_sound(&path(2_001, 0, None)) && !is_sound(&path(0, 2_001, None)));
        assert!(!is_sound(&path(1, 0, Some(f64::NAN))));
        assert!(encode(&path(2_000, 2_000, None)).len() < MAX_MESSAGE_BYTES);
    }

    #[test]
    fn a_mounting_is_a_rotation_or_missing_and_notices_are_few_and_short() {
        let mounted = |rot_v_b| Health { rot_v_b, ..Health::default() };
        assert!(is_sound(&mounted(None)) && is_sound(&mounted(Some(UnitQuaternion::identity()))));
        let none = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 0.0, 0.0, 0.0));
        assert!(!is_sound(&mounted(Some(none))));
        let noticed = |count: usize, length: usize| Health {
            sensors: SensorNews { notices: vec!["x".repeat(length); count], ..SensorNews::default() },
            ..Health::default()
        };
        assert!(is_sound(&noticed(16, 512)));
        assert!(!is_sound(&noticed(17, 1)) && !is_sound(&noticed(1, 513)));
    }

    #[test]
    fn what_is_no_jpeg_is_no_picture() {
        let is_picture = |jpeg: Vec<u8>, width_px| {
            let message = Picture { jpeg, width_px, height_px: 240, ..Picture::default() };
            picture(&sent(&message, encode(&message))).is_some()
        };
        let head = |width: u16| {
            [&[0xff, 0xd8, 0xff, 0xc0, 0, 11, 8, 0, 240][..], &width.to_be_bytes(), &[1, 1, 0x11, 0]].concat()
        };
        assert!(is_picture(head(376), 376));
        assert!(!is_picture(head(377), 376) && !is_picture(head(8000), 8000));
        assert!(!is_picture(b"<svg>".to_vec(), 376) && !is_picture(vec![0xff, 0xd8], 1 << 20));
    }
}
