//! Role, endpoints and credentials of a session.

use super::error::NetError;
use plumbline_config::options::{CommandAccess, Link, LoginConfig, NetworkConfig, TlsConfig};

/// An attempt to connect is given up after this, ms: over a link that was down, the next one succeeds sooner
/// than the retransmissions of the last.
const OPEN_TIMEOUT_MS: u64 = 2_000;

/// Role of a session in the network.
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

/// Role, endpoints and credentials of a session.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoints {
    /// Role in the network.
    pub mode: Mode,
    /// Opening as a client waits until somebody is there.
    pub waits: bool,
    /// Name of the vehicle in the keys.
    pub vehicle: String,
    /// Vehicles that are listened to, by the names of their certificates; a vehicle listens to none.
    pub hears: Vec<String>,
    /// Endpoints to listen on.
    pub listen: Vec<String>,
    /// Endpoints to connect to.
    pub connect: Vec<String>,
    /// An attempt to connect is given up after this, ms.
    pub open_timeout_ms: u64,
    /// Multicast scouting.
    pub scouting: bool,
    /// A router exchanges routes with other routers.
    pub routes: bool,
    /// Capacity of the link.
    pub link: Link,
    /// Memory limit of a vehicle's session, MB (10^6 bytes).
    pub max_memory_mb: u32,
    /// Clients that may give commands.
    pub commands: CommandAccess,
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
            hears: Vec::new(),
            listen: config.listen.clone(),
            connect: config.connect.clone(),
            open_timeout_ms: OPEN_TIMEOUT_MS,
            scouting: config.scouting,
            routes: false,
            link: config.link,
            max_memory_mb: config.max_memory_mb,
            commands: config.commands,
            tls: config.tls.clone(),
            login: config.login.clone(),
        }
    }

    /// True if this is a vehicle's own session.
    #[must_use]
    pub fn is_vehicle(&self) -> bool {
        self.hears.is_empty()
    }

    /// Returns the endpoints with more to listen on and to connect to.
    #[must_use]
    pub fn and(mut self, listen: &[String], connect: &[String]) -> Self {
        self.listen.extend_from_slice(listen);
        self.connect.extend_from_slice(connect);
        self
    }

    /// Endpoints with streams, for everything, and those that begin with `udp/`, for odometry alone
    /// ([`datagrams`]). If all are of the latter kind, they are for everything.
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

    pub(super) fn check_signed(&self) -> Result<(), NetError> {
        match self.listen.iter().chain(&self.connect).find(|endpoint| self.tls.is_given() && is_udp(endpoint))
        {
            None => Ok(()),
            Some(udp) => Err(NetError::Datagrams {
                endpoint: udp.clone(),
                cure: "datagrams carry no certificate: leave it out, or leave out the certificates",
            }),
        }
    }
}

pub(super) fn is_udp(endpoint: &str) -> bool {
    endpoint.starts_with("udp/")
}

/// True if an endpoint such as `tcp/127.0.0.1:7447` is this host's alone.
#[must_use]
pub fn is_loopback(endpoint: &str) -> bool {
    let address = endpoint.split_once('/').map_or(endpoint, |(_, address)| address);
    let host = address.split(['?', '#']).next().and_then(|a| a.rsplit_once(':')).map_or("", |(host, _)| host);
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn connecting_to(endpoints: &[&str]) -> Endpoints {
        Endpoints { connect: endpoints.iter().map(|e| (*e).to_owned()).collect(), ..Endpoints::default() }
    }

    #[test]
    fn loopback_is_told_from_the_rest() {
        for endpoint in ["tcp/127.0.0.1:7447", "tcp/localhost:1", "udp/[::1]:7447", "tls/127.1.2.3:7#a=b"] {
            assert!(is_loopback(endpoint), "{endpoint}");
        }
        for endpoint in
            ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/10.0.0.1:7447", "tcp/localhost.evil:1", "x"]
        {
            assert!(!is_loopback(endpoint), "{endpoint}");
        }
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
