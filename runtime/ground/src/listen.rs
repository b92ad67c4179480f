//! Subscribes to the keys of vehicles and applies their messages to the fleet.

use super::fleet::{Fleet, is_name};
use super::vehicle::{VehicleState, state_words};
use super::{READER_HAS_LEFT, recover};
use parking_lot::Mutex;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_estimator::{MapSnapshot, Odometry};
use plumbline_link::net::outlet::key_of;
use plumbline_link::net::read::{self, Heard};
use plumbline_link::net::{Endpoints, NetError, ROOT, now_ns};
use plumbline_record::messages::Health;
use plumbline_record::said::FullEstimate;
use plumbline_record::topics::Topic;
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::Ordering;
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
    for (topic, _) in Topic::published().filter(|(topic, _)| *topic != Topic::Picture) {
        let key = key_of(vehicle, topic);
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
                theirs.lock().alive(name, sample.kind() == SampleKind::Put);
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
    let key = key_of(vehicle, Topic::Picture);
    let fleet = Arc::clone(fleet);
    session
        .declare_subscriber(&key)
        .callback(move |sample| receive(&fleet, Topic::Picture, &sample, false))
        .await
        .map_err(|error| NetError::Declare { key: key.clone(), message: error.to_string() })
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
        fleet.lock().malformed();
        return;
    }
    apply(fleet, topic, vehicle, &sample.payload().to_bytes(), received_ns, print_states);
}

/// Applies a payload of a vehicle, received at `received_ns` by this host's clock; what cannot be decoded is counted.
pub(super) fn apply(
    fleet: &Mutex<Fleet>,
    topic: Topic,
    vehicle: &str,
    bytes: &[u8],
    received_ns: i64,
    print_states: bool,
) {
    let (now, size) = (Instant::now(), bytes.len());
    let is_decoded = match topic {
        Topic::Odometry => read::heard::<Odometry>(bytes)
            .map(|message| fleet.lock().odom(vehicle, &message, size, now, received_ns)),
        Topic::FullEstimate => read::heard::<FullEstimate>(bytes).map(|message| {
            fleet.lock().state(vehicle, &message, size, now);
            if print_states && is_name(vehicle) {
                print_state(vehicle, &message);
            }
        }),
        Topic::Health => {
            read::heard::<Health>(bytes).map(|message| fleet.lock().health(vehicle, &message, size, now))
        }
        Topic::Keyframe => {
            taken(fleet, vehicle, read::heard::<MapSnapshot>(bytes), |v, heard| v.map.insert(&heard))
        }
        Topic::MapEstimate => {
            let heard = read::heard::<MapEstimate>(bytes);
            taken(fleet, vehicle, heard, |v, heard| v.corrected.apply_correction(heard))
        }
        Topic::Path => {
            let heard = read::heard::<MapPath>(bytes);
            taken(fleet, vehicle, heard, |v, heard| v.corrected.apply_path(&heard))
        }
        Topic::Window => {
            let heard = read::heard::<MapSnapshot>(bytes);
            taken(fleet, vehicle, heard, |v, heard| v.map.set_scene(&heard.message))
        }
        Topic::Picture => taken(fleet, vehicle, read::picture(bytes), VehicleState::show),
        // No other is published.
        _ => None,
    };
    if is_decoded.is_none() {
        fleet.lock().malformed();
    }
}

/// Has a vehicle take a message, where it could be read.
fn taken<M>(
    fleet: &Mutex<Fleet>,
    vehicle: &str,
    message: Option<M>,
    take: impl FnOnce(&mut VehicleState, M),
) -> Option<()> {
    let message = message?;
    if let Some(vehicle) = fleet.lock().vehicle(vehicle) {
        take(vehicle, message);
    }
    Some(())
}

fn print_state(vehicle: &str, Heard { envelope, message }: &Heard<FullEstimate>) {
    let pose = &message.estimate.pose_o_b;
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    let line = serde_json::json!({
        "vehicle": vehicle,
        "stamp_ns": envelope.stamp_ns,
        "sequence": envelope.sequence,
        "state": state_words(message.estimate.state),
        "position_m": [p.x, p.y, p.z],
        "rotation_xyzw": [q.x, q.y, q.z, q.w],
        "reset_counter": envelope.reset_counter,
        "quality": envelope.quality,
    });
    // A reader of the pipe that has closed it is not an error: the command ends.
    if writeln!(std::io::stdout().lock(), "{line}").is_err() {
        READER_HAS_LEFT.store(true, Ordering::Relaxed);
    }
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
            bytes in prop::collection::vec(any::<u8>(), 0..400), topic in 0u8..8
        ) {
            let fleet = Mutex::new(Fleet::default());
            crate::fuzzing::apply_numbered(&fleet, topic, &bytes);
            let fleet = fleet.lock();
            prop_assert_eq!(fleet.vehicles.len() as u64 + fleet.malformed, 1);
        }
    }
}
