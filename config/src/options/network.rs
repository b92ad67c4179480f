//! Network: identity, endpoints and permissions.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Publication over Zenoh. By default there is no listener.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NetworkConfig {
    /// Name of this vehicle in the keys `plumbline/<vehicle>/...`.
    pub vehicle: String,
    /// Zenoh endpoints to listen on, such as `tcp/127.0.0.1:7447`.
    pub listen: Vec<String>,
    /// Zenoh endpoints to connect to. If there are others, `udp/` endpoints carry odometry only.
    pub connect: Vec<String>,
    /// Multicast scouting.
    pub scouting: bool,
    /// Capacity of the link, which determines the rate of each key.
    pub link: Link,
    /// Offer camera pictures if the link can carry them.
    pub camera: bool,
    /// Memory that peers may occupy in the network process, MB. If they exceed it, the network process ends and is
    /// restarted.
    pub max_memory_mb: u32,
    /// Clients that may give commands.
    pub commands: Commands,
    /// Certificates.
    pub tls: TlsConfig,
    /// Names and passwords.
    pub login: LoginConfig,
}

impl Default for NetworkConfig {
    fn default() -> Self {
        Self {
            vehicle: "drone".into(),
            listen: Vec::new(),
            connect: Vec::new(),
            scouting: false,
            link: Link::Lan,
            camera: true,
            max_memory_mb: 96,
            commands: Commands::Authenticated,
            tls: TlsConfig::default(),
            login: LoginConfig::default(),
        }
    }
}

/// Capacity of a link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Link {
    /// A cable: everything.
    #[default]
    Lan,
    /// Wireless LAN: some megabits, now and then a stall.
    Wifi,
    /// A telemetry radio: some ten kilobits.
    Radio,
}

/// Clients that may give commands to a vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Commands {
    /// No client.
    Nobody,
    /// Processes of this host, and operators with a certificate. Refused while an unauthenticated listener is open to
    /// other hosts.
    #[default]
    Authenticated,
    /// Every client that can reach the vehicle.
    Anybody,
}

/// Certificates for `tls/...` endpoints; empty paths for none. The name of a peer's certificate is its role, such as
/// `operator.1` or `vehicle:drone.2`, as `plumbline keys` makes them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TlsConfig {
    /// Certificate of the common authority, PEM file.
    pub authority: PathBuf,
    /// Certificate of this vehicle, PEM file.
    pub certificate: PathBuf,
    /// Private key of the certificate, PEM file, readable by its owner only.
    pub key: PathBuf,
    /// Revoked certificates, by name: `operator.1` for one, `operator` for all operator certificates.
    pub excluded: Vec<String>,
}

impl TlsConfig {
    /// Whether there are any.
    #[must_use]
    pub fn is_given(&self) -> bool {
        [&self.authority, &self.certificate, &self.key].iter().any(|path| !path.as_os_str().is_empty())
    }
}

/// Whether this names a certificate, such as `operator.1`, or all of a holder, such as `vehicle:drone`.
#[must_use]
pub fn is_certificate_name(text: &str) -> bool {
    let (holder, number) = text.rsplit_once('.').unwrap_or((text, "1"));
    let is_number = number.parse::<u32>().is_ok_and(|number| number > 0);
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    let is_vehicle = |name: &str| !name.is_empty() && name.chars().all(is_plain);
    is_number
        && (matches!(holder, "viewer" | "operator" | "router")
            || holder.strip_prefix("vehicle:").is_some_and(is_vehicle))
}

/// Names and passwords, where certificates are too much. Without TLS they keep out the curious, not the
/// malicious.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LoginConfig {
    /// Own user name for outgoing connections; empty for none.
    pub user: String,
    /// File with the own password on its first line.
    pub password_file: PathBuf,
    /// File with a line `name:password` for each user who may connect.
    pub users_file: PathBuf,
    /// User names that may give commands, if commands are accepted.
    pub operators: Vec<String>,
}
