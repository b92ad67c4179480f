//! Refused requests by peer, and the choice of those worth reporting.
//!
//! Zenoh's access control writes a line for each decision and each subject of the rules that fits the peer:
//!
//! - `SESSION on PEER is (un)authorized to ACTION (FLOW) on KEY`, a decision made now: of several about one message, one
//!   that allows is enough.
//! - `Using cached result: SESSION is (un)authorized to ACTION (FLOW) on KEY`, about a message under a key that was named
//!   before. It was made then: `ACL (FLOW): caching permissions for KEY ...` is followed on its thread by decisions of the first
//!   kind on every action there is, those of [`DEEDS`] first, though nobody has asked for any of them.
//!
//! An attempt is a message that came in and was refused: a query, a reply, a put or a delete. It is reported once in
//! [`AGAIN_AFTER`] for each peer, action and key.

use super::{ROOT, certificate};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::{Duration, Instant};

/// A message that is repeated is logged again after this time.
pub const AGAIN_AFTER: Duration = Duration::from_mins(5);
/// Messages that are remembered as logged; as long as there are so many, no new one is logged.
const MAX_TOLD: usize = 200;
/// Refusals that wait to be reported; what comes beyond that between two looks is not reported.
const MAX_WAITING: usize = 64;
/// Sessions whose peers are remembered: as many as Zenoh admits.
const MAX_PEERS: usize = 1_000;
/// Longest key that is reported, characters.
const MAX_KEY: usize = 200;
/// Verdicts of a decision.
const ALLOWED: &str = "is authorized to ";
const REFUSED: &str = "is unauthorized to ";
/// Prefix of a decision that is older than its message.
const KNOWN: &str = "Using cached result: ";
/// Prefix of the line before decisions that nobody has asked for.
const AHEAD: &str = "ACL (";
/// Actions that do something, with their names in plain words. The others prepare to listen or to be listened to.
const DEEDS: [(&str, &str); 4] =
    [("Query", "query"), ("Reply", "answer queries on"), ("Put", "publish on"), ("Delete", "delete")];

/// True if a line reports a message that passes under a known key. Most lines do.
#[must_use]
pub fn is_passed(line: &str) -> bool {
    let verdict = line.strip_prefix(KNOWN).and_then(|rest| rest.split_once(' '));
    verdict.is_some_and(|(_, verdict)| verdict.starts_with(ALLOWED))
}

/// One decision.
struct Decision<'a> {
    /// Number of the session, which is another one with every connection.
    session: &'a str,
    /// Interface, names and protocol, as Zenoh writes them; missing in a decision made before.
    peer: Option<&'a str>,
    is_allowed: bool,
    action: &'a str,
    /// True if the message comes from the peer.
    is_incoming: bool,
    /// Key expression, as the peer wrote it.
    key: &'a str,
}

impl<'a> Decision<'a> {
    fn parse(line: &'a str) -> Option<Self> {
        let known = line.strip_prefix(KNOWN);
        let (session, rest) = known.unwrap_or(line).split_once(' ')?;
        // A key, which its peer chose, comes behind the verdict.
        let at = [ALLOWED, REFUSED].iter().filter_map(|verdict| rest.find(verdict)).min()?;
        let (peer, verdict) = rest.split_at(at);
        let allowed = verdict.strip_prefix(ALLOWED);
        let (action, place) = allowed.or_else(|| verdict.strip_prefix(REFUSED))?.split_once(" (")?;
        let (flow, key) = place.split_once(") on ")?;
        let peer = if known.is_some() { None } else { Some(peer.strip_prefix("on ")?.trim_end()) };
        let (is_allowed, is_incoming) = (allowed.is_some(), flow == "ingress");
        Some(Self { session, peer, is_allowed, action, is_incoming, key })
    }
}

/// Messages that were logged, each of which is logged again only after [`AGAIN_AFTER`].
#[derive(Debug, Default)]
pub struct Told(BTreeMap<String, Instant>);

