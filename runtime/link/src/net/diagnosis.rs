//! Reason why a connection cannot be made, in words with a cure.
//!
//! [`check`] refuses an endpoint that cannot work before a session is opened. What Zenoh says of an attempt that failed
//! reaches [`record`] by way of its log messages ([`super::audit`]); [`explain`] puts it into words, and
//! [`report_failures`] logs each cause once in a while.

use super::access::Told;
use super::error::NetError;
use super::security;
use crossbeam_queue::ArrayQueue;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream, ToSocketAddrs as _};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// Protocols that this build can speak.
const PROTOCOLS: [&str; 2] = ["tcp", "tls"];
/// Settings that an endpoint may have behind `#`. Zenoh knows more: keys, and the switch that waives
/// certificates.
const SETTINGS: [&str; 5] = ["iface", "bind", "so_sndbuf", "so_rcvbuf", "dscp"];
/// Failed attempts that wait to be logged.
const MAX_WAITING: usize = 64;
/// The other side has this long to show that it speaks TLS.
const PROBE_TIMEOUT: Duration = Duration::from_millis(700);
/// First byte of a TLS alert record (RFC 8446, section 5.1).
const TLS_ALERT: u8 = 0x15;

/// Refuses an endpoint that cannot work: its form, its protocol, certificates that are missing.
///
/// # Errors
/// [`NetError::Endpoint`] with the cure.
pub fn check(endpoint: &str, has_certificates: bool) -> Result<(), NetError> {
    let refuse = |reason: String| Err(NetError::Endpoint { endpoint: endpoint.to_owned(), reason });
    let Some((protocol, address)) = endpoint.split_once('/') else {
        return refuse(format!("names no protocol; write it as tcp/{endpoint}"));
    };
    if !PROTOCOLS.contains(&protocol) {
        return refuse(format!("'{protocol}' is not a supported protocol; write tcp or tls"));
    }
    let address = address.split(['?', '#']).next().unwrap_or_default();
    let Some((host, port)) = address.rsplit_once(':').filter(|(host, _)| !host.ends_with(':')) else {
        return refuse(format!("names no port; write it as {protocol}/HOST:7447"));
    };
    if host.is_empty() || host.contains(['/', ' ']) {
        return refuse(format!("names no host; write it as {protocol}/HOST:{port}"));
    }
    if port.parse::<u16>().is_err() {
        return refuse(format!("'{port}' is not a port; give a number up to 65535"));
    }
    let settings = endpoint.split_once('#').map_or("", |(_, settings)| settings).split(';');
    let names = settings.map(|setting| setting.split_once('=').map_or(setting, |(name, _)| name));
    if let Some(name) = names.filter(|name| !name.is_empty()).find(|name| !SETTINGS.contains(name)) {
        return refuse(format!(
            "'{name}' cannot be set behind '#', where only {} can; certificates belong into [network.tls]",
            SETTINGS.join(", ")
        ));
    }
    if protocol == "tls" && !has_certificates {
        return refuse(
            "needs certificates: give --authority, --certificate and --key, or [network.tls] in the \
             configuration (`plumbline keys` makes them)"
                .into(),
        );
    }
    Ok(())
}

/// `HOST:PORT` of a checked endpoint, without brackets left around nothing.
fn address_of(endpoint: &str) -> &str {
    let address = endpoint.split_once('/').map_or(endpoint, |(_, address)| address);
    address.split(['?', '#']).next().unwrap_or_default()
}

/// Refuses to listen where somebody else does, or at an address that is not this host's.
///
/// # Errors
/// [`NetError::Taken`] or [`NetError::Endpoint`].
pub fn check_listener(endpoint: &str) -> Result<(), NetError> {
    let address = address_of(endpoint);
    let Err(error) = TcpListener::bind(address) else { return Ok(()) };
    let endpoint = endpoint.to_owned();
    Err(match error.kind() {
        ErrorKind::AddrInUse => NetError::Taken { endpoint },
        ErrorKind::PermissionDenied => NetError::Endpoint {
            endpoint,
            reason: format!("this process may not listen there ({error}); choose a port from 1024 on"),
        },
        _ => NetError::Endpoint {
            endpoint,
            reason: format!("cannot listen there ({error}); give an address of this host, or 0.0.0.0"),
        },
    })
}

