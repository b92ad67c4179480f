//! Refused requests by peer, and the choice of those worth reporting.
//!
//! Zenoh's access control decides on much that nobody has attempted ([`super::decision`]): somebody who only watches may
//! not publish under the keys that it listens to, and hears so in advance. An attempt is a message that came in and was
//! refused: a query, a reply, a put or a delete. It is told once in [`AGAIN_AFTER`] for each peer, action and key.

use super::decision::{self, DEEDS, Decision};
use super::{ROOT, certificate};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::{Duration, Instant};

/// An attempt that is repeated is told again after this time.
pub const AGAIN_AFTER: Duration = Duration::from_mins(5);
/// Refusals that are remembered as told; as long as there are so many, no new one is told.
const MAX_TOLD: usize = 200;
/// Refusals that wait to be told; what comes beyond that between two looks is not told.
const MAX_WAITING: usize = 64;
/// Sessions whose peers are remembered: as many as Zenoh admits.
const MAX_PEERS: usize = 1_000;
/// Longest key that is told, characters.
const MAX_KEY: usize = 200;

/// Something that was refused.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct AccessRefusal {
    /// Peer, action and key, as text.
    pub words: String,
    /// True if a peer attempted something; otherwise it is Zenoh's bookkeeping about subscriptions.
    pub is_attempt: bool,
}

/// A place in the decisions that are made when a key is named. They are made on one thread without a break.
#[derive(Debug, Default)]
pub struct Ahead(Option<(String, usize)>);

impl Ahead {
    /// Decisions about everything under this key follow.
    fn begin(&mut self, flow_and_key: String) {
        self.0 = Some((flow_and_key, 0));
    }

    /// True if a decision is the next of them.
    fn goes_on_with(&mut self, decision: &Decision<'_>) -> bool {
        let Some((flow_and_key, newest)) = &mut self.0 else { return false };
        let goes_on =
            decision.peer.is_some() && decision.action >= *newest && *flow_and_key == decision.place();
        *newest = decision.action;
        if !goes_on {
            self.0 = None;
        }
        goes_on
    }
}

/// Refusals that have not been reported yet.
#[derive(Debug, Default)]
pub struct Refusals {
    /// Peers by their sessions, the oldest first.
    peers: VecDeque<(String, String)>,
    /// Refusals since the last look. One of them may be lifted yet, by the next subject that fits.
    fresh: BTreeSet<AccessRefusal>,
    /// Refusals that were there at the last check.
    ripe: BTreeSet<AccessRefusal>,
    told: BTreeMap<AccessRefusal, Instant>,
}

impl Refusals {
    /// Notes a line of the access control; `ahead` belongs to the thread that wrote it.
    pub fn hear(&mut self, line: &str, ahead: &mut Ahead) {
        if let Some(place) = decision::in_advance(line) {
            ahead.begin(place);
            return;
        }
        let Some(decision) = Decision::parse(line) else { return };
        if let Some(peer) = decision.peer {
            self.remember(decision.session, peer);
        }
        if ahead.goes_on_with(&decision) {
            return;
        }
        let refusal = self.refusal(&decision);
        if decision.is_allowed {
            self.fresh.remove(&refusal);
            self.ripe.remove(&refusal);
        } else {
            self.note(refusal);
        }
    }

    /// Notes somebody who was not let in.
    pub fn hear_handshake(&mut self, reason: &str) {
        let words = format!("a TLS handshake failed: {reason}");
        self.note(AccessRefusal { words, is_attempt: true });
    }

    /// Notes that all of so many sessions are taken.
    pub fn hear_full(&mut self, places: &str) {
        let words = format!("no place for another session: all {places} are taken; close other sessions");
        self.note(AccessRefusal { words, is_attempt: true });
    }

    fn note(&mut self, refusal: AccessRefusal) {
        if self.fresh.len() < MAX_WAITING {
            self.fresh.insert(refusal);
        }
    }

    fn remember(&mut self, session: &str, peer: &str) {
        if self.peers.iter().any(|(known, _)| known == session) {
            return;
        }
        if self.peers.len() == MAX_PEERS {
            self.peers.pop_front();
        }
        self.peers.push_back((session.to_owned(), decision::plain_peer(peer)));
    }

