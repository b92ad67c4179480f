//! The cameras that a page or a client of Foxglove looks at.

use super::connection::StationSession;
use super::fleet::Fleet;
use super::listen::watch_camera;
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::Arc;
use zenoh::pubsub::Subscriber;

/// Vehicles whose camera one may watch at a time.
const MAX_CAMERAS: usize = 4;

/// Subscriptions to the pictures of vehicles, by their names.
#[derive(Default)]
pub struct Cameras(BTreeMap<String, Subscriber<()>>);

impl Cameras {
    /// Has a vehicle send its pictures.
    ///
    /// # Errors
    /// The reason as text, when there are too many, or it cannot be reached.
    pub async fn watch(
        &mut self,
        connection: &StationSession,
        fleet: &Arc<Mutex<Fleet>>,
        name: String,
    ) -> Result<(), String> {
        if self.contains(&name) {
            return Ok(());
        }
        if self.0.len() >= MAX_CAMERAS {
            return Err(format!("{MAX_CAMERAS} cameras are watched already"));
        }
        let session = connection.session().ok_or("there is no connection to the vehicles")?;
        let subscriber = watch_camera(session, &name, fleet).await.map_err(|error| error.to_string())?;
        self.0.insert(name, subscriber);
        Ok(())
    }

    /// True if the camera of a vehicle is watched.
    pub fn contains(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    /// Watches only the cameras that are still wanted.
    pub fn retain(&mut self, is_wanted: impl Fn(&String) -> bool) {
        self.0.retain(|name, _| is_wanted(name));
    }
}
