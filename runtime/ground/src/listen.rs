//! Subscribes to the keys of vehicles and applies their messages to the fleet.

use super::fleet::{Fleet, is_name, lock};
use super::vehicle::Vehicle;
use super::{READER_HAS_LEFT, recover};
use plumbline_link::net::{Endpoints, NetError, ROOT, now_ns, proto, read, wire};
use std::io::Write;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Instant;
use zenoh::Session;
use zenoh::sample::{Sample, SampleKind};

/// Subscribes to the keys of `endpoints.vehicle` (`*` for all), and queries what was missed; with
/// `print_states` every state is printed as a line of JSON. The camera has a subscription of its own ([`watch_camera`]).
///
/// # Errors
/// When the session cannot be opened.
pub async fn listen(
    endpoints: &Endpoints,
    fleet: &Arc<Mutex<Fleet>>,
    print_states: bool,
) -> Result<Session, NetError> {
    let session = endpoints.open().await?;
    let vehicle = &endpoints.vehicle;
    for topic in Topic::ALWAYS {
        let key = format!("{ROOT}/{vehicle}/{}", topic.key());
        let fleet = Arc::clone(fleet);
        session
            .declare_subscriber(&key)
            .callback(move |sample| receive(&fleet, topic, &sample, print_states))
            .background()
            .await
            .map_err(|error| NetError::Declare { key: key.clone(), message: error.to_string() })?;
    }
    let key = format!("{ROOT}/{vehicle}/alive");
    let theirs = Arc::clone(fleet);
    session
        .liveliness()
        .declare_subscriber(&key)
        .history(true)
        .callback(move |sample: Sample| {
            if let Some(name) = vehicle_of(sample.key_expr().as_str()) {
                lock(&theirs).alive(name, sample.kind() == SampleKind::Put);
            }
        })
        .background()
        .await
        .map_err(|error| NetError::Declare { key, message: error.to_string() })?;
    tokio::spawn(recover::run(session.clone(), Arc::clone(fleet)));
    Ok(session)
}

/// Subscribes to the camera images of a vehicle, until the returned subscriber is dropped.
///
/// # Errors
/// When the key cannot be declared.
pub async fn watch_camera(
    session: &Session,
    vehicle: &str,
    fleet: &Arc<Mutex<Fleet>>,
) -> Result<zenoh::pubsub::Subscriber<()>, NetError> {
    let key = format!("{ROOT}/{vehicle}/{}", Topic::Camera.key());
    let fleet = Arc::clone(fleet);
    session
        .declare_subscriber(&key)
        .callback(move |sample| receive(&fleet, Topic::Camera, &sample, false))
        .await
        .map_err(|error| NetError::Declare { key: key.clone(), message: error.to_string() })
}

/// Keys that vehicles publish.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Topic {
    Odom,
    State,
    Health,
    Keyframe,
    Correction,
    Scene,
    Camera,
    Path,
}

impl Topic {
    /// Those that every station hears.
    const ALWAYS: [Self; 7] =
        [Self::Odom, Self::State, Self::Health, Self::Keyframe, Self::Correction, Self::Path, Self::Scene];

    fn key(self) -> &'static str {
        match self {
            Self::Odom => "odom",
            Self::State => "state",
            Self::Health => "health",
            Self::Keyframe => "map/keyframe",
            Self::Correction => "map/correction",
            Self::Path => "map/path",
            Self::Scene => "scene",
            Self::Camera => "camera",
        }
    }
}

/// The vehicle's name in `plumbline/<vehicle>/...`.
fn vehicle_of(key: &str) -> Option<&str> {
    key.strip_prefix(ROOT)?.strip_prefix('/')?.split('/').next().filter(|name| !name.is_empty())
}

fn receive(fleet: &Mutex<Fleet>, topic: Topic, sample: &Sample, print_states: bool) {
    let received_ns = now_ns();
    let Some(vehicle) = vehicle_of(sample.key_expr().as_str()) else { return };
    // Zenoh may hold a payload in fragments; one that is too long is refused before it is copied.
    if sample.payload().len() > read::MAX_MESSAGE_BYTES {
        lock(fleet).malformed();
        return;
    }
    apply(fleet, topic, vehicle, &sample.payload().to_bytes(), received_ns, print_states);
}

