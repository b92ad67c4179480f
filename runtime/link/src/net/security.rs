//! Authentication: settings for Zenoh, and where commands are refused to every client.
//!
//! With certificates every link is mutual TLS, and the name of a peer's certificate is its role ([`super::roles`]).
//! Over plain TCP a peer is unknown, and others can read the traffic: beyond this host, commands are refused there.
//! Only a listener on the loopback interface counts as this host: behind a link that we opened there may be a router
//! that listens openly.

use super::certificate;
use super::endpoints::Endpoints;
pub use super::endpoints::is_loopback;
use super::error::NetError;
use super::roles;
use plumbline_config::options::CommandAccess;
use serde_json::{Value, json};
use std::fs::File;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

/// Settings of Zenoh for certificates and access; empty when there are none.
///
/// # Errors
/// When a file cannot be read, others may read a secret one, or the certificate is not this vehicle's.
pub fn settings(endpoints: &Endpoints) -> Result<Vec<(&'static str, String)>, NetError> {
    let tls = &endpoints.tls;
    if !tls.is_given() {
        return Ok(Vec::new());
    }
    readable("network.tls.authority", &tls.authority)?;
    readable("network.tls.certificate", &tls.certificate)?;
    secret("network.tls.key", &tls.key)?;
    check_name(endpoints)?;
    Ok(vec![
        ("transport/link/tls", tls_settings(endpoints).to_string()),
        // Whoever is connected could have us connect to others, over plain TCP and to this host too.
        ("scouting/gossip/autoconnect", "[]".into()),
        ("access_control", roles::access(endpoints).to_string()),
    ])
}

fn tls_settings(endpoints: &Endpoints) -> Value {
    let tls = &endpoints.tls;
    json!({
        "root_ca_certificate": tls.authority,
        "listen_certificate": tls.certificate,
        "listen_private_key": tls.key,
        "connect_certificate": tls.certificate,
        "connect_private_key": tls.key,
        "enable_mtls": true,
        "verify_name_on_connect": true,
        "close_link_on_expiration": true,
    })
}

/// Keys of an endpoint's configuration that the TLS links of `runtime/link/vendor/zenoh-link-tls` know.
const PLACES: &str = "places";
const EXCLUDED_NAMES: &str = "excluded_names";
/// Sessions of one certificate at a time.
const MAX_SESSIONS_PER_CERTIFICATE: usize = 8;
/// Places that only operators may take.
const PLACES_FOR_OPERATORS: usize = 4;

/// An endpoint whose TLS handshakes refuse the certificates of these names; a listener also bounds the sessions that come in:
/// `places` for all certificates together.
pub fn guarded(endpoint: &str, excluded: &[String], places: Option<usize>) -> String {
    if !endpoint.starts_with("tls/") {
        return endpoint.to_owned();
    }
    let mut guarded = endpoint.to_owned();
    let mut set = |key: &str, value: String| {
        let separator = if guarded.contains('#') { ';' } else { '#' };
        guarded.push_str(&format!("{separator}{key}={value}"));
    };
    if let Some(places) = places {
        let (each, kept, role) = (MAX_SESSIONS_PER_CERTIFICATE, PLACES_FOR_OPERATORS, certificate::OPERATOR);
        set(PLACES, format!("{places}|{each}|{kept}|{role}"));
    }
    if !excluded.is_empty() {
        set(EXCLUDED_NAMES, excluded.join("|"));
    }
    guarded
}

/// The endpoint of which [`guarded`] has made this one.
pub fn as_given(endpoint: &str) -> &str {
    let is_ours = |at: &usize| {
        let setting = &endpoint[*at + 1..];
        [PLACES, EXCLUDED_NAMES]
            .iter()
            .any(|key| setting.split_once('=').is_some_and(|(name, _)| name == *key))
    };
    let at = endpoint.match_indices(['#', ';']).map(|(at, _)| at).find(is_ours);
    at.map_or(endpoint, |at| &endpoint[..at])
}

