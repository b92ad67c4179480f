//! Fills the fleet from the network.

use super::fleet::Fleet;
use crate::net::{Endpoints, NetError, ROOT, proto, wire};
use std::io::Write;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Instant, SystemTime, UNIX_EPOCH};
use zenoh::Session;
use zenoh::sample::{Sample, SampleKind};

/// Subscriptions to every vehicle; they end with it.
pub struct Listener {
    runtime: tokio::runtime::Runtime,
    session: Session,
}

impl Listener {
    /// Subscribes to the keys of `endpoints.vehicle` (`*` for all); with `print_states` every state is
    /// printed as a line of JSON.
    ///
    /// # Errors
    /// When the session cannot be opened.
    pub fn start(
        endpoints: &Endpoints,
        fleet: Arc<Mutex<Fleet>>,
        print_states: bool,
    ) -> Result<Self, NetError> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let session = runtime.block_on(async {
            let session = endpoints.open().await?;
            subscribe(&session, &endpoints.vehicle, fleet, print_states).await?;
            Ok::<_, NetError>(session)
        })?;
        Ok(Self { runtime, session })
    }

    /// Leaves the network.
    pub fn stop(self) {
        let _ = self.runtime.block_on(async { self.session.close().await });
    }
}

async fn subscribe(
    session: &Session,
    vehicle: &str,
    fleet: Arc<Mutex<Fleet>>,
    print_states: bool,
) -> Result<(), NetError> {
    let failed = |key: &str| {
        let key = key.to_owned();
        move |error: zenoh::Error| NetError::Declare { key, message: error.to_string() }
    };
    for name in ["odom", "state", "health"] {
        let key = format!("{ROOT}/{vehicle}/{name}");
        let fleet = Arc::clone(&fleet);
        session
            .declare_subscriber(&key)
            .callback(move |sample| heard(&fleet, name, &sample, print_states))
            .background()
            .await
            .map_err(failed(&key))?;
    }
    let key = format!("{ROOT}/{vehicle}/alive");
    session
        .liveliness()
        .declare_subscriber(&key)
        .history(true)
        .callback(move |sample: Sample| {
            if let Some(name) = vehicle_of(sample.key_expr().as_str()) {
                lock(&fleet).alive(name, sample.kind() == SampleKind::Put);
            }
        })
        .background()
        .await
        .map_err(failed(&key))
}

fn lock(fleet: &Mutex<Fleet>) -> std::sync::MutexGuard<'_, Fleet> {
    fleet.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The vehicle's name in `plumbline/<vehicle>/...`.
fn vehicle_of(key: &str) -> Option<&str> {
    key.strip_prefix(ROOT)?.strip_prefix('/')?.split('/').next().filter(|name| !name.is_empty())
}

fn heard(fleet: &Mutex<Fleet>, name: &str, sample: &Sample, print_states: bool) {
    let now = Instant::now();
    let Some(vehicle) = vehicle_of(sample.key_expr().as_str()) else { return };
    // Zenoh may hold a payload in pieces; too long a one is refused before it is copied.
    if sample.payload().len() > wire::MAX_MESSAGE_BYTES {
        lock(fleet).malformed();
        return;
    }
    let bytes = sample.payload().to_bytes();
    match name {
        "odom" => match wire::decode::<proto::Odom>(&bytes) {
            Some(message) => lock(fleet).odom(vehicle, &message, now, now_ns()),
            None => lock(fleet).malformed(),
        },
        "state" => match wire::decode::<proto::State>(&bytes) {
            Some(message) => {
                lock(fleet).state(vehicle, &message, now);
                if print_states {
                    print_state(vehicle, &message);
                }
            }
            None => lock(fleet).malformed(),
        },
        _ => match wire::decode::<proto::Health>(&bytes) {
            Some(message) => lock(fleet).health(vehicle, &message),
            None => lock(fleet).malformed(),
        },
    }
}

fn print_state(vehicle: &str, message: &proto::State) {
    let (Some(header), Some(pose)) = (&message.header, message.pose.as_ref().and_then(wire::isometry)) else {
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
    // A reader that has gone away is no error of ours.
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}

fn now_ns() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_nanos() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_vehicle_is_the_second_part_of_a_key() {
        assert_eq!(vehicle_of("plumbline/drone/odom"), Some("drone"));
        assert_eq!(vehicle_of("plumbline//odom"), None);
        assert_eq!(vehicle_of("other/drone/odom"), None);
    }
}
