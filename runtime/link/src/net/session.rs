//! Zenoh sessions that listen only where they are told to.

use super::endpoints::{Endpoints, Mode};
use super::error::NetError;
use super::{diagnosis, read, security};
use plumbline_config::options::Link;
use zenoh::Session;

/// An attempt to connect is given up after this, ms: over a link that was down, the next one succeeds sooner
/// than the retransmissions of the last.
const OPEN_TIMEOUT_MS: u64 = 2_000;
/// A link without traffic for this long is closed, ms, so that a lost vehicle is noticed and a new link opened soon.
const LEASE_MS: u64 = 4_000;
/// Attempts to connect come this soon after each other, ms: the system itself repeats the first packet of one after a
/// second, so that hardly a second passes without a chance.
const RETRY_MS: (u64, u64) = (50, 200);
/// Longest time that a message waits for space in the send queue before it is dropped, us. Odometry waits on the thread that
/// empties the queue, so the time must be short.
const PATIENCE_US: u64 = 5_000;
/// A link whose peer asked for messages that wait for space (`CongestionControl::Block`), and does not read, is closed after this time, us.
/// Whatever is sent of our own does not wait; a thread that answers would wait for that peer, and all others for it.
const MAX_BLOCKED_US: u64 = 500_000;
/// Longest message that comes in, bytes. A vehicle hears short questions; a router passes on half an hour of poses in one
/// answer. Each of the sixteen channels of a link (eight priorities, twice) may hold one that is not complete.
const MAX_MESSAGE_BYTES: usize = 64 * 1024;
const MAX_PASSED_BYTES: usize = 3 * 1024 * 1024;
/// Links at a time, of a vehicle and of others, and handshakes.
const MAX_LINKS: usize = 32;
const MAX_LINKS_ON_GROUND: usize = 160;
/// Zenoh refuses every handshake beyond these. The listeners have bounds of their own, where a handshake of the most crowded address gives way (64 each for
/// TCP and TLS; after TLS, the places for sessions), whose sum is below this one.
const MAX_PENDING: usize = 1_000;
/// A handshake ends after this, ms: whoever connects gives up after 2 s.
const ACCEPT_TIMEOUT_MS: u64 = 2_500;
/// Largest batch on a telemetry radio, bytes: messages behind it are delayed by its length.
const RADIO_BATCH_BYTES: u64 = 1_200;

impl Endpoints {
    /// Refuses endpoints that cannot work.
    ///
    /// # Errors
    /// When one is malformed, taken, not this host's, or lacks certificates.
    pub fn check(&self) -> Result<(), NetError> {
        for endpoint in self.listen.iter().chain(&self.connect) {
            diagnosis::check(endpoint, self.tls.is_given())?;
        }
        self.listen.iter().try_for_each(|endpoint| diagnosis::check_listener(endpoint))
    }

    /// Opens a session.
    ///
    /// # Errors
    /// When an endpoint is malformed, taken or out of reach, or a file of keys cannot be used.
    pub async fn open(&self) -> Result<Session, NetError> {
        self.check()?;
        let failed = |error: zenoh::Error| self.failed(&error.to_string());
        let mut config = zenoh::Config::default();
        let mode = match self.mode {
            Mode::Peer => "\"peer\"",
            Mode::Client => "\"client\"",
            Mode::Router => "\"router\"",
        };
        let retry = serde_json::json!({
            "period_init_ms": RETRY_MS.0, "period_max_ms": RETRY_MS.1, "period_increase_factor": 2.0,
        });
        let (message_bytes, links) = self.bounds();
        let mut settings = vec![
            ("mode", mode.to_owned()),
            ("listen/endpoints", self.guarded(&self.listen, Some(links.saturating_sub(self.connect.len())))),
            ("connect/endpoints", self.guarded(&self.connect, None)),
            ("connect/retry", retry.to_string()),
            ("scouting/multicast/enabled", self.scouting.to_string()),
            ("transport/unicast/open_timeout", OPEN_TIMEOUT_MS.to_string()),
            ("transport/link/tx/lease", LEASE_MS.to_string()),
            ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", PATIENCE_US.to_string()),
            (
                "transport/link/tx/queue/congestion_control/block/wait_before_close",
                MAX_BLOCKED_US.to_string(),
            ),
        ];
        settings.extend([
            ("transport/link/rx/max_message_size", message_bytes.to_string()),
            ("transport/unicast/max_sessions", links.to_string()),
            ("transport/unicast/accept_pending", MAX_PENDING.to_string()),
            ("transport/unicast/accept_timeout", ACCEPT_TIMEOUT_MS.to_string()),
        ]);
        // Peers need no link states of each other, whose reader can be brought to panic; and who is told the identifier of
        // a session takes its place while its link is down.
        if self.mode == Mode::Peer {
            settings.push(("scouting/gossip/enabled", "false".into()));
        }
        if self.routes {
            zenoh_codec::network::accept_link_states();
        }
        if self.waits {
            settings.push(("connect/timeout_ms", "-1".into()));
        }
        if self.link == Link::Radio {
            settings.push(("transport/link/tx/batch_size", RADIO_BATCH_BYTES.to_string()));
        }
        settings.extend(security::settings(self)?);
        for (key, value) in settings {
            config.insert_json5(key, &value).map_err(failed)?;
        }
        zenoh::open(config).await.map_err(failed)
    }

    /// Endpoints as Zenoh reads them: those with TLS refuse the certificates that are excluded, and those that have too many
    /// of the `places` for sessions that come in.
    fn guarded(&self, endpoints: &[String], places: Option<usize>) -> String {
        let guarded = |endpoint: &String| security::guarded(endpoint, &self.tls.excluded, places);
        serde_json::json!(endpoints.iter().map(guarded).collect::<Vec<_>>()).to_string()
    }

    /// Longest message that is taken, bytes, and links at a time.
    fn bounds(&self) -> (usize, usize) {
        match (self.mode, self.is_vehicle()) {
            (Mode::Router, _) => (MAX_PASSED_BYTES, MAX_LINKS_ON_GROUND),
            (_, true) => (MAX_MESSAGE_BYTES, MAX_LINKS),
            (_, false) => (read::MAX_MESSAGE_BYTES + MAX_MESSAGE_BYTES, MAX_LINKS_ON_GROUND),
        }
    }

    /// Error of a session that cannot be opened: by its last attempt to connect where there was one, else as Zenoh says.
    fn failed(&self, message: &str) -> NetError {
        let attempt = self.connect.first().and_then(|endpoint| diagnosis::newest_attempt(endpoint));
        let message = match (attempt, self.connect.first()) {
            (Some(reason), Some(endpoint)) => diagnosis::explain(endpoint, &reason),
            _ => diagnosis::plain_words(message),
        };
        NetError::Open { listen: self.listen.clone(), connect: self.connect.clone(), message }
    }
}