    fn refusal(&self, decision: &Decision<'_>) -> AccessRefusal {
        let session = decision.session;
        // A key may hold anything, and this goes into a log.
        let key: String = super::plain(decision.key).chars().take(MAX_KEY).collect();
        let known = self.peers.iter().find(|(known, _)| known == session);
        let peer = known.map_or_else(|| format!("session {session}"), |(_, peer)| peer.clone());
        let deed = decision.deed();
        let words = match decision.is_incoming {
            true => format!("{peer} may not {deed} {key}{}", advice(&peer, &key)),
            false => format!("{peer} is not sent: {deed} {key}"),
        };
        AccessRefusal { words, is_attempt: decision.is_incoming && decision.action < DEEDS }
    }

    /// Refusals to be reported now: those that nothing has lifted since the last check, each once in
    /// [`AGAIN_AFTER`].
    pub fn take(&mut self, now: Instant) -> Vec<AccessRefusal> {
        self.told.retain(|_, at| now.saturating_duration_since(*at) < AGAIN_AFTER);
        let mut refusals = Vec::new();
        for refusal in std::mem::replace(&mut self.ripe, std::mem::take(&mut self.fresh)) {
            if self.told.len() < MAX_TOLD && !self.told.contains_key(&refusal) {
                self.told.insert(refusal.clone(), now);
                refusals.push(refusal);
            }
        }
        refusals
    }
}

