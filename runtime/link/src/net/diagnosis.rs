//! Reason why a connection cannot be made, in words with a cure.
//!
//! [`check`] refuses an endpoint that cannot work before a session is opened. What Zenoh says of an attempt that failed
//! reaches [`record`] by way of its log messages ([`super::audit`]); [`explain`] puts it into words, and
//! [`report_failures`] logs each cause once in a while.

use super::error::NetError;
use super::security;
use parking_lot::Mutex;
use std::collections::{BTreeMap, VecDeque};
use std::io::ErrorKind;
use std::net::TcpListener;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Protocols that this build can speak.
const PROTOCOLS: [&str; 2] = ["tcp", "tls"];
/// Settings that an endpoint may have behind `#`. Zenoh knows more: keys, and the switch that waives
/// certificates.
const SETTINGS: [&str; 5] = ["iface", "bind", "so_sndbuf", "so_rcvbuf", "dscp"];
/// Failed attempts that wait to be logged.
const MAX_WAITING: usize = 64;
/// A message that is repeated is logged again after this time.
const AGAIN_AFTER: Duration = Duration::from_mins(5);
/// Messages that are remembered as logged; as long as there are so many, no new one is logged.
const MAX_TOLD: usize = 200;

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
pub fn plain_words(message: &str) -> String {
    let is_source = |word: &str| {
        let line = word.rsplit_once(".rs:").map(|(_, line)| line.trim_end_matches(['.', ',']));
        line.is_some_and(|line| line.bytes().all(|b| b.is_ascii_digit()))
    };
    let mut words = Vec::new();
    for word in message.split_whitespace() {
        match words.last() {
            Some(&"at") if is_source(word) => drop(words.pop()),
            _ => words.push(word),
        }
    }
    words.join(" ").replace(" - Caused by ", ": ")
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
pub fn explain(endpoint: &str, reason: &str) -> String {
    let words = plain_words(reason);
    let lower = words.to_lowercase();
    let says = |parts: &[&str]| parts.iter().any(|part| lower.contains(part));
    let known = CAUSES.iter().find(|(parts, _)| says(parts)).map(|(_, cure)| *cure);
    let cure = known.unwrap_or_else(|| {
        if !says(&["timeout", "timed out", "elapsed"]) {
            "it ends the connection ({words}); does it ask for certificates (tls/), or are all \
             of its places for sessions taken?"
        } else if endpoint.starts_with("tls/") {
            "it does not answer in time; check the network, firewalls and the port; or it does not speak TLS: try tcp/"
        } else {
            "it does not answer in time; check the network, firewalls and the port"
        }
    });
    cure.replace("{address}", address_of(endpoint)).replace("{words}", &words)
}

/// Messages that were logged, each of which is logged again only after [`AGAIN_AFTER`].
#[derive(Debug, Default)]
pub struct Told(BTreeMap<String, Instant>);

impl Told {
    /// No message yet.
    pub const fn new() -> Self {
        Self(BTreeMap::new())
    }

    /// True if a message is to be logged now; it is then remembered.
    pub fn is_due(&mut self, message: &str, now: Instant) -> bool {
        self.0.retain(|_, at| now.saturating_duration_since(*at) < AGAIN_AFTER);
        let is_due = self.0.len() < MAX_TOLD && !self.0.contains_key(message);
        if is_due {
            self.0.insert(message.to_owned(), now);
        }
        is_due
    }
}

/// Attempts to connect that failed.
struct Attempts {
    /// Endpoints and reasons that wait to be logged.
    waiting: VecDeque<(String, String)>,
    told: Told,
    /// The newest cause.
    newest: Option<String>,
}

static ATTEMPTS: Mutex<Attempts> =
    Mutex::new(Attempts { waiting: VecDeque::new(), told: Told::new(), newest: None });

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
    let mut attempts = ATTEMPTS.lock();
    if attempts.waiting.len() == MAX_WAITING {
        attempts.waiting.pop_front();
    }
    attempts.waiting.push_back((security::as_given(endpoint).to_owned(), reason.to_owned()));
}

/// Message of Zenoh about the newest attempt to connect to `endpoint` that waits to be logged.
pub fn newest_attempt(endpoint: &str) -> Option<String> {
    let attempts = ATTEMPTS.lock();
    let newest = attempts.waiting.iter().rev().find(|(other, _)| other == endpoint);
    newest.map(|(_, reason)| reason.clone())
}

/// Logs why attempts to connect failed since the last call, each cause once in a while.
pub fn report_failures() {
    let now = Instant::now();
    let mut attempts = ATTEMPTS.lock();
    while let Some((endpoint, reason)) = attempts.waiting.pop_front() {
        let words = format!("{endpoint}: {}", explain(&endpoint, &reason));
        if attempts.told.is_due(&words, now) {
            tracing::warn!("{words}; trying again");
        }
        attempts.newest = Some(words);
    }
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
pub fn newest_failure() -> Option<String> {
    ATTEMPTS.lock().newest.clone()
}

#[cfg(test)]
mod tests {
    use super::*;

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
