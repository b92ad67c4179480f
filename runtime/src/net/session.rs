//! Zenoh sessions that listen only where they are told to.

use super::{diagnosis, security};
use plumbline_config::options::{Link, LoginConfig, NetworkConfig, TlsConfig};
use std::path::PathBuf;
use thiserror::Error;
use zenoh::Session;

/// A link that is silent for so long has gone, ms: a lost vehicle is noticed, and a new link is tried, soon.
const LEASE_MS: u64 = 4_000;
/// An attempt to connect is given up after this, ms: over a link that was down, the next one succeeds sooner
/// than the retransmissions of the last.
const OPEN_TIMEOUT_MS: u64 = 2_000;
/// Attempts to connect come this soon after each other, ms: the system itself repeats the first packet of one after a
/// second, so that hardly a second passes without a chance.
const RETRY_MS: (u64, u64) = (50, 200);
/// A message waits this long for room before it is dropped, us. Odometry waits on the thread that makes room for the
/// others, so that it be short.
const PATIENCE_US: u64 = 5_000;
/// Largest batch on a telemetry radio, bytes: what waits behind one is late by its length.
const RADIO_BATCH_BYTES: u64 = 1_200;

/// Why the network cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NetError {
    /// A session cannot be opened.
    #[error("{}: {message}", connect.iter().chain(listen).cloned().collect::<Vec<_>>().join(", "))]
    Open {
        /// Where it was to listen.
        listen: Vec<String>,
        /// Where it was to connect.
        connect: Vec<String>,
        /// Why, and what to do.
        message: String,
    },
    /// An endpoint that cannot work.
    #[error("endpoint {endpoint}: {reason}")]
    Endpoint {
        /// The endpoint.
        endpoint: String,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// Somebody listens there already.
    #[error("{endpoint}: another process listens there; end it, or choose another port")]
    Taken {
        /// The endpoint.
        endpoint: String,
    },
    /// A key cannot be declared.
    #[error("cannot declare '{key}': {message}")]
    Declare {
        /// The key.
        key: String,
        /// What Zenoh said.
        message: String,
    },
    /// A file of the configuration cannot be used.
    #[error("{path}: {message} ({key})")]
    File {
        /// The file.
        path: PathBuf,
        /// The key of the configuration, or the option, that names it.
        key: &'static str,
        /// What is wrong, and what to do.
        message: String,
    },
    /// Datagrams where they cannot be.
    #[error("{endpoint}: {cure}")]
    Datagrams {
        /// The endpoint.
        endpoint: String,
        /// What is wrong, and what to do.
        cure: &'static str,
    },
    /// The network's own thread cannot be started.
    #[error("cannot start the network thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// What a session is to the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Talks to those it is connected to.
    #[default]
    Peer,
    /// Talks to the one it is connected to, and through it: a router passes nothing on between two peers. Opening
    /// fails while nobody is there, unless it waits.
    Client,
    /// Passes messages on between those who are connected to it.
    Router,
}

/// Who we are and whom we talk to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoints {
    /// What we are to the others.
    pub mode: Mode,
    /// Opening as a client waits until somebody is there.
    pub waits: bool,
    /// Name of the vehicle in the keys.
    pub vehicle: String,
    /// Endpoints to listen on.
    pub listen: Vec<String>,
    /// Endpoints to connect to.
    pub connect: Vec<String>,
    /// An attempt to connect is given up after this, ms.
    pub open_timeout_ms: u64,
    /// Multicast scouting.
    pub scouting: bool,
    /// What the link can carry.
    pub link: Link,
    /// Certificates.
    pub tls: TlsConfig,
    /// Names and passwords.
    pub login: LoginConfig,
}

impl Default for Endpoints {
    fn default() -> Self {
        Self::of(&NetworkConfig::default())
    }
}

impl Endpoints {
    /// As configured.
    #[must_use]
    pub fn of(config: &NetworkConfig) -> Self {
        Self {
            mode: Mode::Peer,
            waits: false,
            vehicle: config.vehicle.clone(),
            listen: config.listen.clone(),
            connect: config.connect.clone(),
            open_timeout_ms: OPEN_TIMEOUT_MS,
            scouting: config.scouting,
            link: config.link,
            tls: config.tls.clone(),
            login: config.login.clone(),
        }
    }

    /// The same, listening and connecting to more.
    #[must_use]
    pub fn and(mut self, listen: &[String], connect: &[String]) -> Self {
        self.listen.extend_from_slice(listen);
        self.connect.extend_from_slice(connect);
        self
    }

