//! Zenoh sessions that listen only where they are told to.

use plumbline_config::options::NetworkConfig;
use thiserror::Error;
use zenoh::Session;

/// Why the network cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NetError {
    /// A session cannot be opened.
    #[error("cannot open a Zenoh session (listen {listen:?}, connect {connect:?}): {message}")]
    Open {
        /// Where it was to listen.
        listen: Vec<String>,
        /// Where it was to connect.
        connect: Vec<String>,
        /// What Zenoh said.
        message: String,
    },
    /// A key cannot be declared.
    #[error("cannot declare '{key}': {message}")]
    Declare {
        /// The key.
        key: String,
        /// What Zenoh said.
        message: String,
    },
    /// The network's own thread cannot be started.
    #[error("cannot start the network thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// Who we are and whom we talk to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoints {
    /// Name of the vehicle in the keys.
    pub vehicle: String,
    /// Endpoints to listen on.
    pub listen: Vec<String>,
    /// Endpoints to connect to.
    pub connect: Vec<String>,
    /// Multicast scouting.
    pub scouting: bool,
}

impl Endpoints {
    /// As configured.
    #[must_use]
    pub fn of(config: &NetworkConfig) -> Self {
        Self {
            vehicle: config.vehicle.clone(),
            listen: config.listen.clone(),
            connect: config.connect.clone(),
            scouting: config.scouting,
        }
    }

    /// The same, listening on more.
    #[must_use]
    pub fn and_listen(mut self, listen: &[String]) -> Self {
        self.listen.extend_from_slice(listen);
        self
    }

    /// Opens a session.
    ///
    /// # Errors
    /// When an endpoint is malformed, taken or out of reach.
    pub async fn open(&self) -> Result<Session, NetError> {
        let failed = |error: zenoh::Error| NetError::Open {
            listen: self.listen.clone(),
            connect: self.connect.clone(),
            message: error.to_string(),
        };
        let mut config = zenoh::Config::default();
        let list = |endpoints: &[String]| serde_json::to_string(endpoints).unwrap_or_else(|_| "[]".into());
        let settings = [
            ("mode", "\"peer\"".to_owned()),
            ("listen/endpoints", list(&self.listen)),
            ("connect/endpoints", list(&self.connect)),
            ("scouting/multicast/enabled", self.scouting.to_string()),
        ];
        for (key, value) in settings {
            config.insert_json5(key, &value).map_err(failed)?;
        }
        zenoh::open(config).await.map_err(failed)
    }
}