/// Message of Zenoh without the places in its sources: `words at /path/file.rs:12. - Caused by ...`.
#[must_use]
pub fn plain_words(message: &str) -> String {
    let mut words = String::new();
    let mut rest = message;
    while let Some(at) = rest.find(" at ") {
        let place = &rest[at + 4..];
        let end = place.find(' ').unwrap_or(place.len());
        let (file, after) = place.split_at(end);
        words.push_str(&rest[..at]);
        let is_source = file
            .rsplit_once(".rs:")
            .is_some_and(|(_, line)| line.trim_end_matches(['.', ',']).bytes().all(|b| b.is_ascii_digit()));
        if !is_source {
            words.push_str(" at ");
            words.push_str(file);
        }
        rest = after;
    }
    words.push_str(rest);
    words.replace(" - Caused by ", ": ").split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Causes of failed attempts by words of what Zenoh says of them, in small letters, with their cures. `{address}` stands for the
/// endpoint's, `{words}` for what Zenoh says.
const CAUSES: [(&[&str], &str); 11] = [
    (
        &["connection refused"],
        "no listener at that port yet; check that the other side is running, and the port",
    ),
    (
        &["lookup", "name or service not known", "no address associated", "name resolution"],
        "the host name is unknown; check its spelling, or give its address",
    ),
    (
        &["no route to host", "network is unreachable", "host is unreachable"],
        "there is no route to that host; check the network",
    ),
    (
        &["unknownissuer", "unknown issuer", "badsignature"],
        "its certificate was signed by another authority than ours; use certificates that `plumbline keys` made in one \
         folder",
    ),
    (
        &["notvalidforname", "not valid for name"],
        "its certificate is for another host name; make it with `plumbline keys --host NAME`",
    ),
    (
        &["expired"],
        "a certificate has expired, or a clock is wrong; `plumbline keys --renew` makes a new one",
    ),
    (
        &["invalidcontenttype", "corrupt message", "invalidmessage"],
        "it does not speak TLS; connect to tcp/{address}, or give the other side certificates",
    ),
    (
        &["certificaterevoked"],
        "our certificate is excluded there (network.tls.excluded); use one that is not, such as a renewed one",
    ),
    (
        &["accessdenied", "access denied"],
        "it has no place left for our certificate: those of one certificate are few, and the last ones are for operators; \
         close other sessions, or use another certificate",
    ),
    (&["is excluded"], "its certificate is excluded here (network.tls.excluded)"),
    (
        &["fatal alert", "badcertificate", "certificaterequired", "unknownca"],
        "it does not accept our certificate ({words}); use certificates of its authority",
    ),
];

/// The cause of a failed attempt and what to do about it, by what Zenoh said of it.
#[must_use]
pub fn explain(endpoint: &str, reason: &str) -> String {
    let words = plain_words(reason);
    let lower = words.to_lowercase();
    let says = |parts: &[&str]| parts.iter().any(|part| lower.contains(part));
    let known = CAUSES.iter().find(|(parts, _)| says(parts)).map(|(_, cure)| *cure);
    let cure = known.unwrap_or_else(|| {
        if endpoint.starts_with("tcp/") && speaks_tls(endpoint) {
            "it speaks TLS and lets in who has a certificate; connect to tls/{address} with --authority, --certificate and \
             --key"
        } else if !says(&["timeout", "timed out", "elapsed"]) {
            "it ends the connection ({words}); does it ask for a name and password, or for certificates, or are all of \
             its places for sessions taken?"
        } else if endpoint.starts_with("tls/") {
            "it does not answer in time; check the network, firewalls and the port; or it does not speak TLS: try tcp/"
        } else {
            "it does not answer in time; check the network, firewalls and the port"
        }
    });
    cure.replace("{address}", address_of(endpoint)).replace("{words}", &words)
}

/// True if the endpoint answers a byte that is no TLS with a TLS alert.
fn speaks_tls(endpoint: &str) -> bool {
    let probe = || {
        let address = address_of(endpoint).to_socket_addrs().ok()?.next()?;
        let mut stream = TcpStream::connect_timeout(&address, PROBE_TIMEOUT).ok()?;
        stream.set_read_timeout(Some(PROBE_TIMEOUT)).ok()?;
        stream.write_all(&[0; 8]).ok()?;
        let mut first = [0];
        stream.read_exact(&mut first).ok()?;
        Some(first[0])
    };
    probe() == Some(TLS_ALERT)
}

fn waiting() -> &'static ArrayQueue<(String, String)> {
    static WAITING: OnceLock<ArrayQueue<(String, String)>> = OnceLock::new();
    WAITING.get_or_init(|| ArrayQueue::new(MAX_WAITING))
}