/// Reason why commands are refused whoever gives them; `None` when the access rules decide.
pub fn refusal(commands: CommandAccess, endpoints: &Endpoints) -> Option<String> {
    match commands {
        CommandAccess::Anybody => return None,
        CommandAccess::Nobody => {
            return Some("this vehicle takes no commands: network.commands is \"nobody\"".into());
        }
        CommandAccess::Authenticated => {}
    }
    let cure = "others can read what is sent there, too; give certificates in [network.tls] and endpoints that begin \
                with tls/, or set network.commands";
    let has_certificates = endpoints.tls.is_given();
    if endpoints.scouting && !has_certificates {
        return Some(format!("commands are refused: multicast scouting lets anybody in; {cure}"));
    }
    let is_signed = |endpoint: &String| endpoint.starts_with("tls/") && has_certificates;
    if let Some(open) = endpoints.listen.iter().find(|e| !is_loopback(e) && !is_signed(e)) {
        return Some(format!("commands are refused: anybody can connect to {open}; {cure}"));
    }
    let open = endpoints.connect.iter().find(|e| !is_signed(e));
    open.map(|open| {
        format!(
            "commands are refused: {open} carries commands without authentication, and others may reach it; {cure}"
        )
    })
}

/// Warning of what others can read and do over plain TCP; `None` if there is nothing of that kind.
pub fn exposure(endpoints: &Endpoints) -> Option<String> {
    let mut all = endpoints.listen.iter().chain(&endpoints.connect);
    let open = all.find(|endpoint| !is_loopback(endpoint) && !endpoint.starts_with("tls/"))?;
    Some(format!(
        "{open}: others can read what is sent there, and answer in our name; certificates ([network.tls], or \
         --authority, --certificate and --key) and tls/ keep them out"
    ))
}

/// A vehicle whose certificate is for another would be believed by nobody.
fn check_name(endpoints: &Endpoints) -> Result<(), NetError> {
    if !endpoints.is_vehicle() {
        return Ok(());
    }
    let vehicle = &endpoints.vehicle;
    let path = &endpoints.tls.certificate;
    let name = certificate::name_in(path).unwrap_or_default();
    let is_ours = certificate::parse(&name)
        .is_some_and(|(holder, _)| certificate::vehicle_of(holder) == Some(vehicle.as_str()));
    if is_ours {
        return Ok(());
    }
    let message = format!(
        "belongs to '{}', so peers reject '{vehicle}' with it; make one with `plumbline keys FOLDER --vehicle \
         {vehicle}` (vehicle.pem is for 'drone'), or set network.vehicle",
        super::plain(&name)
    );
    Err(file_error("network.tls.certificate", path, &message))
}

fn file_error(key: &'static str, path: &Path, message: &str) -> NetError {
    NetError::File { path: path.to_owned(), key, message: message.to_owned() }
}

fn readable(key: &'static str, path: &Path) -> Result<std::fs::Metadata, NetError> {
    let cannot = |error: std::io::Error| file_error(key, path, &format!("cannot be read: {error}"));
    let metadata = File::open(path).and_then(|file| file.metadata()).map_err(cannot)?;
    if metadata.is_file() { Ok(metadata) } else { Err(file_error(key, path, "is not a file")) }
}

