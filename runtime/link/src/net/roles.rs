//! Permissions of the roles: the rules of Zenoh's access control.
//!
//! Default of the rules: what none allows is refused, in both directions. A rule matches a key expression
//! only if it includes all of it, so `**` and `*/drone/odom` match none and are refused. With certificates
//! the role of a peer is the name of its certificate ([`super::certificate`]), and a vehicle's is bound to
//! its own keys. Zenoh's rules name certificates one by one, so a session has to know the vehicles that it
//! listens to ([`Endpoints::hears`]).
//!
//! The table in `docs/security.md` is what comes of these rules; `tests/process/roles.rs` tries every field of it.

use super::ROOT;
use super::certificate;
use super::endpoints::{Endpoints, is_loopback};
use plumbline_config::options::CommandAccess;
use serde_json::{Value, json};

/// To say something, or to be seen. Nobody deletes.
const SPEAK: &[&str] = &["put", "reply", "declare_queryable", "liveliness_token"];
/// To hear what is said, and who is there.
const LISTEN: &[&str] = &["declare_subscriber", "liveliness_query", "declare_liveliness_subscriber"];
const ASK: &[&str] = &["query"];
const EVERYTHING: &[&str] = &[
    "put",
    "delete",
    "reply",
    "query",
    "declare_queryable",
    "declare_subscriber",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
];

/// Something that is allowed.
struct Right {
    flow: &'static str,
    messages: &'static [&'static str],
    keys: Vec<String>,
}

/// From the peer to us.
fn from(messages: &'static [&'static str], keys: &[String]) -> Right {
    Right { flow: "ingress", messages, keys: keys.to_vec() }
}

/// From us to the peer.
fn to(messages: &'static [&'static str], keys: &[String]) -> Right {
    Right { flow: "egress", messages, keys: keys.to_vec() }
}

/// The keys of the rules.
struct Keys {
    /// Everything of ours.
    all: Vec<String>,
    /// Queries that leave a vehicle unchanged.
    questions: Vec<String>,
    /// Commands that a vehicle obeys.
    commands: Vec<String>,
}

impl Keys {
    fn of(endpoints: &Endpoints) -> Self {
        let vehicle = if endpoints.is_vehicle() { endpoints.vehicle.as_str() } else { "*" };
        let questions = ["trajectory/**", "map/**", "config", "clock"];
        Self {
            all: vec![format!("{ROOT}/**")],
            questions: questions.map(|topic| format!("{ROOT}/*/{topic}")).into(),
            commands: vec![format!("{ROOT}/{vehicle}/command/*")],
        }
    }
}

/// The access control of a session with certificates.
pub fn access(endpoints: &Endpoints) -> Value {
    let mut table = Table::default();
    // Allows nothing there is: a peer without any other right is a subject of the rules as well.
    let nothing = [format!("{ROOT}/-/nothing")];
    table.grant("anybody", json!({}), &[from(ASK, &nothing)]);
    let keys = Keys::of(endpoints);
    grant_certificates(&mut table, endpoints, &keys);
    grant_this_host(&mut table, endpoints, &keys);
    table.settings()
}

/// Grants each role its rights. If several subjects fit a peer, one that allows is enough.
fn grant_certificates(table: &mut Table, endpoints: &Endpoints, keys: &Keys) {
    let mut grant = |holder: &str, rights: &[Right]| {
        let names = certificate::believed(holder, &endpoints.tls.excluded);
        if !names.is_empty() {
            table.grant(holder, json!({"cert_common_names": names, "link_protocols": ["tls"]}), rights);
        }
    };
    let look = || vec![from(LISTEN, &keys.all), from(ASK, &keys.questions), to(SPEAK, &keys.all)];
    let mut viewer = look();
    let mut operator = look();
    operator.push(from(ASK, &keys.commands));
    let mut router = passing(endpoints, keys);
    if endpoints.commands == CommandAccess::Anybody {
        viewer.push(from(ASK, &keys.commands));
        router.push(from(ASK, &keys.commands));
    }
    grant("viewer", &viewer);
    grant(certificate::OPERATOR, &operator);
    grant("router", &router);
    for name in &endpoints.hears {
        let own = [format!("{ROOT}/{name}/**")];
        grant(&certificate::vehicle(name), &[from(SPEAK, &own), to(ASK, &own), to(LISTEN, &keys.all)]);
    }
}

