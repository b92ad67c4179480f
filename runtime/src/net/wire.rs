//! Between the estimator's words and the wire's.

use super::proto;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_estimator::{Estimate, HealthBits, NavCovariance, Odometry, TrackingState};
use prost::Message;

/// The longest message that is looked at, bytes: five times what any of ours takes.
pub const MAX_MESSAGE_BYTES: usize = 16 * 1024;

/// `state` on the wire.
#[must_use]
pub fn state_of(state: TrackingState) -> proto::TrackingState {
    match state {
        TrackingState::Initialising => proto::TrackingState::Initialising,
        TrackingState::Tracking => proto::TrackingState::Tracking,
        TrackingState::Blind => proto::TrackingState::Blind,
        TrackingState::Failed => proto::TrackingState::Failed,
    }
}

/// The words for a state on the wire.
#[must_use]
pub fn state_words(state: i32) -> &'static str {
    match proto::TrackingState::try_from(state) {
        Ok(proto::TrackingState::Initialising) => "initialising",
        Ok(proto::TrackingState::Tracking) => "tracking",
        Ok(proto::TrackingState::Blind) => "blind",
        Ok(proto::TrackingState::Failed) => "failed",
        _ => "unknown",
    }
}

/// The words for health bits.
#[must_use]
pub fn health_words(bits: u32) -> Vec<String> {
    let is_set = |bit: &HealthBits| HealthBits(bits).contains(*bit);
    HealthBits::NAMES.iter().filter(|(bit, _)| is_set(bit)).map(|(_, name)| (*name).to_owned()).collect()
}

fn vector(v: &Vector3<f64>) -> Option<proto::Vector3> {
    Some(proto::Vector3 { x: v.x, y: v.y, z: v.z })
}

fn pose(pose: &Isometry3<f64>) -> Option<proto::Pose> {
    let q = pose.rotation.coords;
    Some(proto::Pose {
        position_o_b: vector(&pose.translation.vector),
        rotation_o_b: Some(proto::Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }),
    })
}

fn sigmas(covariance: &NavCovariance) -> Vec<f64> {
    (0..9).map(|k| covariance[(k, k)].max(0.0).sqrt()).collect()
}

/// Odometry as it is sent.
#[must_use]
pub fn odom(o: &Odometry, published_ns: i64) -> proto::Odom {
    proto::Odom {
        header: Some(proto::Header {
            stamp_ns: o.stamp.as_nanos(),
            published_ns,
            sequence: o.sequence,
            reset_counter: o.reset_counter,
            quality: i32::from(o.quality),
        }),
        state: state_of(o.state).into(),
        pose: pose(&o.pose_o_b),
        velocity_o_b: vector(&o.v_o_b),
        angular_rate_b: vector(&o.angular_rate_b),
        sigmas: sigmas(&o.covariance),
    }
}

/// An estimate as it is sent; `sequence` counts the messages of its key.
#[must_use]
pub fn state(e: &Estimate, sequence: u64, published_ns: i64) -> proto::State {
    let mut covariance = Vec::with_capacity(45);
    for i in 0..9 {
        covariance.extend((i..9).map(|j| e.covariance[(i, j)]));
    }
    proto::State {
        header: Some(proto::Header {
            stamp_ns: e.stamp.as_nanos(),
            published_ns,
            sequence,
            reset_counter: e.reset_counter,
            quality: i32::from(e.quality),
        }),
        state: state_of(e.state).into(),
        pose: pose(&e.pose_o_b),
        velocity_o_b: vector(&e.v_o_b),
        bias_gyro: vector(&e.bias_gyro),
        bias_accel: vector(&e.bias_accel),
        covariance,
        time_offset_s: e.time_offset_s,
        time_offset_sigma_s: e.time_offset_sigma_s,
        health_bits: e.health.0,
        frame_sequence: e.frame_sequence,
        points_tracked: e.figures.points_tracked,
        points_in_window: e.figures.points_in_window,
        keyframes: e.figures.keyframes,
        iterations: e.figures.iterations,
    }
}

/// Decodes a message from the network; `None` for what is too long, malformed or not a number.
#[must_use]
pub fn decode<M: Message + Default + Checked>(payload: &[u8]) -> Option<M> {
    if payload.len() > MAX_MESSAGE_BYTES {
        return None;
    }
    M::decode(payload).ok().filter(Checked::is_sound)
}

/// What a message must hold to be looked at.
pub trait Checked {
    /// Whether header, pose and numbers are all there.
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
        self.header.is_some() && self.words.len() <= HealthBits::NAMES.len()
    }
}

/// The pose of a message; `None` when it is none.
#[must_use]
pub fn isometry(pose: &proto::Pose) -> Option<Isometry3<f64>> {
    let (p, q) = (pose.position_o_b.as_ref()?, pose.rotation_o_b.as_ref()?);
    let q = nalgebra::Quaternion::new(q.w, q.x, q.y, q.z);
    let is_unit = (q.norm() - 1.0).abs() < 1e-3;
    is_unit
        .then(|| Isometry3::from_parts(Vector3::new(p.x, p.y, p.z).into(), UnitQuaternion::new_unchecked(q)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Timestamp;
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
        }
    }

    #[test]
    fn odometry_comes_through_the_wire_bit_for_bit() {
        let sent = odometry();
        let received: proto::Odom = decode(&odom(&sent, 5).encode_to_vec()).unwrap();
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
        assert!(decode::<proto::Odom>(&odom(&sent, 5).encode_to_vec()).is_none());
        assert!(decode::<proto::Odom>(&[]).is_none());
        assert!(decode::<proto::Odom>(&vec![0; MAX_MESSAGE_BYTES + 1]).is_none());
    }

    proptest! {
        #[test]
        fn no_payload_makes_the_decoder_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            let _ = decode::<proto::Odom>(&bytes);
            let _ = decode::<proto::State>(&bytes);
            let _ = decode::<proto::Health>(&bytes);
        }

        #[test]
        fn truncation_never_panics(cut in 0usize..300) {
            let bytes = odom(&odometry(), 5).encode_to_vec();
            let _ = decode::<proto::Odom>(&bytes[..cut.min(bytes.len())]);
        }
    }
}
