//! Who was refused what. Zenoh tells it on its lowest levels of logging only; this layer picks it up there, and
//! whoever runs a session says it aloud ([`say_refusals`]).

use crossbeam_queue::ArrayQueue;
use std::fmt::{Debug, Write as _};
use std::sync::OnceLock;
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

/// The parts of Zenoh that decide: over messages and over connections.
pub const TARGETS: [&str; 2] =
    ["zenoh::net::routing::interceptor::access_control", "zenoh_link_tls::unicast"];
/// How the first says no.
const NO: &str = "unauthorized";
/// What the second adds to every handshake that failed, whatever the reason was.
const HINT: &str = ". Hint: increase the system open file limit";
/// Refusals that wait to be said.
const MAX_WAITING: usize = 64;

fn waiting() -> &'static ArrayQueue<String> {
    static WAITING: OnceLock<ArrayQueue<String>> = OnceLock::new();
    WAITING.get_or_init(|| ArrayQueue::new(MAX_WAITING))
}

/// Refusals since the last call, in words.
pub fn refusals() -> impl Iterator<Item = String> {
    std::iter::from_fn(|| waiting().pop())
}

/// Says aloud who was refused what since the last call.
pub fn say_refusals() {
    for refusal in refusals() {
        tracing::warn!("access refused: {refusal}");
    }
}

/// Listens to [`TARGETS`].
#[derive(Debug, Default)]
pub struct Audit;

impl<S: Subscriber> Layer<S> for Audit {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        let mut message = Message(String::new());
        event.record(&mut message);
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
