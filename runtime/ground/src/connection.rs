//! The connection of a station to the network: a session, as soon as there is somebody to talk to.

use super::fleet::Fleet;
use super::listen::listen;
use plumbline_link::net::{Endpoints, Mode, NetError};
use std::sync::{Arc, Mutex, OnceLock};
use zenoh::Session;

/// The session of a station, once there is one.
#[derive(Clone, Default)]
pub struct Connection(Arc<OnceLock<Session>>);

impl Connection {
    /// Opens the session and fills the fleet from it. A client without anybody at the other end goes on trying: a
    /// router passes nothing on to a station that is a peer, so it must not become one meanwhile.
    ///
    /// # Errors
    /// When an endpoint is malformed or taken, or a file of keys cannot be used.
    pub async fn open(
        endpoints: &Endpoints,
        fleet: &Arc<Mutex<Fleet>>,
        print_states: bool,
    ) -> Result<Self, NetError> {
        let connection = Self::default();
        match listen(endpoints, fleet, print_states).await {
            Err(NetError::Open { .. }) if endpoints.mode == Mode::Client => {
                tracing::info!("no peer at {} yet; waiting", endpoints.connect.join(", "));
                let endpoints = Endpoints { waits: true, ..endpoints.clone() };
                tokio::spawn(connection.clone().wait(endpoints, Arc::clone(fleet), print_states));
            }
            outcome => drop(connection.0.set(outcome?)),
        }
        Ok(connection)
    }

    async fn wait(self, endpoints: Endpoints, fleet: Arc<Mutex<Fleet>>, print_states: bool) {
        match listen(&endpoints, &fleet, print_states).await {
            Ok(session) => drop(self.0.set(session)),
            Err(error) => tracing::error!("{error}"),
        }
    }

    /// The session; `None` while nobody has been reached.
    #[must_use]
    pub fn session(&self) -> Option<&Session> {
        self.0.get()
    }

    /// Ends the session, if there was one.
    pub async fn close(&self) {
        if let Some(session) = self.session() {
            let _ = session.close().await;
        }
    }
}
