//! Refused accesses and failed attempts to connect. Zenoh reports them at its lowest log levels only; this layer collects
//! them there ([`super::access`] knows which of them matter), and the owner of a session logs them ([`log_refusals`],
//! [`diagnosis::report_failures`]).

use super::access::{AccessRefusal, Ahead, Refusals};
use super::{decision, diagnosis};
use std::cell::RefCell;
use std::fmt::{Debug, Write as _};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Instant;
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::Context;

/// The parts of Zenoh that decide over messages and over connections, the one that connects, and the one that counts sessions.
pub const TARGETS: [(&str, LevelFilter); 4] = [
    ("zenoh::net::routing::interceptor::access_control", LevelFilter::TRACE),
    ("zenoh_link_tls::unicast", LevelFilter::WARN),
    ("zenoh::net::runtime::orchestrator", LevelFilter::DEBUG),
    ("zenoh_transport::unicast::manager", LevelFilter::TRACE),
];
/// Words that the second of them adds to every failed handshake, whatever the reason.
const HINT: &str = ". Hint: increase the system open file limit";
/// The reason of a handshake whose certificate has no place.
const NO_PLACE: &str = "ApplicationVerificationFailure";
/// Beginnings of the third when an attempt to connect has failed, the longer one first.
const FAILED: [&str; 2] = ["Unable to connect to configured peer ", "Unable to connect to "];
/// Words of the fourth when all sessions are taken, before their number.
const FULL: &str = "Max transports reached (";
/// Longest line that is looked at, bytes.
const MAX_LINE: usize = 1_024;
thread_local! {
    static AHEAD: RefCell<Ahead> = RefCell::default();
}

fn refusals() -> MutexGuard<'static, Refusals> {
    static REFUSALS: OnceLock<Mutex<Refusals>> = OnceLock::new();
    REFUSALS.get_or_init(Mutex::default).lock().unwrap_or_else(PoisonError::into_inner)
}

/// Logs what was refused up to the last call: attempts as warnings, what Zenoh decides without one for those who debug.
pub fn log_refusals() {
    let told = refusals().take(Instant::now());
    for AccessRefusal { words, is_attempt } in told {
        match is_attempt {
            true => tracing::warn!("access refused: {words}"),
            false => tracing::debug!("access: {words}"),
        }
    }
}

/// Listens to [`TARGETS`].
#[derive(Debug, Default)]
pub struct Audit;

impl<S: Subscriber> Layer<S> for Audit {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        let mut message = Message { bytes: [0; MAX_LINE], length: 0 };
        event.record(&mut message);
        let message = message.text();
        if let Some(attempt) = FAILED.iter().find_map(|start| message.strip_prefix(start)) {
            let about_one = |(endpoint, reason): &(&str, &str)| !endpoint.contains(' ') && !reason.is_empty();
            if let Some((endpoint, reason)) = attempt.split_once("! ").filter(about_one) {
                let reason = reason.rsplit_once(" Retry in ").map_or(reason, |(reason, _)| reason);
                diagnosis::record(endpoint, reason);
            }
        } else if let Some((reason, _)) = message.split_once(HINT) {
            // Who has no place is named by the places themselves.
            if !reason.contains(NO_PLACE) {
                refusals().hear_handshake(reason);
            }
        } else if let Some((places, _)) = message.strip_prefix(FULL).and_then(|rest| rest.split_once(')')) {
            refusals().hear_full(places);
        } else if !decision::is_passed(message) {
            AHEAD.with_borrow_mut(|ahead| refusals().hear(message, ahead));
        }
    }
}

/// Text of an event, cut off at [`MAX_LINE`]. Zenoh writes a line for each decision on its own threads: none of them allocates here, and
/// none but those of refusals takes a lock.
struct Message {
    bytes: [u8; MAX_LINE],
    length: usize,
}

impl Message {
    fn text(&self) -> &str {
        let bytes = &self.bytes[..self.length];
        // The end may be in the middle of a character.
        std::str::from_utf8(bytes)
            .unwrap_or_else(|error| std::str::from_utf8(&bytes[..error.valid_up_to()]).unwrap_or_default())
    }
}

impl std::fmt::Write for Message {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        let count = text.len().min(MAX_LINE - self.length);
        self.bytes[self.length..self.length + count].copy_from_slice(&text.as_bytes()[..count]);
        self.length += count;
        // What follows is not formatted.
        if count < text.len() { Err(std::fmt::Error) } else { Ok(()) }
    }
}

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        if field.name() == "message" {
            let _ = write!(self, "{value:?}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tracing_subscriber::layer::SubscriberExt as _;

    #[test]
    fn a_line_is_cut_off_where_it_is_too_long() {
        let mut message = Message { bytes: [0; MAX_LINE], length: 0 };
        let _ = write!(message, "{}", "\u{e4}".repeat(MAX_LINE));
        assert_eq!(message.text().len(), MAX_LINE);
        let mut odd = Message { bytes: [0; MAX_LINE], length: 0 };
        let _ = write!(odd, "a{}", "\u{e4}".repeat(MAX_LINE));
        assert_eq!(odd.text().len(), MAX_LINE - 1);
    }

    #[test]
    fn what_zenoh_writes_becomes_refusals() {
        let subscriber = tracing_subscriber::registry().with(Audit);
        tracing::subscriber::with_default(subscriber, || {
            let peer = "Interface(lo)+CertCommonName(viewer)+Transport(Tls)+1";
            let key = "plumbline/drone/command/reset";
            tracing::trace!("{} on {} is unauthorized to {} on {}", 1, peer, "Query (ingress)", key);
            tracing::trace!("{} on {} is authorized to {} on {}", 1, peer, "Put (ingress)", key);
            tracing::warn!("{}. Hint: increase the system open file limit.", "received fatal alert: X");
            tracing::trace!("Max transports reached ({}). Denying new transport with peer: {}", 32, 1);
        });
        // What is new waits for the second look.
        assert!(refusals().take(Instant::now()).is_empty());
        let told: Vec<String> = refusals().take(Instant::now()).into_iter().map(|told| told.words).collect();
        assert_eq!(
            told,
            [
                "a TLS handshake failed: received fatal alert: X",
                "no place for another session: all 32 are taken; close other sessions",
                "viewer (tls on lo) may not query plumbline/drone/command/reset",
            ]
        );
    }
}
