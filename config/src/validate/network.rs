//! Validation of names and addresses on the network.

use crate::error::Violation;
use crate::options::{NetworkConfig, TlsConfig, is_certificate_name};

/// Longest vehicle name: it is part of every key on the wire.
const MAX_VEHICLE_BYTES: usize = 64;
/// Most endpoints of a kind, and the longest of them.
const MAX_ENDPOINTS: usize = 16;
const MAX_ENDPOINT_BYTES: usize = 256;
/// Protocols that the runtime is built with.
const PROTOCOLS: [&str; 2] = ["tcp", "tls"];

pub(super) fn check(network: &NetworkConfig, found: &mut Vec<Violation>) {
    // One chunk of a Zenoh key: `/` would split it, `*`, `$`, `#` and `?` have meanings there.
    let vehicle = &network.vehicle;
    let is_plain = vehicle.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_'));
    if !is_plain || !(1..=MAX_VEHICLE_BYTES).contains(&vehicle.len()) {
        let reason = format!("{} is no chunk of a key on the wire", shortened(vehicle));
        let cure = format!("use 1 to {MAX_VEHICLE_BYTES} of a-z, A-Z, 0-9, `-`, `_`, such as \"drone-1\"");
        found.push(Violation::new("network.vehicle", reason, cure));
    }
    for (name, endpoints) in [("listen", &network.listen), ("connect", &network.connect)] {
        if endpoints.len() > MAX_ENDPOINTS {
            let reason = format!("there are {} endpoints", endpoints.len());
            let cure = format!("give at most {MAX_ENDPOINTS}");
            found.push(Violation::new(format!("network.{name}"), reason, cure));
        }
        for (i, endpoint) in endpoints.iter().enumerate().filter(|(_, e)| !is_endpoint(e)) {
            found.push(no_endpoint(format!("network.{name}[{i}]"), endpoint));
        }
    }
    check_identity(network, found);
}

/// Certificates come together, and with endpoints that use them.
fn check_identity(network: &NetworkConfig, found: &mut Vec<Violation>) {
    let TlsConfig { authority, certificate, key, excluded } = &network.tls;
    for (name, path) in [("authority", authority), ("certificate", certificate), ("key", key)] {
        if network.tls.is_given() && path.as_os_str().is_empty() {
            let cure = "give all three files of [network.tls], as `plumbline keys` writes them, or none";
            found.push(Violation::new(format!("network.tls.{name}"), "is empty beside the others", cure));
        }
    }
    let uses_tls = network.listen.iter().chain(&network.connect).any(|e| e.starts_with("tls/"));
    if uses_tls && !network.tls.is_given() {
        let cure = "give the files that `plumbline keys` writes";
        found.push(Violation::new("network.tls", "is empty, but an endpoint begins with tls/", cure));
    }
    for (i, name) in excluded.iter().enumerate().filter(|(_, name)| !is_certificate_name(name)) {
        let cure = "write the name that `plumbline keys` tells: operator.1 for one certificate, operator for all of them";
        let reason = format!("{} names no certificate", shortened(name));
        found.push(Violation::new(format!("network.tls.excluded[{i}]"), reason, cure));
    }
}

pub(super) fn no_endpoint(key: String, text: &str) -> Violation {
    let cure = "write protocol/host:port with tcp or tls, such as \"tcp/127.0.0.1:7447\"";
    Violation::new(key, format!("{} is no endpoint", shortened(text)), cure)
}

pub(crate) fn is_endpoint(text: &str) -> bool {
    let Some((protocol, address)) = text.split_once('/') else { return false };
    // `?metadata` and `#configuration` may follow the address.
    let address = address.split(['?', '#']).next().unwrap_or_default();
    let Some((host, port)) = address.rsplit_once(':') else { return false };
    text.len() <= MAX_ENDPOINT_BYTES
        && text.chars().all(|c| c.is_ascii_graphic())
        && PROTOCOLS.contains(&protocol)
        && !host.is_empty()
        && port.parse::<u16>().is_ok()
}

pub(super) fn shortened(text: &str) -> String {
    let mut short: String = text.chars().take(80).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    format!("{short:?}")
}
