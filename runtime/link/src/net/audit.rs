//! Connections that failed. Zenoh reports them at its lower log levels only; this layer collects them there, and the owner of a
//! session logs them ([`log_refusals`], [`diagnosis::report_failures`]).

use super::diagnosis::{self, Told};
use parking_lot::Mutex;
use std::collections::BTreeSet;
use std::fmt::Debug;
use std::time::Instant;
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::Context;

/// The parts of Zenoh that accept connections, that connect, and that count sessions.
pub const TARGETS: [(&str, LevelFilter); 3] = [
    ("zenoh_link_tls::unicast", LevelFilter::WARN),
    ("zenoh::net::runtime::orchestrator", LevelFilter::DEBUG),
    ("zenoh_transport::unicast::manager", LevelFilter::TRACE),
];
/// Words that the first of them adds to every failed handshake, whatever the reason.
const HINT: &str = ". Hint: increase the system open file limit";
/// The reason of a handshake whose certificate has no place.
const NO_PLACE: &str = "ApplicationVerificationFailure";
/// Beginnings of the second when an attempt to connect has failed, the longer one first.
const FAILED: [&str; 2] = ["Unable to connect to configured peer ", "Unable to connect to "];
/// Words of the third when all sessions are taken, before their number.
const FULL: &str = "Max transports reached (";
/// Words of the third when a session is linked with another.
const LINKED: &str = "New transport opened between ";
/// Refusals that wait to be logged; what comes beyond that between two looks is not logged.
const MAX_WAITING: usize = 64;

/// Refusals since the last look, and those that were logged.
#[derive(Debug, Default)]
struct Refusals {
    fresh: BTreeSet<String>,
    told: Told,
}

static REFUSALS: Mutex<Refusals> = Mutex::new(Refusals { fresh: BTreeSet::new(), told: Told::new() });

impl Refusals {
    fn note(&mut self, words: String) {
        if self.fresh.len() < MAX_WAITING {
            self.fresh.insert(words);
        }
    }

    fn take(&mut self, now: Instant) -> Vec<String> {
        let fresh = std::mem::take(&mut self.fresh);
        fresh.into_iter().filter(|words| self.told.is_due(words, now)).collect()
    }
}

/// Logs what was refused since the last call.
pub fn log_refusals() {
    let told = REFUSALS.lock().take(Instant::now());
    for words in told {
        tracing::warn!("connection refused: {words}");
    }
}

/// Listens to [`TARGETS`].
#[derive(Debug, Default)]
pub struct Audit;

impl<S: Subscriber> Layer<S> for Audit {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        let mut message = Message::default();
        event.record(&mut message);
        let Message(message) = message;
        if let Some(attempt) = FAILED.iter().find_map(|start| message.strip_prefix(start)) {
            let about_one = |(endpoint, reason): &(&str, &str)| !endpoint.contains(' ') && !reason.is_empty();
            if let Some((endpoint, reason)) = attempt.split_once("! ").filter(about_one) {
                let reason = reason.rsplit_once(" Retry in ").map_or(reason, |(reason, _)| reason);
                diagnosis::record(endpoint, reason);
            }
        } else if let Some((reason, _)) = message.split_once(HINT) {
            // Who has no place is named by the places themselves.
            if !reason.contains(NO_PLACE) {
                REFUSALS.lock().note(format!("a TLS handshake failed: {reason}"));
            }
        } else if let Some((places, _)) = message.strip_prefix(FULL).and_then(|rest| rest.split_once(')')) {
            REFUSALS
                .lock()
                .note(format!("no place for another session: all {places} are taken; close other sessions"));
        } else if message.starts_with(LINKED) {
            diagnosis::record_link();
        }
    }
}

/// Text of an event.
#[derive(Default)]
struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        if field.name() == "message" {
            self.0 = format!("{value:?}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tracing_subscriber::layer::SubscriberExt as _;

    #[test]
    fn connections_that_zenoh_refuses_are_told_once() {
        let subscriber = tracing_subscriber::registry().with(Audit);
        let log = || {
            tracing::warn!("{}. Hint: increase the system open file limit.", "received fatal alert: X");
            tracing::trace!("Max transports reached ({}). Denying new transport with peer: {}", 32, 1);
        };
        tracing::subscriber::with_default(subscriber, || {
            log();
            let told = REFUSALS.lock().take(Instant::now());
            let expected = [
                "a TLS handshake failed: received fatal alert: X",
                "no place for another session: all 32 are taken; close other sessions",
            ];
            assert_eq!(told, expected);
            log();
            assert!(REFUSALS.lock().take(Instant::now()).is_empty());
        });
    }
}
