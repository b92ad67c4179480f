//! Decodes and validates messages from the network: whatever is malformed, too large or not finite is refused.

use super::picture::jpeg_size;
use super::proto;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_estimator::HealthBits;
use prost::Message;

/// The longest message that is looked at, bytes.
pub const MAX_MESSAGE_BYTES: usize = 256 * 1024;
/// Most numbers in a list of coordinates: more than any window holds.
const MAX_NUMBERS: usize = 32 * 1024;
/// Most keyframes of a scene.
const MAX_KEYFRAMES: usize = 64;
/// Most poses, and loops, of a corrected path.
const MAX_PATH: usize = 2_000;
/// Largest side of a picture, px.
const MAX_SIDE_PX: u32 = 4_096;
/// Longest text in a message, bytes.
const MAX_WORDS: usize = 64;
/// Most notices of a health message, and longest one, bytes.
const MAX_NOTICES: usize = 16;
const MAX_NOTICE: usize = 512;
/// Largest coordinate that is accepted, m.
const MAX_PLACE: f32 = 1e6;

/// Decodes a message from the network; `None` for what is too long, malformed or not a number.
#[must_use]
pub fn decode<M: Message + Default + Checked>(payload: &[u8]) -> Option<M> {
    if payload.len() > MAX_MESSAGE_BYTES {
        return None;
    }
    M::decode(payload).ok().filter(Checked::is_sound)
}

/// Validity of a decoded message.
pub trait Checked {
    /// Whether all required fields are present, finite and within bounds.
    fn is_sound(&self) -> bool;
}

fn finite(v: Option<&proto::Vector3>) -> bool {
    v.is_some_and(|v| [v.x, v.y, v.z].iter().all(|x| x.is_finite()))
}

fn sound_pose(pose: Option<&proto::Pose>) -> bool {
    pose.is_some_and(|p| finite(p.position_o_b.as_ref()) && isometry(p).is_some())
}

impl Checked for proto::Odom {
    fn is_sound(&self) -> bool {
        self.header.is_some() && sound_pose(self.pose.as_ref()) && finite(self.velocity_o_b.as_ref())
    }
}

impl Checked for proto::State {
    fn is_sound(&self) -> bool {
        self.header.is_some() && sound_pose(self.pose.as_ref()) && finite(self.velocity_o_b.as_ref())
    }
}

impl Checked for proto::Health {
    fn is_sound(&self) -> bool {
        let is_short = |words: &String| words.len() <= MAX_WORDS;
        self.header.is_some()
            && self.words.len() <= HealthBits::NAMES.len()
            && self.words.iter().all(is_short)
            && is_short(&self.rung_words)
            && self.notices.len() <= MAX_NOTICES
            && self.notices.iter().all(|notice| notice.len() <= MAX_NOTICE)
            && self.frame_rate_hz.is_finite()
            && self.frame_ms.is_finite()
            && self.rotation_v_b.as_ref().is_none_or(|q| rotation(q).is_some())
    }
}

/// Whether there are whole tuples of finite coordinates within bounds, and not too many.
fn places(numbers: &[f32], each: usize) -> bool {
    let is_believable = |x: &f32| x.is_finite() && x.abs() <= MAX_PLACE;
    numbers.len() <= MAX_NUMBERS && numbers.len().is_multiple_of(each) && numbers.iter().all(is_believable)
}

impl Checked for proto::Keyframe {
    fn is_sound(&self) -> bool {
        self.header.is_some()
            && sound_pose(self.pose.as_ref())
            && places(&self.points_o, 3)
            && places(&self.lines_o, 6)
    }
}

impl Checked for proto::Scene {
    fn is_sound(&self) -> bool {
        self.header.is_some()
            && self.keyframes.len() <= MAX_KEYFRAMES
            && self.keyframes.iter().all(|pose| sound_pose(Some(pose)))
            && places(&self.points_o, 3)
            && places(&self.lines_o, 6)
    }
}

impl Checked for proto::MapCorrection {
    fn is_sound(&self) -> bool {
        self.header.is_some() && self.pose_m_o.is_none_or(|pose| sound_pose(Some(&pose)))
    }
}

