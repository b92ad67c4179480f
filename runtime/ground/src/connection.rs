//! The connection of a station to the network: a session, as soon as there is somebody to talk to.

use super::fleet::Fleet;
use super::listen::listen;
use parking_lot::Mutex;
use plumbline_link::net::{Endpoints, Mode, NetError, diagnosis};
use std::sync::{Arc, OnceLock, Weak};
use std::time::Duration;
use zenoh::Session;

/// Pause before another attempt to open a session.
const RETRY: Duration = Duration::from_millis(500);
/// Period at which the fleet is told how far the connection is.
const LOOK: Duration = Duration::from_millis(500);

/// The session of a station, once there is one.
#[derive(Clone, Default)]
pub struct StationSession(Arc<OnceLock<Session>>);

impl StationSession {
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
        let endpoints = endpoints.clone();
        fleet.lock().network = attempt(&endpoints, false, None);
        tokio::spawn(connection.clone().follow(endpoints.clone(), Arc::downgrade(fleet)));
        match listen(&endpoints, fleet, print_states).await {
            Err(NetError::Open { .. }) if endpoints.mode == Mode::Client => {
                tracing::info!("no peer at {} yet; waiting", endpoints.connect.join(", "));
                let endpoints = Endpoints { waits: true, ..endpoints };
                tokio::spawn(connection.clone().wait(endpoints, Arc::clone(fleet), print_states));
            }
            outcome => drop(connection.0.set(outcome?)),
        }
        Ok(connection)
    }

    async fn wait(self, endpoints: Endpoints, fleet: Arc<Mutex<Fleet>>, print_states: bool) {
        let _ = self.0.set(until_it_succeeds(|| listen(&endpoints, &fleet, print_states)).await);
    }

    /// Keeps the words in the fleet up to date, as long as it is there.
    async fn follow(self, endpoints: Endpoints, fleet: Weak<Mutex<Fleet>>) {
        loop {
            tokio::time::sleep(LOOK).await;
            let is_linked = match self.session() {
                Some(session) => has_link(session).await,
                None => false,
            };
            let words = attempt(&endpoints, is_linked, diagnosis::newest_failure().as_deref());
            let Some(fleet) = fleet.upgrade() else { return };
            fleet.lock().network = words;
        }
    }

    /// The session; `None` while nobody has been reached.
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

/// Repeats `open` until it succeeds, and logs its errors.
async fn until_it_succeeds<T, F>(open: impl Fn() -> F) -> T
where
    F: Future<Output = Result<T, NetError>>,
{
    loop {
        match open().await {
            Ok(opened) => return opened,
            Err(error) => tracing::error!("{error}; trying again"),
        }
        tokio::time::sleep(RETRY).await;
    }
}

/// True if there is another process at the end of any link.
async fn has_link(session: &Session) -> bool {
    let info = session.info();
    info.routers_zid().await.next().is_some() || info.peers_zid().await.next().is_some()
}

/// Description of how a station tries to reach its vehicles, in plain words.
fn attempt(endpoints: &Endpoints, is_linked: bool, failure: Option<&str>) -> String {
    let (connect, listen) = (endpoints.connect.join(", "), endpoints.listen.join(", "));
    let vehicle = match endpoints.vehicle.as_str() {
        "*" => "a vehicle".to_owned(),
        name => format!("vehicle {name}"),
    };
    if is_linked {
        let end = if connect.is_empty() { listen } else { connect };
        return format!("Linked by {end}, waiting for {vehicle} that publishes");
    }
    let mut words = match (connect.is_empty(), listen.is_empty()) {
        (true, true) => "Looking for vehicles on the local network".to_owned(),
        (true, false) => format!("Waiting for {vehicle} to connect to {listen}"),
        (false, true) => format!("Connecting to {connect}"),
        (false, false) => {
            format!("Connecting to {connect}, and waiting for {vehicle} to connect to {listen}")
        }
    };
    if let Some(failure) = failure.filter(|_| !connect.is_empty()) {
        // Which endpoint it is of is said already where there is one.
        let cause = failure.strip_prefix(&format!("{connect}: ")).unwrap_or(failure);
        words = format!("{words} ({cause})");
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[tokio::test]
    async fn a_session_that_cannot_be_opened_is_tried_again() {
        let attempts = AtomicU32::new(0);
        let opened = until_it_succeeds(|| async {
            let message = "the router went away".to_owned();
            match attempts.fetch_add(1, Ordering::Relaxed) {
                0 => Err(NetError::Declare { key: "plumbline/**".into(), message }),
                attempt => Ok(attempt),
            }
        });
        assert_eq!(opened.await, 1);
    }

    #[test]
    fn what_is_tried_names_the_endpoints_and_the_newest_failure() {
        let of = |connect: &[&str], listen: &[&str]| {
            let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
            Endpoints {
                connect: owned(connect),
                listen: owned(listen),
                vehicle: "*".into(),
                ..Endpoints::default()
            }
        };
        let client = of(&["tcp/10.0.0.7:7447"], &[]);
        assert_eq!(attempt(&client, false, None), "Connecting to tcp/10.0.0.7:7447");
        assert!(
            attempt(&client, false, Some("tcp/10.0.0.7:7447: no listener at that port yet"))
                .ends_with("tcp/10.0.0.7:7447 (no listener at that port yet)")
        );
        assert_eq!(
            attempt(&client, true, Some("no listener")),
            "Linked by tcp/10.0.0.7:7447, waiting for a vehicle that publishes"
        );
        let server = of(&[], &["tcp/0.0.0.0:7447"]);
        assert_eq!(attempt(&server, false, None), "Waiting for a vehicle to connect to tcp/0.0.0.0:7447");
    }
}