/// Rights between us and a router: everything but commands to us.
fn passing(endpoints: &Endpoints, keys: &Keys) -> Vec<Right> {
    let mut rights = vec![
        from(LISTEN, &keys.all),
        from(ASK, &keys.questions),
        to(SPEAK, &keys.all),
        to(LISTEN, &keys.all),
        to(ASK, &keys.all),
    ];
    if !endpoints.is_vehicle() {
        rights.push(from(SPEAK, &keys.all));
    }
    rights
}

/// Processes of this host come over plain TCP on the loopback interface, to a listener that nobody else reaches. Who is behind
/// a link that we opened ourselves is not known: it may be a router that listens openly.
fn grant_this_host(table: &mut Table, endpoints: &Endpoints, keys: &Keys) {
    let is_plain = |endpoint: &String| endpoint.starts_with("tcp/") && is_loopback(endpoint);
    let this_host = json!({"interfaces": ["lo"], "link_protocols": ["tcp"]});
    if endpoints.connect.iter().any(is_plain) {
        table.grant("router on this host", this_host, &passing(endpoints, keys));
    } else if endpoints.listen.iter().any(is_plain) {
        let anything = ["**".to_owned()];
        table.grant("this host", this_host, &[from(EVERYTHING, &anything), to(EVERYTHING, &anything)]);
    }
}

/// Rules, subjects and policies, as Zenoh reads them.
#[derive(Default)]
struct Table {
    rules: Vec<Value>,
    subjects: Vec<Value>,
    policies: Vec<Value>,
}

impl Table {
    fn grant(&mut self, id: &str, mut subject: Value, rights: &[Right]) {
        let mut names = Vec::new();
        for (k, right) in rights.iter().enumerate() {
            let name = format!("{id} {k}");
            self.rules.push(json!({
                "id": name, "permission": "allow", "flows": [right.flow], "messages": right.messages,
                "key_exprs": right.keys,
            }));
            names.push(name);
        }
        subject["id"] = json!(id);
        self.subjects.push(subject);
        self.policies.push(json!({"rules": names, "subjects": [id]}));
    }

    fn settings(self) -> Value {
        json!({
            "enabled": true, "default_permission": "deny",
            "rules": self.rules, "subjects": self.subjects, "policies": self.policies,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::options::TlsConfig;

    /// Names of the subjects that a session knows, and the keys of what they may ask and say.
    fn rights(endpoints: &Endpoints, subject: &str, flow: &str, message: &str) -> Vec<String> {
        let settings = access(endpoints);
        let rules = settings["rules"].as_array().unwrap().iter();
        let fits = |rule: &&Value| {
            let is_theirs = rule["id"].as_str().unwrap().rsplit_once(' ').unwrap().0 == subject;
            is_theirs
                && rule["flows"][0] == flow
                && rule["messages"].as_array().unwrap().contains(&json!(message))
        };
        let keys = rules.filter(fits).flat_map(|rule| rule["key_exprs"].as_array().unwrap().clone());
        keys.map(|key| key.as_str().unwrap().to_owned()).collect()
    }

    fn certified() -> Endpoints {
        let tls = TlsConfig { authority: "a".into(), ..TlsConfig::default() };
        Endpoints { tls, ..Endpoints::default() }
    }

    #[test]
    fn a_vehicle_hears_no_other_and_obeys_under_its_own_name_alone() {
        let drone = certified();
        assert_eq!(
            rights(&drone, "operator", "ingress", "query").last().unwrap(),
            "plumbline/drone/command/*"
        );
        assert!(rights(&drone, "router", "ingress", "put").is_empty());
        assert!(rights(&drone, "vehicle:drone", "ingress", "put").is_empty());
        let station = Endpoints { hears: vec!["drone".into()], ..certified() };
        assert_eq!(rights(&station, "vehicle:drone", "ingress", "put"), ["plumbline/drone/**"]);
        assert!(rights(&station, "vehicle:hawk", "ingress", "put").is_empty());
    }

    #[test]
    fn only_a_loopback_listener_is_this_host() {
        let plain = vec!["tcp/127.0.0.1:7447".to_owned()];
        let listening = Endpoints { listen: plain.clone(), ..certified() };
        assert_eq!(rights(&listening, "this host", "ingress", "query"), ["**"]);
        let both = Endpoints { connect: plain, ..listening };
        assert!(rights(&both, "this host", "ingress", "query").is_empty());
        let asked = rights(&both, "router on this host", "ingress", "query");
        assert!(!asked.is_empty() && !asked.iter().any(|key| key.contains("command")), "{asked:?}");
        assert!(rights(&certified(), "this host", "ingress", "query").is_empty());
    }
}