impl Told {
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

/// Refusals that have not been reported yet, in words.
#[derive(Debug, Default)]
pub struct Refusals {
    /// Peers by their sessions, the oldest first.
    peers: VecDeque<(String, String)>,
    /// Refusals since the last look. One of them may be lifted yet, by the next subject that fits.
    fresh: BTreeSet<String>,
    /// Refusals that were there at the last look.
    ripe: BTreeSet<String>,
    told: Told,
}

impl Refusals {
    /// Notes a line of the access control. `is_ahead` belongs to the thread that wrote it: decisions that nobody has asked for
    /// follow.
    pub fn hear(&mut self, line: &str, is_ahead: &mut bool) {
        let Some(decision) = Decision::parse(line) else {
            *is_ahead |= line.starts_with(AHEAD);
            return;
        };
        match decision.peer {
            Some(peer) => self.remember(decision.session, peer),
            None => *is_ahead = false,
        }
        let Some((_, deed)) = DEEDS.iter().find(|(action, _)| *action == decision.action) else {
            *is_ahead = false;
            return;
        };
        if *is_ahead || !decision.is_incoming {
            return;
        }
        let words = self.words(&decision, deed);
        if decision.is_allowed {
            self.fresh.remove(&words);
            self.ripe.remove(&words);
        } else {
            self.note(words);
        }
    }

    /// Notes a refusal, in words.
    pub fn note(&mut self, words: String) {
        if self.fresh.len() < MAX_WAITING {
            self.fresh.insert(words);
        }
    }

    fn remember(&mut self, session: &str, peer: &str) {
        if self.peers.iter().any(|(known, _)| known == session) {
            return;
        }
        if self.peers.len() == MAX_PEERS {
            self.peers.pop_front();
        }
        self.peers.push_back((session.to_owned(), plain_peer(peer)));
    }

    fn words(&self, decision: &Decision<'_>, deed: &str) -> String {
        let session = decision.session;
        // A key may hold anything, and this goes into a log.
        let key: String = super::plain(decision.key).chars().take(MAX_KEY).collect();
        let known = self.peers.iter().find(|(known, _)| known == session);
        let peer = known.map_or_else(|| format!("session {session}"), |(_, peer)| peer.clone());
        format!("{peer} may not {deed} {key}{}", advice(&peer, &key))
    }

    /// Refusals to be reported now: those that nothing has lifted since the last look.
    pub fn take(&mut self, now: Instant) -> Vec<String> {
        let ripe = std::mem::replace(&mut self.ripe, std::mem::take(&mut self.fresh));
        ripe.into_iter().filter(|words| self.told.is_due(words, now)).collect()
    }
}

/// `Interface(eth0)+CertCommonName(viewer)+Transport(Tls)+SESSION` in plain words: the name that was shown, in a certificate
/// or with a password, and where its bearer came in.
fn plain_peer(peer: &str) -> String {
    let mut rest = peer;
    let mut field = |name: &str| {
        let (value, after) = rest.strip_prefix(name)?.strip_prefix('(')?.split_once(")+")?;
        rest = after;
        Some(value)
    };
    let [interface, certificate, user, transport] =
        ["Interface", "CertCommonName", "Username", "Transport"].map(&mut field);
    let name = super::plain(certificate.or(user).unwrap_or("a peer without a name"));
    let transport = transport.map(str::to_lowercase);
    let on = interface.map(|interface| format!("on {interface}"));
    let way: Vec<String> = transport.into_iter().chain(on).collect();
    if way.is_empty() { name } else { format!("{name} ({})", way.join(" ")) }
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
        is_ahead: bool,
        now: Instant,
    }

    impl Log {
        fn new() -> Self {
            Self { refusals: Refusals::default(), is_ahead: false, now: Instant::now() }
        }

