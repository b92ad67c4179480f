//! Foxglove's view of a vehicle: topics, their schemas, and the news of each.

use super::map::{MapKeyframe, WindowScene};
use super::track::PoseSample;
use super::vehicle::VehicleState;
use nalgebra::Isometry3;
use plumbline_config::Timestamp;
use plumbline_scene::messages::{CompressedImage, SceneEntity};
use plumbline_scene::{
    self as scene, Landmarks, SceneContent, frame_transform, log_time, pose_in, timestamp,
};
use prost::Message;

/// Poses of a path, at most.
const MAX_PATH: usize = 2_000;
/// Keyframes in one message.
const MAX_KEYFRAMES: usize = 100;
/// The path is sent again when it is this much longer, ns.
const PATH_NS: i64 = 1_000_000_000;

/// Topics of each vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DrawnTopic {
    /// Pose of the body.
    Pose,
    /// Transform from the odometry frame to the body.
    Transform,
    /// The path.
    Path,
    /// Window and keyframes.
    Scene,
    /// The picture of the camera, while somebody looks at it.
    Image,
}

impl DrawnTopic {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Pose, Self::Transform, Self::Path, Self::Scene, Self::Image];

    /// Topic of a vehicle.
    #[must_use]
    pub fn of(self, vehicle: &str) -> String {
        let name = match self {
            Self::Pose => "pose",
            Self::Transform => "tf",
            Self::Path => "path",
            Self::Scene => "scene",
            Self::Image => "image",
        };
        format!("/{vehicle}/{name}")
    }

    /// Name of its schema.
    #[must_use]
    pub const fn schema(self) -> &'static str {
        match self {
            Self::Pose => "foxglove.PoseInFrame",
            Self::Transform => "foxglove.FrameTransform",
            Self::Path => "foxglove.PosesInFrame",
            Self::Scene => "foxglove.SceneUpdate",
            Self::Image => "foxglove.CompressedImage",
        }
    }
}

/// Name of the odometry frame of a vehicle.
pub fn odometry_frame(vehicle: &str) -> String {
    format!("{vehicle}/odom")
}

/// Name of the body frame of a vehicle.
pub fn body_frame(vehicle: &str) -> String {
    format!("{vehicle}/body")
}

/// An encoded message and its time, ns.
pub type Drawn = (u64, Vec<u8>);

/// Position of a client in a topic of a vehicle: up to where it was sent.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sent {
    stamp_ns: Option<i64>,
    epoch: Option<u64>,
    next: u64,
    version: u64,
}

impl DrawnTopic {
    /// News of `vehicle` since `sent`, which is brought up to date.
    pub fn news(self, name: &str, vehicle: &VehicleState, sent: &mut Sent) -> Vec<Drawn> {
        match self {
            Self::Pose | Self::Transform => self.pose(name, vehicle, sent).into_iter().collect(),
            Self::Path => path_news(name, vehicle, sent).into_iter().collect(),
            Self::Scene => scene_news(name, vehicle, sent),
            Self::Image => image(name, vehicle, sent).into_iter().collect(),
        }
    }

    fn pose(self, name: &str, vehicle: &VehicleState, sent: &mut Sent) -> Option<Drawn> {
        let pose = vehicle.pose_o_b.filter(|_| sent.stamp_ns != Some(vehicle.stamp_ns))?;
        sent.stamp_ns = Some(vehicle.stamp_ns);
        let stamp = Timestamp::from_nanos(vehicle.stamp_ns);
        Some((log_time(stamp), self.pose_message(name, stamp, &pose)))
    }

    /// A pose as this topic has it.
    #[must_use]
    pub fn pose_message(self, name: &str, stamp: Timestamp, pose: &Isometry3<f64>) -> Vec<u8> {
        let odometry = odometry_frame(name);
        match self {
            Self::Transform => frame_transform(stamp, &odometry, &body_frame(name), pose).encode_to_vec(),
            _ => pose_in(stamp, &odometry, pose).encode_to_vec(),
        }
    }
}

/// The path up to a sample, thinned.
fn path<'a>(name: &str, stamp: Timestamp, samples: impl ExactSizeIterator<Item = &'a PoseSample>) -> Vec<u8> {
    let step = samples.len().div_ceil(MAX_PATH).max(1);
    let poses: Vec<_> = samples.step_by(step).map(|sample| sample.pose_o_b).collect();
    scene::poses(stamp, &odometry_frame(name), &poses).encode_to_vec()
}

fn path_news(name: &str, vehicle: &VehicleState, sent: &mut Sent) -> Option<Drawn> {
    let newest = vehicle.poses.newest()?.stamp_ns;
    let is_due = sent.stamp_ns.is_none_or(|last| newest.saturating_sub(last) >= PATH_NS || newest < last);
    if !is_due && sent.epoch == Some(vehicle.track.epoch) {
        return None;
    }
    (sent.stamp_ns, sent.epoch) = (Some(newest), Some(vehicle.track.epoch));
    let stamp = Timestamp::from_nanos(newest);
    Some((log_time(stamp), path(name, stamp, vehicle.poses.iter())))
}