impl Checked for proto::MapPath {
    fn is_sound(&self) -> bool {
        let (poses, loops) = (self.stamps_ns.len(), self.loops_ns.len() / 2);
        self.header.is_some()
            && poses.max(loops) <= MAX_PATH
            && self.reset_counters.len() == poses
            && self.poses_m_b.len() == 7 * poses
            && places(&self.poses_m_b, 7)
            && self.loops_ns.len() == 2 * loops
            && self.loops_m.len() == 6 * loops
            && places(&self.loops_m, 6)
            && self.drift_m.is_none_or(|drift_m| drift_m.is_finite() && drift_m >= 0.0)
    }
}

impl Checked for proto::Picture {
    fn is_sound(&self) -> bool {
        let sides = 1..=MAX_SIDE_PX;
        // The browser decodes the rest, and makes room for the size that the JPEG itself says.
        self.header.is_some()
            && sides.contains(&self.width_px)
            && sides.contains(&self.height_px)
            && jpeg_size(&self.jpeg) == Some((self.width_px, self.height_px))
            && places(&self.points, 3)
            && places(&self.lines, 4)
    }
}

impl Checked for proto::Clock {
    fn is_sound(&self) -> bool {
        self.received_ns > 0 && self.answered_ns >= self.received_ns
    }
}

impl Checked for proto::Trajectory {
    fn is_sound(&self) -> bool {
        self.stamps_ns.len() <= MAX_NUMBERS
            && self.poses_o_b.len() == 7 * self.stamps_ns.len()
            && self.poses_o_b.iter().all(|x| x.is_finite())
    }
}

impl Checked for proto::ResetDone {
    fn is_sound(&self) -> bool {
        self.words.len() <= 4 * MAX_WORDS
    }
}

impl Checked for proto::MapSaved {
    fn is_sound(&self) -> bool {
        self.words.len() <= 4 * MAX_WORDS
    }
}

/// The pose of a message; `None` when it is none.
#[must_use]
pub fn isometry(pose: &proto::Pose) -> Option<Isometry3<f64>> {
    let (p, q) = (pose.position_o_b.as_ref()?, pose.rotation_o_b.as_ref()?);
    Some(Isometry3::from_parts(Vector3::new(p.x, p.y, p.z).into(), rotation(q)?))
}

/// The rotation of a message; `None` when the quaternion has not the norm 1.
#[must_use]
pub fn rotation(q: &proto::Quaternion) -> Option<UnitQuaternion<f64>> {
    let q = nalgebra::Quaternion::new(q.w, q.x, q.y, q.z);
    let is_unit = (q.norm() - 1.0).abs() < 1e-3;
    is_unit.then(|| UnitQuaternion::new_unchecked(q))
}

#[cfg(test)]
mod tests {
    use super::super::wire::*;
    use super::*;
    use plumbline_config::Timestamp;
    use plumbline_estimator::{NavCovariance, Odometry, TrackingState};
    use proptest::prelude::*;