/// Checks that a file's owner alone may read it; a service may also read one of root's by its group.
///
/// # Errors
/// When it cannot be read, or others may.
pub fn secret(key: &'static str, path: &Path) -> Result<(), NetError> {
    /// Bits of the mode: the group may write or execute, others may do anything; and the group may read.
    const OTHERS: u32 = 0o037;
    const GROUP_READS: u32 = 0o040;
    let metadata = readable(key, path)?;
    let is_open =
        metadata.mode() & OTHERS != 0 || (metadata.mode() & GROUP_READS != 0 && metadata.uid() != 0);
    if !is_open {
        return Ok(());
    }
    let mode = metadata.mode() & 0o777;
    let message = format!("may be read by others (mode {mode:03o}); chmod 600 {}", path.display());
    Err(file_error(key, path, &message))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::keys::{self, KeysRequest};
    use plumbline_config::options::TlsConfig;
    use std::os::unix::fs::PermissionsExt as _;

    fn listening_on(endpoint: &str) -> Endpoints {
        Endpoints { listen: vec![endpoint.into()], ..Endpoints::default() }
    }

    fn connecting_to(endpoint: &str) -> Endpoints {
        Endpoints { connect: vec![endpoint.into()], ..Endpoints::default() }
    }

    #[test]
    fn a_router_of_this_host_may_listen_openly() {
        assert!(refusal(CommandAccess::Authenticated, &connecting_to("tcp/127.0.0.1:7447")).is_some());
        let tls = TlsConfig { authority: "a".into(), ..TlsConfig::default() };
        let signed = Endpoints { tls, ..connecting_to("tls/127.0.0.1:7447") };
        assert_eq!(refusal(CommandAccess::Authenticated, &signed), None);
    }

    #[test]
    fn what_others_can_read_is_said() {
        assert!(exposure(&listening_on("tcp/0.0.0.0:7447")).unwrap().contains("tcp/0.0.0.0:7447"));
        assert!(exposure(&connecting_to("tcp/10.0.0.1:7447")).is_some());
        for endpoint in ["tcp/127.0.0.1:7447", "tls/0.0.0.0:7447"] {
            assert_eq!(exposure(&listening_on(endpoint)), None);
        }
    }

    #[test]
    fn a_missing_file_is_named_with_its_key() {
        let authority = "/nowhere/ca.pem".into();
        let tls = TlsConfig { authority, ..TlsConfig::default() };
        let error = settings(&Endpoints { tls, ..Endpoints::default() }).unwrap_err().to_string();
        assert!(error.contains("/nowhere/ca.pem") && error.contains("network.tls.authority"), "{error}");
    }

    #[test]
    fn a_key_that_others_may_read_is_refused_and_so_is_another_vehicles_certificate() {
        let folder = tempfile::tempdir().unwrap();
        let (folder, roles) = (folder.path(), ["vehicle".to_owned()]);
        let request = KeysRequest { folder, roles: &roles, vehicles: &[], hosts: &[], days: 2, renew: false };
        keys::make(&request).unwrap();
        let file = |name: &str| folder.join(name);
        let tls = TlsConfig {
            authority: file("authority.pem"),
            certificate: file("vehicle.pem"),
            key: file("vehicle.key"),
            ..TlsConfig::default()
        };
        let drone = Endpoints { tls, ..Endpoints::default() };
        assert!(settings(&drone).is_ok());
        let error = settings(&Endpoints { vehicle: "hawk".into(), ..drone.clone() }).unwrap_err().to_string();
        assert!(error.contains("vehicle:drone.1") && error.contains("--vehicle hawk"), "{error}");
        for (mode, is_refused) in [(0o644, true), (0o604, true), (0o620, true), (0o400, false)] {
            std::fs::set_permissions(file("vehicle.key"), std::fs::Permissions::from_mode(mode)).unwrap();
            let outcome = settings(&drone);
            assert_eq!(outcome.is_err(), is_refused, "{mode:o}");
            if let Err(error) = outcome {
                assert!(error.to_string().contains("chmod 600"), "{error}");
            }
        }
    }

    #[test]
    fn endpoints_are_guarded_for_tls_alone() {
        let names = ["operator.1".to_owned(), "viewer".to_owned()];
        let listener = guarded("tls/0.0.0.0:7447", &names, Some(32));
        assert_eq!(listener, "tls/0.0.0.0:7447#places=32|8|4|operator;excluded_names=operator.1|viewer");
        assert_eq!(as_given(&listener), "tls/0.0.0.0:7447");
        let excluding = guarded("tls/h:1#iface=lo", &names, None);
        assert_eq!(excluding, "tls/h:1#iface=lo;excluded_names=operator.1|viewer");
        assert_eq!(as_given(&excluding), "tls/h:1#iface=lo");
        assert_eq!(as_given(&guarded("tls/h:1#iface=lo", &[], Some(9))), "tls/h:1#iface=lo");
        assert_eq!(guarded("tcp/h:1", &names, Some(32)), "tcp/h:1");
        assert_eq!(guarded("tls/h:1", &[], None), "tls/h:1");
        assert_eq!(as_given("tcp/h:1#iface=lo"), "tcp/h:1#iface=lo");
    }

    #[test]
    fn without_keys_nothing_is_set() {
        assert!(settings(&Endpoints::default()).unwrap().is_empty());
    }
}
