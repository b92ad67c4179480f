//! Refused accesses and failed attempts to connect. Zenoh reports them at its lowest log levels only; this layer collects
//! them there ([`super::access`] knows which of them matter), and the owner of a session logs them ([`log_refusals`],
//! [`diagnosis::report_failures`]).

use super::access::{self, Refusals};
use super::diagnosis;
use std::cell::Cell;
use std::fmt::{Debug, Write as _};
use std::sync::atomic::{AtomicUsize, Ordering};
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
/// Words of the fourth when a session is linked with another.
const LINKED: &str = "New transport opened between ";
/// Longest line that is looked at, bytes.
const MAX_LINE: usize = 1_024;
/// Places in Zenoh's sources that report messages which pass: by far the most lines, and none of them is formatted once its place
/// is known.
static PASSING: [AtomicUsize; 8] = [const { AtomicUsize::new(0) }; 8];

thread_local! {
    static IS_AHEAD: Cell<bool> = const { Cell::new(false) };
}

fn refusals() -> MutexGuard<'static, Refusals> {
    static REFUSALS: OnceLock<Mutex<Refusals>> = OnceLock::new();
    REFUSALS.get_or_init(Mutex::default).lock().unwrap_or_else(PoisonError::into_inner)
}

/// Logs what was refused up to the last call.
pub fn log_refusals() {
    let told = refusals().take(Instant::now());
    for words in told {
        tracing::warn!("access refused: {words}");
    }
}

/// Listens to [`TARGETS`].
#[derive(Debug, Default)]
pub struct Audit;

impl<S: Subscriber> Layer<S> for Audit {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        let place = std::ptr::from_ref(event.metadata()).addr();
        if PASSING.iter().any(|passing| passing.load(Ordering::Relaxed) == place) {
            return;
        }
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
                refusals().note(format!("a TLS handshake failed: {reason}"));
            }
        } else if let Some((places, _)) = message.strip_prefix(FULL).and_then(|rest| rest.split_once(')')) {
            refusals()
                .note(format!("no place for another session: all {places} are taken; close other sessions"));
        } else if message.starts_with(LINKED) {
            diagnosis::record_link();
        } else if access::is_passed(message) {
            let free = |passing: &AtomicUsize| {
                passing.compare_exchange(0, place, Ordering::Relaxed, Ordering::Relaxed).is_ok()
            };
            let _ = PASSING.iter().any(free);
        } else {
            let mut is_ahead = IS_AHEAD.get();
            refusals().hear(message, &mut is_ahead);
            IS_AHEAD.set(is_ahead);
        }
    }
}

/// Text of an event, cut off at [`MAX_LINE`]: Zenoh's own threads write it, and do not allocate here.
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
        assert_eq!(
            refusals().take(Instant::now()),
            [
                "a TLS handshake failed: received fatal alert: X",
                "no place for another session: all 32 are taken; close other sessions",
                "viewer (tls on lo) may not query plumbline/drone/command/reset",
            ]
        );
    }

    /// Text that counts how often it is formatted.
    struct Counted(AtomicUsize);

    impl std::fmt::Display for Counted {
        fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            self.0.fetch_add(1, Ordering::Relaxed);
            f.write_str("Put (ingress)")
        }
    }

    #[test]
    fn lines_of_messages_that_pass_are_not_formatted() {
        let action = Counted(AtomicUsize::new(0));
        let subscriber = tracing_subscriber::registry().with(Audit);
        tracing::subscriber::with_default(subscriber, || {
            for _ in 0..9 {
                tracing::trace!("Using cached result: {} is authorized to {} on {}", 1, action, "key");
            }
        });
        assert_eq!(action.0.into_inner(), 1);
    }
}