/// Where another session has the identifier of this one, or of the other side: what Zenoh says of it.
const TAKEN: [&[&str]; 2] = [&["INVALID", "OpenSyn"], &["already exist"]];
static REFUSED: [AtomicBool; TAKEN.len()] = [const { AtomicBool::new(false) }; TAKEN.len()];
static WAS_LINKED: AtomicBool = AtomicBool::new(false);

/// Remembers that the identifier of this session was told to another.
pub fn record_link() {
    WAS_LINKED.store(true, Ordering::Relaxed);
}

/// True if another session has an identifier that is needed for a link, since the last call. The other side refuses a session
/// with the same words where it has no place left: they count where the identifier was told before.
#[must_use]
pub fn is_identifier_taken() -> bool {
    let [theirs, ours] = &REFUSED;
    let is_refused = theirs.swap(false, Ordering::Relaxed);
    ours.swap(false, Ordering::Relaxed) || (is_refused && WAS_LINKED.load(Ordering::Relaxed))
}

/// Remembers an attempt to connect to `endpoint` that failed.
pub fn record(endpoint: &str, reason: &str) {
    for (parts, refused) in TAKEN.iter().zip(&REFUSED) {
        if parts.iter().all(|part| reason.contains(part)) {
            refused.store(true, Ordering::Relaxed);
        }
    }
    waiting().force_push((security::as_given(endpoint).to_owned(), reason.to_owned()));
}

/// Message of Zenoh about the newest attempt to connect to `endpoint` that waits to be logged.
#[must_use]
pub fn newest_attempt(endpoint: &str) -> Option<String> {
    let mut newest = None;
    for _ in 0..waiting().len() {
        let Some(attempt) = waiting().pop() else { break };
        if attempt.0 == endpoint {
            newest = Some(attempt.1.clone());
        }
        waiting().force_push(attempt);
    }
    newest
}

/// Attempts and causes that were logged, and the newest cause.
#[derive(Default)]
struct Logged {
    told: Told,
    newest: Option<String>,
}

fn logged() -> std::sync::MutexGuard<'static, Logged> {
    static LOGGED: OnceLock<Mutex<Logged>> = OnceLock::new();
    LOGGED.get_or_init(Mutex::default).lock().unwrap_or_else(PoisonError::into_inner)
}

/// Logs why attempts to connect failed since the last call, each cause once in a while. Returns at once: to find a cause may
/// take a moment, and is done on a thread of its own.
pub fn report_failures() {
    static IS_BUSY: AtomicBool = AtomicBool::new(false);
    if waiting().is_empty() || IS_BUSY.swap(true, Ordering::Relaxed) {
        return;
    }
    let report = || {
        while let Some((endpoint, reason)) = waiting().pop() {
            report_failure(&endpoint, &reason);
        }
        IS_BUSY.store(false, Ordering::Relaxed);
    };
    if std::thread::Builder::new().name("diagnosis".into()).spawn(report).is_err() {
        IS_BUSY.store(false, Ordering::Relaxed);
    }
}

fn report_failure(endpoint: &str, reason: &str) {
    let now = Instant::now();
    if !logged().told.is_due(&format!("{endpoint} {}", plain_words(reason)), now) {
        return;
    }
    let words = format!("{endpoint}: {}", explain(endpoint, reason));
    let mut logged = logged();
    // Another reason may have the same cause.
    if logged.told.is_due(&words, now) {
        tracing::warn!("{words}; trying again");
    }
    logged.newest = Some(words);
}