    /// Those that take streams, for everything, and those that begin with `udp/`, for odometry alone ([`datagrams`]);
    /// where there are only such, they are for everything.
    ///
    /// [`datagrams`]: super::datagrams
    ///
    /// # Errors
    /// When odometry in datagrams would pass somebody by, or stand beside certificates, which datagrams cannot show.
    pub fn split(&self) -> Result<(Self, Option<Self>), NetError> {
        self.check_signed()?;
        let (udp, streams): (Vec<_>, Vec<_>) = self.connect.iter().cloned().partition(|e| is_udp(e));
        if udp.is_empty() || streams.is_empty() {
            return Ok((self.clone(), None));
        }
        if udp.len() + streams.len() > 2 || !self.listen.is_empty() || self.scouting {
            return Err(NetError::Datagrams {
                endpoint: udp.join(", "),
                cure: "odometry would go there alone: connect to one other endpoint, and neither listen nor scout, or \
                       leave it out",
            });
        }
        let datagrams = Self { connect: udp, ..self.clone() };
        Ok((Self { connect: streams, ..self.clone() }, Some(datagrams)))
    }

    fn check_signed(&self) -> Result<(), NetError> {
        match self.listen.iter().chain(&self.connect).find(|endpoint| self.tls.is_given() && is_udp(endpoint))
        {
            None => Ok(()),
            Some(udp) => Err(NetError::Datagrams {
                endpoint: udp.clone(),
                cure: "datagrams carry no certificate: leave it out, or leave out the certificates",
            }),
        }
    }

    /// Refuses endpoints that cannot work.
    ///
    /// # Errors
    /// When one is malformed, taken, not this host's, or lacks certificates.
    pub fn check(&self) -> Result<(), NetError> {
        self.check_signed()?;
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
        let mut settings = vec![
            ("mode", mode.to_owned()),
            ("listen/endpoints", serde_json::json!(self.listen).to_string()),
            ("connect/endpoints", serde_json::json!(self.connect).to_string()),
            ("connect/retry", retry.to_string()),
            ("scouting/multicast/enabled", self.scouting.to_string()),
            ("transport/unicast/open_timeout", self.open_timeout_ms.to_string()),
            ("transport/link/tx/lease", LEASE_MS.to_string()),
            ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", PATIENCE_US.to_string()),
        ];
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

    /// Why a session cannot be opened: by its last attempt to connect where there was one, else as Zenoh says.
    fn failed(&self, message: &str) -> NetError {
        let attempt = self.connect.first().and_then(|endpoint| diagnosis::newest_attempt(endpoint));
        let message = match (attempt, self.connect.first()) {
            (Some(reason), Some(endpoint)) => diagnosis::explain(endpoint, &reason),
            _ => diagnosis::plain_words(message),
        };
        NetError::Open { listen: self.listen.clone(), connect: self.connect.clone(), message }
    }
}

fn is_udp(endpoint: &str) -> bool {
    endpoint.starts_with("udp/")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn connecting_to(endpoints: &[&str]) -> Endpoints {
        Endpoints { connect: endpoints.iter().map(|e| (*e).to_owned()).collect(), ..Endpoints::default() }
    }

    #[test]
    fn datagrams_beside_streams_are_for_odometry_and_alone_for_everything() {
        let (streams, datagrams) = connecting_to(&["udp/a:1", "tcp/a:1"]).split().unwrap();
        assert_eq!(
            (streams.connect, datagrams.unwrap().connect),
            (vec!["tcp/a:1".into()], vec!["udp/a:1".into()])
        );
        let (all, none) = connecting_to(&["udp/a:1"]).split().unwrap();
        assert_eq!((all.connect, none), (vec!["udp/a:1".to_owned()], None));
    }

    #[test]
    fn datagrams_that_would_pass_somebody_by_are_refused() {
        let listen = vec!["tcp/127.0.0.1:1".to_owned()];
        let also_listening = Endpoints { listen, ..connecting_to(&["tcp/a:1", "udp/a:1"]) };
        for endpoints in [also_listening, connecting_to(&["tcp/a:1", "tcp/b:1", "udp/a:1"])] {
            let error = endpoints.split().unwrap_err().to_string();
            assert!(error.contains("udp/a:1: odometry would go there alone"), "{error}");
        }
    }

    #[test]
    fn datagrams_beside_certificates_are_refused() {
        let tls = TlsConfig { authority: "a.pem".into(), ..TlsConfig::default() };
        let error =
            Endpoints { tls, ..connecting_to(&["tls/a:1", "udp/a:1"]) }.split().unwrap_err().to_string();
        assert!(error.contains("udp/a:1: datagrams carry no certificate"), "{error}");
    }
}
