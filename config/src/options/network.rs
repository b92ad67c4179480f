//! Network: identity, endpoints and permissions.

use plumbline_keys::keys;
use std::path::PathBuf;

/// Publication over Zenoh. By default there is no listener.
#[keys]
pub struct NetworkConfig {
    /// Name of this vehicle in the keys `plumbline/<vehicle>/...`: letters, digits, `-`, `_`.
    #[key(default = "drone")]
    pub vehicle: String,
    /// Endpoints to listen on, such as "tcp/127.0.0.1:7447".
    #[key(default)]
    pub listen: Vec<String>,
    /// Endpoints to connect to, such as "tls/10.0.0.1:7447".
    #[key(default)]
    pub connect: Vec<String>,
    /// Multicast scouting.
    #[key(default = false)]
    pub scouting: bool,
    /// Capacity of the link: "lan" (everything), "wifi" (fewer messages, smaller pictures) or "radio" (poses and keyframes
    /// only, a few per second).
    #[key(default)]
    pub link: Link,
    /// Offer camera pictures if the link can carry them. They are encoded only while a client subscribes.
    #[key(default = true)]
    pub camera: bool,
    /// Memory that peers may occupy in the network process. If they exceed it, for example by declaring keys without
    /// end, the network process ends and is restarted. The flight is not affected.
    #[key(default = 96, range = 8..=4096, unit = MEGABYTES)]
    pub max_memory_mb: u32,
    /// Clients that may give commands: "nobody"; "authenticated" (processes of this host, and operators with a certificate;
    /// refused while an unauthenticated listener is open); or "anybody".
    #[key(default)]
    pub commands: CommandAccess,
    /// Certificates for `tls/` endpoints, PEM files from `plumbline keys`; empty for none.
    #[key(default)]
    pub tls: TlsConfig,
}

/// Capacity of a link.
#[keys("lowercase")]
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
#[keys("lowercase")]
pub enum CommandAccess {
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
#[keys]
#[derive(Eq)]
pub struct TlsConfig {
    /// Certificate of the common authority.
    #[key(default)]
    pub authority: PathBuf,
    /// Certificate of this vehicle.
    #[key(default)]
    pub certificate: PathBuf,
    /// Private key, readable by its owner only (chmod 600).
    #[key(default)]
    pub key: PathBuf,
    /// Revoked certificates, by the names that `plumbline keys` prints: "operator.1" for one, "operator" for all operator
    /// certificates.
    #[key(default)]
    pub excluded: Vec<String>,
}

impl TlsConfig {
    /// True if there are any.
    pub fn is_given(&self) -> bool {
        [&self.authority, &self.certificate, &self.key].iter().any(|path| !path.as_os_str().is_empty())
    }
}

/// True if this names a certificate, such as `operator.1`, or all of a holder, such as `vehicle:drone`.
pub fn is_certificate_name(text: &str) -> bool {
    let (holder, number) = text.rsplit_once('.').unwrap_or((text, "1"));
    let is_number = number.parse::<u32>().is_ok_and(|number| number > 0);
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    let is_vehicle = |name: &str| !name.is_empty() && name.chars().all(is_plain);
    is_number
        && (matches!(holder, "viewer" | "operator" | "router")
            || holder.strip_prefix("vehicle:").is_some_and(is_vehicle))
}