        fn line(&mut self, line: &str) {
            self.refusals.hear(line, &mut self.is_ahead);
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

        fn told(&mut self) -> Vec<String> {
            self.refusals.take(self.now);
            self.refusals.take(self.now)
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
        assert_eq!(log.told(), [format!("viewer (tls on lo) may not query {key}")]);
    }

    #[test]
    fn a_vehicle_that_is_not_listened_to_is_told_how_to() {
        let mut log = Log::new();
        for key in ["plumbline/hawk/odom", "plumbline/drone/odom"] {
            let peer = "Interface(lo)+CertCommonName(vehicle:hawk.2)+Transport(Tls)+7";
            log.line(&format!("7 on {peer} is unauthorized to Put (ingress) on {key}"));
        }
        let told = log.told();
        assert_eq!(told.iter().filter(|words| words.contains("; --fleet hawk")).count(), 1, "{told:?}");
    }

    #[test]
    fn a_message_right_after_its_key_was_named_is_an_attempt() {
        let mut log = Log::new();
        log.named("ingress", "plumbline/drone/odom");
        log.decision("unauthorized", "Put (ingress)", "plumbline/drone/odom");
        assert_eq!(log.told(), ["viewer (tls on lo) may not publish on plumbline/drone/odom"]);
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
        assert!(log.told().is_empty());
    }

    #[test]
    fn an_attempt_is_told_once_in_a_while_whatever_its_session() {
        let mut log = Log::new();
        let attempt = |log: &mut Log, session: &str| {
            let peer = format!("Interface(lo)+CertCommonName(viewer)+Transport(Tls)+{session}");
            log.line(&format!("{session} on {peer} is unauthorized to Delete (ingress) on plumbline/a"));
            log.told().len()
        };
        assert_eq!((attempt(&mut log, "1"), attempt(&mut log, "1"), attempt(&mut log, "2")), (1, 0, 0));
        log.now += AGAIN_AFTER;
        assert_eq!(attempt(&mut log, "3"), 1);
    }

    #[test]
    fn a_flood_of_keys_is_bounded() {
        let mut log = Log::new();
        let mut told = 0;
        for i in 0..2 * MAX_TOLD {
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
        let told = log.told();
        assert!(
            told[0].starts_with("viewer (tls on lo) may not query x? is unauthorized to Put"),
            "{told:?}"
        );
        assert!(told[0].len() < 2 * MAX_KEY, "{told:?}");
    }

    #[test]
    fn a_message_is_due_again_after_a_while_also_behind_many_others() {
        let (mut told, now) = (Told::default(), Instant::now());
        assert!(told.is_due("router", now) && !told.is_due("router", now));
        for k in 0..2 * MAX_TOLD {
            told.is_due(&k.to_string(), now);
        }
        assert!(!told.is_due("new", now));
        let later = now + AGAIN_AFTER;
        assert!(told.is_due("router", later) && told.is_due("new", later));
    }

    #[test]
    fn peers_are_named_by_what_they_showed() {
        for (peer, words) in [
            ("Interface(lo)+CertCommonName(viewer)+Transport(Tls)+1", "viewer (tls on lo)"),
            ("CertCommonName(vehicle:a+b)+Transport(Tls)+1", "vehicle:a+b (tls)"),
            ("Interface(eth0)+Username(anna)+Transport(Tcp)+1", "anna (tcp on eth0)"),
            ("1", "a peer without a name"),
            ("", "a peer without a name"),
        ] {
            assert_eq!(plain_peer(peer), words);
        }
    }

    #[test]
    fn a_verdict_is_told_from_a_key_that_looks_like_one() {
        let refused = format!("{KNOWN}8f3a is unauthorized to Query (ingress) on is authorized to ");
        assert!(!is_passed(&refused) && is_passed(&refused.replace("is un", "is ")));
        let mut log = Log::new();
        log.line(&refused);
        assert_eq!(log.told(), ["session 8f3a may not query is authorized to "]);
        for line in [
            "",
            "Access control is enabled",
            "x is unauthorized to",
            "x is unauthorized to Query (ingress) on key",
            "x on y is unauthorized to Fly (ingress) on key",
            "x on y is unauthorized to Query ingress on key",
            "Using cached result: is unauthorized to Query (ingress",
        ] {
            log.line(line);
        }
        assert!(log.told().is_empty());
    }
}