/// Link states of peers that a router dropped, which it reports once.
#[derive(Debug, Default)]
pub struct DroppedRoutes {
    is_told: bool,
}

impl DroppedRoutes {
    /// Logs that a peer sent link states, if one did.
    pub fn report(&mut self) {
        if !self.is_told && zenoh_codec::network::dropped_link_states() > 0 {
            self.is_told = true;
            tracing::warn!(
                "a peer sent link states, which this router ignores; if it is another router, start this one with --routes"
            );
        }
    }
}

/// Reason of the last failed attempt, if one failed.
#[must_use]
pub fn newest_failure() -> Option<String> {
    logged().newest.clone()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endpoints_that_cannot_work_are_refused_with_their_cure() {
        for (endpoint, words) in [
            ("127.0.0.1:7447", "tcp/127.0.0.1:7447"),
            ("http/127.0.0.1:7447", "'http' is not a supported protocol"),
            ("udp/127.0.0.1:7447", "'udp' is not a supported protocol; write tcp or tls"),
            ("tcp/127.0.0.1", "names no port"),
            ("tcp/:7447", "names no host"),
            ("tcp/host:70000", "'70000' is not a port"),
            ("tcp/host:x", "'x' is not a port"),
            ("tls/host:7447", "needs certificates"),
            ("", "names no protocol"),
            ("tls/host:7447#enable_mtls=false", "'enable_mtls' cannot be set"),
            ("tls/host:7447#iface=lo;root_ca_certificate_file=/tmp/a", "'root_ca_certificate_file' cannot"),
        ] {
            let error = check(endpoint, false).unwrap_err().to_string();
            assert!(error.contains(words), "{endpoint}: {error}");
        }
        for endpoint in ["tcp/127.0.0.1:7447", "tcp/[::1]:7447", "tcp/0.0.0.0:0", "tcp/host:1#iface=lo"] {
            assert!(check(endpoint, false).is_ok(), "{endpoint}");
        }
        assert!(check("tls/host:7447", true).is_ok());
    }

    #[test]
    fn a_port_that_is_taken_is_told_from_an_address_that_is_not_ours() {
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let endpoint = format!("tcp/{}", taken.local_addr().unwrap());
        assert!(matches!(check_listener(&endpoint), Err(NetError::Taken { .. })));
        assert!(matches!(check_listener("tcp/192.0.2.1:7447"), Err(NetError::Endpoint { .. })));
        assert!(check_listener("tcp/127.0.0.1:0").is_ok());
    }

    #[test]
    fn places_in_sources_are_left_out() {
        let message = "Unable to connect at /root/.cargo/registry/src/zenoh-1.10.2/src/o.rs:447. - Caused by look \
                       at this at a/b.rs:3.";
        assert_eq!(plain_words(message), "Unable to connect: look at this");
    }

    #[test]
    fn every_known_cause_has_a_cure() {
        let explained = |reason: &str| explain("tls/127.0.0.1:1", reason);
        for (reason, words) in [
            ("Connection refused (os error 111)", "no listener at that port"),
            ("failed to lookup address information: Name or service not known", "host name is unknown"),
            ("invalid peer certificate: UnknownIssuer", "another authority"),
            ("invalid peer certificate: BadSignature", "another authority"),
            ("invalid peer certificate: NotValidForName", "--host"),
            ("invalid peer certificate: Expired", "--renew"),
            ("received corrupt message of type InvalidContentType", "tcp/127.0.0.1:1"),
            ("received fatal alert: CertificateRevoked", "is excluded there"),
            ("the certificate router.1 is excluded", "is excluded here"),
            ("received fatal alert: CertificateRequired", "does not accept our certificate"),
            ("received fatal alert: AccessDenied", "no place left for our certificate"),
            ("deadline has elapsed", "does not answer in time"),
        ] {
            assert!(explained(reason).contains(words), "{reason}: {}", explained(reason));
        }
    }
}
