//! Log lines of Zenoh's access control: one for each decision and each subject of the rules that fits the
//! peer, at the lowest level.
//!
//! - `SESSION on PEER is (un)authorized to ACTION (FLOW) on KEY`, a decision made now: of several about one message, one
//!   that allows is enough.
//! - `Using cached result: SESSION is (un)authorized to ACTION (FLOW) on KEY`, about a message under a key that was named
//!   before. It was made then: `ACL (FLOW): caching permissions for KEY ...` is followed by a decision of the first kind on
//!   **every** action there is, though nobody has asked for any of them.

/// Words of a decision to allow.
const ALLOWED: &str = "is authorized to ";
const REFUSED: &str = "is unauthorized to ";
/// Prefix of a decision that is older than its message.
const KNOWN: &str = "Using cached result: ";
/// Requests in the order in which Zenoh decides on them in advance, with their names in plain words.
const ACTIONS: [(&str, &str); 9] = [
    ("Query", "query"),
    ("Reply", "answer queries on"),
    ("Put", "publish on"),
    ("Delete", "delete"),
    ("Declare Subscriber", "subscribe to"),
    ("Declare Queryable", "offer answers on"),
    ("Liveliness Token", "be seen as"),
    ("Liveliness Query", "ask who is alive on"),
    ("Declare Liveliness Subscriber", "watch who is alive on"),
];
/// Actions below this number do something, the others only prepare to listen or to be listened to.
pub const DEEDS: usize = 4;

/// True if a line says that a message passes. Most lines do, and are not worth a look.
#[must_use]
pub fn is_passed(line: &str) -> bool {
    let verdict = line.strip_prefix(KNOWN).and_then(|rest| rest.split_once(' '));
    verdict.is_some_and(|(_, verdict)| verdict.starts_with(ALLOWED))
}

/// One decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decision<'a> {
    /// Number of the session, which is another one with every connection.
    pub session: &'a str,
    /// Interface, names and protocol, as Zenoh writes them; missing in a decision made before.
    pub peer: Option<&'a str>,
    /// Decision.
    pub is_allowed: bool,
    /// Number of the action, as they are decided on in advance.
    pub action: usize,
    /// True if the message comes from the peer.
    pub is_incoming: bool,
    /// Key expression, as the peer wrote it.
    pub key: &'a str,
}

impl<'a> Decision<'a> {
    /// The decision that a line tells, if it tells one.
    #[must_use]
    pub fn parse(line: &'a str) -> Option<Self> {
        let (is_known, rest) = match line.strip_prefix(KNOWN) {
            Some(rest) => (true, rest),
            None => (false, line),
        };
        let (session, rest) = rest.split_once(' ')?;
        // Whatever stands in a key, which its peer chose, comes behind the verdict.
        let (peer, verdict) = match is_known {
            true => (None, rest),
            false => {
                let rest = rest.strip_prefix("on ")?;
                let at = [ALLOWED, REFUSED].iter().filter_map(|verdict| rest.find(verdict)).min()?;
                (Some(rest[..at].trim_end()), &rest[at..])
            }
        };
        let (is_allowed, what) = match verdict.strip_prefix(ALLOWED) {
            Some(what) => (true, what),
            None => (false, verdict.strip_prefix(REFUSED)?),
        };
        let (action, place) = what.split_once(" (")?;
        let (flow, key) = place.split_once(") on ")?;
        Some(Self {
            session,
            peer,
            is_allowed,
            action: number_of(action)?,
            is_incoming: flow == "ingress",
            key,
        })
    }

    /// The action in plain words, as what somebody may or may not do with a key.
    #[must_use]
    pub fn deed(&self) -> &'static str {
        ACTIONS[self.action].1
    }

    /// Direction and key.
    #[must_use]
    pub fn place(&self) -> String {
        place(self.is_incoming, self.key)
    }
}

fn place(is_incoming: bool, key: &str) -> String {
    format!("{} {key}", if is_incoming { "ingress" } else { "egress" })
}

/// Number in [`ACTIONS`]. A declaration that is withdrawn, or decided on in advance, has a word more or another one.
fn number_of(action: &str) -> Option<usize> {
    let action = action.replace("Declare/Undeclare", "Declare").replace("Undeclare", "Declare");
    let is_same = |name: &str| action == name || action.strip_prefix("Declare ") == Some(name);
    ACTIONS.iter().position(|(name, _)| is_same(name))
}

/// The place ([`Decision::place`]) on which every decision follows, if that is what a line says.
#[must_use]
pub fn in_advance(line: &str) -> Option<String> {
    let (flow, key) = line.strip_prefix("ACL (")?.split_once("): caching permissions for `")?;
    let (key, _) = key.rsplit_once('`')?;
    Some(place(flow == "ingress", key))
}

/// `Interface(eth0)+CertCommonName(viewer)+Transport(Tls)+SESSION` in plain words: the name that was shown, in a certificate
/// or with a password, and where its bearer came in.
#[must_use]
pub fn plain_peer(peer: &str) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peers_are_named_by_what_they_showed() {
        for (peer, words) in [
            ("Interface(lo)+CertCommonName(viewer)+Transport(Tls)+1", "viewer (tls on lo)"),
            ("CertCommonName(vehicle:a+b)+Transport(Tls)+1", "vehicle:a+b (tls)"),
            ("Interface(eth0)+Username(anna)+Transport(Tcp)+1", "anna (tcp on eth0)"),
            ("Interface(eth0)+Transport(Udp)+1", "a peer without a name (udp on eth0)"),
            ("1", "a peer without a name"),
            ("", "a peer without a name"),
        ] {
            assert_eq!(plain_peer(peer), words);
        }
    }

    #[test]
    fn what_passes_under_a_known_key_is_told_from_what_does_not_whatever_the_key_says() {
        let refused = format!("{KNOWN}8f3a is unauthorized to Query (ingress) on is authorized to ");
        assert!(!is_passed(&refused) && is_passed(&refused.replace("is un", "is ")));
        let decision = Decision::parse(&refused).unwrap();
        assert_eq!((decision.session, decision.peer, decision.key), ("8f3a", None, "is authorized to "));
    }

    #[test]
    fn other_lines_tell_nothing() {
        for line in [
            "",
            "Access control is enabled",
            "ACL (ingress): caching permissions for",
            "x is unauthorized to",
            "x is unauthorized to Query (ingress) on key",
            "x on y is unauthorized to Fly (ingress) on key",
            "x on y is unauthorized to Query ingress on key",
            "Using cached result: is unauthorized to Query (ingress",
        ] {
            assert!(Decision::parse(line).is_none() && in_advance(line).is_none(), "{line}");
        }
    }
}