    fn odometry() -> Odometry {
        Odometry {
            sequence: 7,
            stamp: Timestamp::from_nanos(1_403_715_273_262_142_976),
            pose_o_b: Isometry3::from_parts(
                Vector3::new(1.0, -2.0, 0.1).into(),
                UnitQuaternion::from_euler_angles(0.1, 0.2, 3.0),
            ),
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

    #[test]
    fn odometry_comes_through_the_wire_bit_for_bit() {
        let sent = odometry();
        let received: proto::Odom = decode(&odom(&sent, 7, 5).encode_to_vec()).unwrap();
        assert_eq!(isometry(received.pose.as_ref().unwrap()).unwrap(), sent.pose_o_b);
        let header = received.header.unwrap();
        assert_eq!((header.stamp_ns, header.sequence), (sent.stamp.as_nanos(), 7));
        assert_eq!((header.reset_counter, header.quality), (2, 80));
        assert_eq!(state_words(received.state), "tracking");
    }

    #[test]
    fn what_is_not_a_number_is_refused() {
        let mut sent = odometry();
        sent.v_o_b.x = f64::NAN;
        assert!(decode::<proto::Odom>(&odom(&sent, 7, 5).encode_to_vec()).is_none());
        assert!(decode::<proto::Odom>(&[]).is_none());
        assert!(decode::<proto::Odom>(&vec![0; MAX_MESSAGE_BYTES + 1]).is_none());
    }

    #[test]
    fn places_come_in_whole_tuples_of_believable_numbers() {
        let header = Some(proto::Header::default());
        let pose = odom(&odometry(), 0, 0).pose;
        let keyframe = |points_o: Vec<f32>| proto::Keyframe { header, pose, points_o, lines_o: Vec::new() };
        assert!(keyframe(vec![1.0, 2.0, 3.0]).is_sound());
        assert!(!keyframe(vec![1.0, 2.0]).is_sound());
        assert!(!keyframe(vec![1.0, f32::INFINITY, 3.0]).is_sound());
        assert!(!keyframe(vec![0.0; 3 * MAX_NUMBERS]).is_sound());
    }

    #[test]
    fn a_place_in_the_map_may_be_unknown_and_a_path_is_whole() {
        let header = Some(proto::Header::default());
        assert!(proto::MapCorrection { header, ..Default::default() }.is_sound());
        let no_pose = Some(proto::Pose::default());
        assert!(!proto::MapCorrection { header, pose_m_o: no_pose, ..Default::default() }.is_sound());
        let path = |poses: usize, numbers: usize, loops: usize| proto::MapPath {
            header,
            stamps_ns: vec![1; poses],
            poses_m_b: vec![0.5; numbers],
            reset_counters: vec![0; poses],
            loops_ns: vec![1; 2 * loops],
            loops_m: vec![0.5; 6 * loops],
            drift_m: None,
        };
        assert!(path(0, 0, 0).is_sound() && path(MAX_PATH, 7 * MAX_PATH, MAX_PATH).is_sound());
        assert!(!path(2, 7, 0).is_sound() && !path(0, 0, MAX_PATH + 1).is_sound());
        assert!(!proto::MapPath { loops_ns: vec![1], ..path(1, 7, 0) }.is_sound());
        assert!(!proto::MapPath { drift_m: Some(f64::NAN), ..path(1, 7, 0) }.is_sound());
        assert!(path(MAX_PATH, 7 * MAX_PATH, MAX_PATH).encoded_len() < MAX_MESSAGE_BYTES / 2);
    }

    #[test]
    fn a_mounting_is_a_rotation_or_missing() {
        let health = |rotation_v_b| proto::Health {
            header: Some(proto::Header::default()),
            rotation_v_b,
            ..proto::Health::default()
        };
        assert!(health(None).is_sound(), "vehicles of before do not send it");
        assert!(health(Some(quaternion(&UnitQuaternion::identity()))).is_sound());
        assert!(!health(Some(proto::Quaternion::default())).is_sound());
        let noticed =
            |count, length| proto::Health { notices: vec!["x".repeat(length); count], ..health(None) };
        assert!(noticed(MAX_NOTICES, MAX_NOTICE).is_sound());
        assert!(!noticed(MAX_NOTICES + 1, 1).is_sound() && !noticed(1, MAX_NOTICE + 1).is_sound());
        assert!(!health(Some(proto::Quaternion { w: f64::NAN, ..Default::default() })).is_sound());
    }

    #[test]
    fn what_is_no_jpeg_is_no_picture() {
        let picture = |jpeg: Vec<u8>, width_px| proto::Picture {
            header: Some(proto::Header::default()),
            jpeg,
            width_px,
            height_px: 240,
            ..proto::Picture::default()
        };
        let head = |width: u16| {
            [&[0xff, 0xd8, 0xff, 0xc0, 0, 11, 8, 0, 240][..], &width.to_be_bytes(), &[1, 1, 0x11, 0]].concat()
        };
        assert!(picture(head(376), 376).is_sound());
        assert!(!picture(head(377), 376).is_sound() && !picture(head(8000), 8000).is_sound());
        assert!(!picture(b"<svg>".to_vec(), 376).is_sound());
        assert!(!picture(vec![0xff, 0xd8], 1 << 20).is_sound());
    }

    proptest! {
        #[test]
        fn no_payload_makes_the_decoder_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            let _ = decode::<proto::Odom>(&bytes);
            let _ = decode::<proto::State>(&bytes);
            let _ = decode::<proto::Health>(&bytes);
            let _ = decode::<proto::Keyframe>(&bytes);
            let _ = decode::<proto::Scene>(&bytes);
            let _ = decode::<proto::Picture>(&bytes);
            let _ = decode::<proto::MapCorrection>(&bytes);
            let _ = decode::<proto::MapPath>(&bytes);
            let _ = decode::<proto::Clock>(&bytes);
        }

        #[test]
        fn truncation_never_panics(cut in 0usize..300) {
            let bytes = odom(&odometry(), 7, 5).encode_to_vec();
            let _ = decode::<proto::Odom>(&bytes[..cut.min(bytes.len())]);
        }
    }
}
