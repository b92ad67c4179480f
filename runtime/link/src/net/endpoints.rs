//! Role, endpoints and credentials of a session.

use plumbline_config::options::{CommandAccess, Link, NetworkConfig, TlsConfig};

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
}

impl Default for Endpoints {
    fn default() -> Self {
        Self::of(&NetworkConfig::default())
    }
}

impl Endpoints {
    /// As configured.
    pub fn of(config: &NetworkConfig) -> Self {
        Self {
            mode: Mode::Peer,
            waits: false,
            vehicle: config.vehicle.clone(),
            hears: Vec::new(),
            listen: config.listen.clone(),
            connect: config.connect.clone(),
            scouting: config.scouting,
            routes: false,
            link: config.link,
            max_memory_mb: config.max_memory_mb,
            commands: config.commands,
            tls: config.tls.clone(),
        }
    }

    /// True if this is a vehicle's own session.
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
}

/// True if an endpoint such as `tcp/127.0.0.1:7447` is this host's alone.
pub fn is_loopback(endpoint: &str) -> bool {
    let address = endpoint.split_once('/').map_or(endpoint, |(_, address)| address);
    let host = address.split(['?', '#']).next().and_then(|a| a.rsplit_once(':')).map_or("", |(host, _)| host);
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_is_told_from_the_rest() {
        for endpoint in ["tcp/127.0.0.1:7447", "tcp/localhost:1", "tcp/[::1]:7447", "tls/127.1.2.3:7#a=b"] {
            assert!(is_loopback(endpoint), "{endpoint}");
        }
        for endpoint in
            ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/10.0.0.1:7447", "tcp/localhost.evil:1", "x"]
        {
            assert!(!is_loopback(endpoint), "{endpoint}");
        }
    }
}