/// Applies a payload of a vehicle, received at `received_ns` by this host's clock; what cannot be decoded is counted.
fn apply(
    fleet: &Mutex<Fleet>,
    topic: Topic,
    vehicle: &str,
    bytes: &[u8],
    received_ns: i64,
    print_states: bool,
) {
    let (now, size) = (Instant::now(), bytes.len());
    let is_decoded = match topic {
        Topic::Odom => read::decode::<proto::Odom>(bytes)
            .map(|message| lock(fleet).odom(vehicle, &message, size, now, received_ns)),
        Topic::State => read::decode::<proto::State>(bytes).map(|message| {
            lock(fleet).state(vehicle, &message, size, now);
            if print_states && is_name(vehicle) {
                print_state(vehicle, &message);
            }
        }),
        Topic::Health => read::decode::<proto::Health>(bytes)
            .map(|message| lock(fleet).health(vehicle, &message, size, now)),
        Topic::Keyframe => taken(fleet, vehicle, bytes, |v, m: proto::Keyframe| v.map.insert(&m)),
        Topic::Correction => {
            taken(fleet, vehicle, bytes, |v, m: proto::MapCorrection| v.corrected.apply_correction(&m))
        }
        Topic::Path => taken(fleet, vehicle, bytes, |v, m: proto::MapPath| v.corrected.apply_path(&m)),
        Topic::Scene => taken(fleet, vehicle, bytes, |v, m: proto::Scene| v.map.set_scene(&m)),
        Topic::Camera => taken(fleet, vehicle, bytes, |v, m: proto::Picture| v.show(m)),
    };
    if is_decoded.is_none() {
        lock(fleet).malformed();
    }
}

/// Has a vehicle take a message that can be decoded.
fn taken<M: prost::Message + Default + read::Checked>(
    fleet: &Mutex<Fleet>,
    vehicle: &str,
    bytes: &[u8],
    take: impl FnOnce(&mut Vehicle, M),
) -> Option<()> {
    let message = read::decode(bytes)?;
    if let Some(vehicle) = lock(fleet).vehicle(vehicle) {
        take(vehicle, message);
    }
    Some(())
}

fn print_state(vehicle: &str, message: &proto::State) {
    let (Some(header), Some(pose)) = (&message.header, message.pose.as_ref().and_then(read::isometry)) else {
        return;
    };
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    let line = serde_json::json!({
        "vehicle": vehicle,
        "stamp_ns": header.stamp_ns,
        "sequence": header.sequence,
        "state": wire::state_words(message.state),
        "position_m": [p.x, p.y, p.z],
        "rotation_xyzw": [q.x, q.y, q.z, q.w],
        "reset_counter": header.reset_counter,
        "quality": header.quality,
    });
    // A reader of the pipe that has closed it is not an error: the command ends.
    if writeln!(std::io::stdout().lock(), "{line}").is_err() {
        READER_HAS_LEFT.store(true, Ordering::Relaxed);
    }
}

#[cfg(any(test, feature = "fuzzing"))]
const TOPICS: [Topic; 8] = [
    Topic::Odom,
    Topic::State,
    Topic::Health,
    Topic::Keyframe,
    Topic::Correction,
    Topic::Scene,
    Topic::Camera,
    Topic::Path,
];

/// Takes `bytes` as a message of a vehicle on the topic of this number, counted round.
#[cfg(any(test, feature = "fuzzing"))]
pub fn apply_numbered(fleet: &Mutex<Fleet>, topic: u8, bytes: &[u8]) {
    apply(fleet, TOPICS[usize::from(topic) % TOPICS.len()], "drone", bytes, 0, false);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_vehicle_is_the_second_part_of_a_key() {
        assert_eq!(vehicle_of("plumbline/drone/odom"), Some("drone"));
        assert_eq!(vehicle_of("plumbline//odom"), None);
        assert_eq!(vehicle_of("other/drone/odom"), None);
    }

    proptest! {
        #[test]
        fn whatever_comes_on_a_key_is_taken_or_counted(
            bytes in prop::collection::vec(any::<u8>(), 0..400), topic in 0usize..8
        ) {
            let fleet = Mutex::new(Fleet::default());
            apply(&fleet, TOPICS[topic], "drone", &bytes, 0, false);
            let fleet = lock(&fleet);
            prop_assert_eq!(fleet.vehicles.len() as u64 + fleet.malformed, 1);
        }
    }
}