/// The scene of a keyframe.
fn keyframe(name: &str, sequence: u64, keyframe: &MapKeyframe) -> SceneEntity {
    let content = SceneContent::of_coordinates(&keyframe.points_o, &keyframe.lines_o, &[keyframe.pose_o_b]);
    let (stamp, id) = (Timestamp::from_nanos(keyframe.stamp_ns), format!("keyframe {sequence}"));
    scene::entity(stamp, &odometry_frame(name), &id, &content, Landmarks::Kept)
}

/// The window of a vehicle as it is now.
fn window(name: &str, stamp: Timestamp, window: &WindowScene) -> SceneEntity {
    let content = SceneContent::of_coordinates(&window.points_o, &window.lines_o, &window.keyframes);
    scene::entity(stamp, &odometry_frame(name), "window", &content, Landmarks::InWindow)
}

fn scene_news(name: &str, vehicle: &VehicleState, sent: &mut Sent) -> Vec<Drawn> {
    let (stamp, map) = (Timestamp::from_nanos(vehicle.stamp_ns), &vehicle.map);
    let mut updates = Vec::new();
    if sent.epoch != Some(map.epoch) {
        (sent.epoch, sent.next, sent.version) = (Some(map.epoch), 0, 0);
        updates.push(scene::cleared(stamp));
    }
    let (next, keyframes) = map.since(sent.next, MAX_KEYFRAMES);
    sent.next = next;
    let mut entities: Vec<_> = keyframes.iter().map(|(sequence, of)| keyframe(name, *sequence, of)).collect();
    if sent.version != map.scene.version {
        sent.version = map.scene.version;
        entities.push(window(name, stamp, &map.scene));
    }
    if !entities.is_empty() {
        updates.push(scene::update(entities));
    }
    updates.iter().map(|update| (log_time(stamp), update.encode_to_vec())).collect()
}

fn image(name: &str, vehicle: &VehicleState, sent: &mut Sent) -> Option<Drawn> {
    let picture = vehicle.picture.as_ref().filter(|picture| picture.version != sent.version)?;
    sent.version = picture.version;
    let stamp_ns = picture.message.envelope.stamp_ns;
    let stamp = Timestamp::from_nanos(stamp_ns);
    let message = CompressedImage {
        timestamp: timestamp(stamp),
        frame_id: format!("{name}/camera"),
        data: picture.message.message.jpeg.clone().into(),
        format: "jpeg".into(),
    };
    Some((log_time(stamp), message.encode_to_vec()))
}

#[cfg(test)]
mod tests {
    use super::super::fleet::Fleet;
    use super::super::test_messages::{heard, window};
    use super::*;
    use plumbline_scene::messages::SceneUpdate;

    fn decoded(news: &[Drawn]) -> Vec<SceneUpdate> {
        news.iter().map(|(_, bytes)| SceneUpdate::decode(&bytes[..]).unwrap()).collect()
    }

    #[test]
    fn a_scene_is_sent_whole_then_by_its_changes_and_emptied_when_the_map_is_cleared() {
        let mut fleet = Fleet::default();
        fleet.alive("drone", true);
        let vehicle = fleet.vehicles.get_mut("drone").unwrap();
        vehicle.map.insert(&heard(0, window(7, 0, 1)));
        vehicle.map.set_scene(&window(9, 0, 1));
        let mut sent = Sent::default();
        let first = decoded(&DrawnTopic::Scene.news("drone", vehicle, &mut sent));
        assert_eq!((first[0].deletions.len(), first.len()), (1, 2));
        let ids: Vec<_> = first[1].entities.iter().map(|entity| entity.id.as_str()).collect();
        assert_eq!(ids, ["keyframe 0", "window"]);
        assert_eq!(first[1].entities[0].frame_id, "drone/odom");
        assert_eq!(first[1].entities[0].timestamp.unwrap().nsec(), 7);
        assert!(DrawnTopic::Scene.news("drone", vehicle, &mut sent).is_empty());
        vehicle.map.clear();
        let cleared = decoded(&DrawnTopic::Scene.news("drone", vehicle, &mut sent));
        assert_eq!(cleared[0].deletions.len(), 1);
    }

    #[test]
    fn a_pose_is_sent_once_and_none_without_a_valid_estimate() {
        let mut fleet = Fleet::default();
        fleet.alive("drone", true);
        let vehicle = fleet.vehicles.get_mut("drone").unwrap();
        let mut sent = [Sent::default(); 2];
        let mut count = |vehicle: &VehicleState| {
            let topics = [DrawnTopic::Pose, DrawnTopic::Transform].into_iter().zip(&mut sent);
            topics.map(|(topic, sent)| topic.news("drone", vehicle, sent).len()).sum::<usize>()
        };
        assert_eq!(count(vehicle), 0);
        (vehicle.pose_o_b, vehicle.stamp_ns) = (Some(Isometry3::identity()), 5);
        assert_eq!((count(vehicle), count(vehicle)), (2, 0));
        vehicle.stamp_ns = 6;
        assert_eq!(count(vehicle), 2);
    }
}