/// Cure for a vehicle that is refused its own key.
fn advice(peer: &str, key: &str) -> String {
    let holder = peer.split(' ').next().and_then(certificate::parse).map(|(holder, _)| holder);
    let name = holder.and_then(certificate::vehicle_of);
    match name.filter(|name| key.starts_with(&format!("{ROOT}/{name}/"))) {
        Some(name) => format!("; --fleet {name} listens to it, unless its certificate is excluded"),
        None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SESSION: &str = "8f3ac2e1";
    const NAMED: &str = "Interface(lo)+CertCommonName(viewer)+Transport(Tls)+8f3ac2e1";

    struct Log {
        refusals: Refusals,
        ahead: Ahead,
        now: Instant,
    }

    impl Log {
        fn new() -> Self {
            Self { refusals: Refusals::default(), ahead: Ahead::default(), now: Instant::now() }
        }

        fn line(&mut self, line: &str) {
            self.refusals.hear(line, &mut self.ahead);
        }

        /// A decision made now.
        fn decision(&mut self, verb: &str, action: &str, key: &str) {
            self.line(&format!("{SESSION} on {NAMED} is {verb} to {action} on {key}"));
        }

        /// Log lines of Zenoh for a key of which all actions are refused, by two subjects.
        fn named(&mut self, flow: &str, key: &str) {
            self.line(&format!("ACL ({flow}): caching permissions for `{key}` ..."));
            for action in [
                "Query",
                "Reply",
                "Put",
                "Delete",
                "Declare/Undeclare Subscriber",
                "Declare/Undeclare Queryable",
                "Declare/Undeclare Liveliness Token",
                "Liveliness Query",
                "Declare Liveliness Subscriber",
            ] {
                self.decision("unauthorized", &format!("{action} ({flow})"), key);
                self.decision("unauthorized", &format!("{action} ({flow})"), key);
            }
        }

        fn told(&mut self) -> Vec<AccessRefusal> {
            self.refusals.take(self.now);
            self.refusals.take(self.now)
        }

        /// Attempts, in words.
        fn attempts(&mut self) -> Vec<String> {
            self.told()
                .into_iter()
                .filter(|refusal| refusal.is_attempt)
                .map(|refusal| refusal.words)
                .collect()
        }
    }

    #[test]
    fn what_is_decided_when_a_key_is_named_is_no_attempt() {
        let mut log = Log::new();
        for key in ["plumbline/drone/state", "plumbline/drone/command/reset"] {
            log.named("ingress", key);
            log.named("egress", key);
        }
        assert!(log.told().is_empty());
    }

    #[test]
    fn a_message_under_a_named_key_is_an_attempt_and_its_peer_is_known_by_name() {
        let mut log = Log::new();
        let key = "plumbline/drone/command/reset";
        log.named("ingress", key);
        log.line(&format!("Using cached result: {SESSION} is unauthorized to Query (ingress) on {key}"));
        assert_eq!(log.attempts(), [format!("viewer (tls on lo) may not query {key}")]);
    }

    #[test]
    fn a_vehicle_that_is_not_listened_to_is_told_how_to() {
        let mut log = Log::new();
        for key in ["plumbline/hawk/odom", "plumbline/drone/odom"] {
            let peer = "Interface(lo)+CertCommonName(vehicle:hawk.2)+Transport(Tls)+7";
            log.line(&format!("7 on {peer} is unauthorized to Put (ingress) on {key}"));
        }
        let told = log.attempts();
        assert_eq!(told.iter().filter(|words| words.contains("; --fleet hawk")).count(), 1, "{told:?}");
    }

    #[test]
    fn a_message_right_after_its_key_was_named_is_an_attempt() {
        let mut log = Log::new();
        log.named("ingress", "plumbline/drone/odom");
        log.decision("unauthorized", "Put (ingress)", "plumbline/drone/odom");
        assert_eq!(log.attempts(), ["viewer (tls on lo) may not publish on plumbline/drone/odom"]);
    }

    #[test]
    fn one_subject_that_allows_is_enough() {
        let mut log = Log::new();
        log.decision("unauthorized", "Query (ingress)", "plumbline/drone/config");
        log.decision("authorized", "Query (ingress)", "plumbline/drone/config");
        assert!(log.told().is_empty());
        // The line that allows may come after the first look.
        log.decision("unauthorized", "Query (ingress)", "plumbline/drone/config");
        log.refusals.take(log.now);
        log.decision("authorized", "Query (ingress)", "plumbline/drone/config");
        assert!(log.told().is_empty());
    }

    #[test]
    fn declarations_and_what_is_withheld_are_no_attempts() {
        let mut log = Log::new();
        log.decision("unauthorized", "Declare Queryable (ingress)", "plumbline/**");
        log.decision("unauthorized", "Undeclare Liveliness Token (ingress)", "plumbline/x/alive");
        log.decision("unauthorized", "Put (egress)", "plumbline/drone/odom");
        let told = log.told();
        assert!(told.len() == 3 && told.iter().all(|refusal| !refusal.is_attempt), "{told:?}");
    }

    #[test]
    fn an_attempt_is_told_once_in_a_while_whatever_its_session() {
        let mut log = Log::new();
        let attempt = |log: &mut Log, session: &str| {
            let peer = format!("Interface(lo)+CertCommonName(viewer)+Transport(Tls)+{session}");
            log.line(&format!("{session} on {peer} is unauthorized to Delete (ingress) on plumbline/a"));
            log.attempts().len()
        };
        assert_eq!((attempt(&mut log, "1"), attempt(&mut log, "1"), attempt(&mut log, "2")), (1, 0, 0));
        log.now += AGAIN_AFTER;
        assert_eq!(attempt(&mut log, "3"), 1);
    }

    #[test]
    fn a_flood_of_keys_is_bounded() {
        let mut log = Log::new();
        let mut told = 0;
        for i in 0..10 * MAX_TOLD {
            log.decision("unauthorized", "Put (ingress)", &format!("plumbline/{i}"));
            told += log.told().len();
        }
        assert_eq!(told, MAX_TOLD);
        for i in 0..2 * MAX_PEERS {
            log.line(&format!("{i} on Transport(Tcp)+{i} is authorized to Put (ingress) on a"));
        }
        assert_eq!(log.refusals.peers.len(), MAX_PEERS);
    }

    #[test]
    fn a_key_cannot_speak_for_the_access_control() {
        let mut log = Log::new();
        let forged = format!("x\n is unauthorized to Put (ingress) on {}", "y".repeat(400));
        log.decision("authorized", "Query (ingress)", &forged);
        assert!(log.told().is_empty());
        log.decision("unauthorized", "Query (ingress)", &forged);
        let told = log.attempts();
        assert!(
            told[0].starts_with("viewer (tls on lo) may not query x? is unauthorized to Put"),
            "{told:?}"
        );
        assert!(told[0].len() < 2 * MAX_KEY, "{told:?}");
    }
}
