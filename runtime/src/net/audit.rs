//! Refused accesses and failed attempts to connect. Zenoh reports them at its lowest log levels only; this layer collects
//! them there, and the owner of a session logs them ([`log_refusals`], [`diagnosis::report_failures`]).

use super::diagnosis;
use crossbeam_queue::ArrayQueue;
use std::collections::BTreeSet;
use std::fmt::{Debug, Write as _};
use std::sync::{Mutex, OnceLock, PoisonError};
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::Context;

/// The parts of Zenoh that decide over messages and over connections, and the one that connects.
pub const TARGETS: [(&str, LevelFilter); 3] = [
    ("zenoh::net::routing::interceptor::access_control", LevelFilter::TRACE),
    ("zenoh_link_tls::unicast", LevelFilter::WARN),
    ("zenoh::net::runtime::orchestrator", LevelFilter::DEBUG),
];
/// How the first reports a refused message.
const NO: &str = "unauthorized";
/// What the second adds to every handshake that failed, whatever the reason was.
const HINT: &str = ". Hint: increase the system open file limit";
/// How the third begins when an attempt to connect has failed, the longer one first.
const FAILED: [&str; 2] = ["Unable to connect to configured peer ", "Unable to connect to "];
/// Refusals of which each is logged once; then none is logged any more.
const MAX_LOGGED: usize = 1_000;
/// Refusals that wait to be logged.
const MAX_WAITING: usize = 64;

fn waiting() -> &'static ArrayQueue<String> {
    static WAITING: OnceLock<ArrayQueue<String>> = OnceLock::new();
    WAITING.get_or_init(|| ArrayQueue::new(MAX_WAITING))
}

/// Refusals since the last call, as text.
pub fn refusals() -> impl Iterator<Item = String> {
    std::iter::from_fn(|| waiting().pop())
}

/// Logs the refusals since the last call, each peer and key once.
pub fn log_refusals() {
    static LOGGED: OnceLock<Mutex<BTreeSet<String>>> = OnceLock::new();
    for refusal in refusals() {
        let mut logged = LOGGED.get_or_init(Mutex::default).lock().unwrap_or_else(PoisonError::into_inner);
        if logged.len() < MAX_LOGGED && logged.insert(without_session(&refusal).to_owned()) {
            tracing::warn!("access refused: {refusal}");
        }
    }
}

/// A refusal without the number of the session, which is another one with every connection.
fn without_session(refusal: &str) -> &str {
    refusal.split_once(" on ").map_or(refusal, |(_, rest)| rest)
}

/// Listens to [`TARGETS`].
#[derive(Debug, Default)]
pub struct Audit;

impl<S: Subscriber> Layer<S> for Audit {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        let mut message = Message(String::new());
        event.record(&mut message);
        if let Some(attempt) = FAILED.iter().find_map(|start| message.0.strip_prefix(start)) {
            let about_one = |(endpoint, reason): &(&str, &str)| !endpoint.contains(' ') && !reason.is_empty();
            if let Some((endpoint, reason)) = attempt.split_once("! ").filter(about_one) {
                let reason = reason.rsplit_once(" Retry in ").map_or(reason, |(reason, _)| reason);
                diagnosis::record(endpoint, reason);
            }
            return;
        }
        let refusal = match message.0.split_once(HINT) {
            Some((reason, _)) => format!("a TLS handshake failed: {reason}"),
            None if message.0.contains(NO) => message.0,
            None => return,
        };
        waiting().force_push(refusal);
    }
}

struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        if field.name() == "message" {
            let _ = write!(self.0, "{value:?}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tracing_subscriber::layer::SubscriberExt as _;

    #[test]
    fn a_refusal_is_heard_and_nothing_else_is() {
        let subscriber = tracing_subscriber::registry().with(Audit);
        tracing::subscriber::with_default(subscriber, || {
            tracing::trace!("{} on {} is unauthorized to {} on {}", 1, "viewer", "Query", "key");
            tracing::trace!("{} on {} is authorized to {} on {}", 1, "viewer", "Query", "key");
            tracing::warn!("{}. Hint: increase the system open file limit.", "received fatal alert: X");
        });
        let told: Vec<String> = refusals().collect();
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(told[0].contains("viewer is unauthorized to Query on key"), "{told:?}");
        assert_eq!(told[1], "a TLS handshake failed: received fatal alert: X");
    }
}
