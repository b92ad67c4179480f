//! Every role against every deed, with real sessions over mutual TLS: the table in `docs/security.md` is what is tried here,
//! field by field. Whoever attacks is a session that obeys no rules of its own.

use super::supervised::runtime;
use super::vehicle::free_port;
use plumbline_config::Config;
use plumbline_config::options::{CommandAccess, TlsConfig};
use plumbline_ground::command::{self, ResetWords};
use plumbline_link::net::keys::{self, KeysRequest};
use plumbline_link::net::{Endpoints, Mode, Publisher};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use zenoh::Session;
use zenoh::bytes::ZBytes;
use zenoh::qos::CongestionControl;
use zenoh::query::QueryTarget;

/// Actions tried, in the words of the table.
const DEEDS: [&str; 7] =
    ["put", "delete", "query", "offer answers", "be seen alive", "watch who is alive", "subscribe"];
/// On these keys.
const KEYS: [&str; 6] = [
    "plumbline/drone/odom",
    "plumbline/hawk/odom",
    "plumbline/drone/command/reset",
    "plumbline/*/command/**",
    "*/drone/odom",
    "**",
];
/// A key that is asked.
const QUESTION: &str = "plumbline/drone/trajectory/**";
/// By whom, with the files of their certificates.
const ROLES: [(&str, &str); 4] =
    [("viewer", "viewer"), ("operator", "operator"), ("vehicle drone", "vehicle"), ("router", "router")];
/// Time within which an allowed message arrives; a forbidden one has as long to arrive.
const PATIENCE: Duration = Duration::from_secs(10);
const QUIET: Duration = Duration::from_millis(150);

/// Deed and key.
type Field = (&'static str, &'static str);

/// Whom somebody tries it on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Guard {
    /// A router; a ground station has the same rules.
    Ground,
    Vehicle,
}

fn fields() -> Vec<Field> {
    let mut fields: Vec<Field> = DEEDS.iter().flat_map(|deed| KEYS.map(|key| (*deed, key))).collect();
    fields.push(("query", QUESTION));
    fields
}

/// The table of the documentation: the words of every field, by role.
fn documented() -> BTreeMap<Field, Vec<String>> {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/security.md"))
        .unwrap();
    let mut table = BTreeMap::new();
    for line in text.lines().filter(|line| line.starts_with('|')) {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        // A row is of each of its operations on each of its keys.
        let [deeds, keys, words @ ..] = cells.as_slice() else { continue };
        for deed in deeds.split("; ") {
            for key in keys.split(", ").map(|key| key.trim_matches('`')) {
                let Some(field) = fields().into_iter().find(|field| *field == (deed, key)) else { continue };
                let words = words.iter().map(|word| (*word).to_owned()).collect();
                assert!(table.insert(field, words).is_none(), "{field:?} stands there twice");
            }
        }
    }
    assert_eq!(table.len(), fields().len(), "fields are missing in docs/security.md");
    table
}

/// Rights of a role, by the table.
fn allowed(role: usize, guard: Guard) -> BTreeSet<Field> {
    let is_allowed = |words: &str| match words {
        "yes" => true,
        "ground" => guard == Guard::Ground,
        "no" => false,
        other => panic!("the table says '{other}'"),
    };
    documented().into_iter().filter(|(_, words)| is_allowed(&words[role])).map(|(field, _)| field).collect()
}

/// A folder with the keys of every role.
pub fn with_keys() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    make_keys(folder.path(), false);
    folder
}

pub fn make_keys(folder: &Path, renew: bool) {
    let request = KeysRequest { folder, roles: &[], vehicles: &[], hosts: &[], days: 2, renew };
    keys::make(&request).unwrap();
}

fn certificates(folder: &Path, role: &str) -> TlsConfig {
    TlsConfig {
        authority: folder.join("authority.pem"),
        certificate: folder.join(format!("{role}.pem")),
        key: folder.join(format!("{role}.key")),
        excluded: Vec::new(),
    }
}

impl Guard {
    async fn open(self, folder: &Path, listen: &str, excluded: &[String]) -> Session {
        let (mode, role, hears) = match self {
            Self::Ground => (Mode::Router, "router", vec!["drone".to_owned(), "hawk".to_owned()]),
            Self::Vehicle => (Mode::Peer, "vehicle", Vec::new()),
        };
        let tls = TlsConfig { excluded: excluded.to_vec(), ..certificates(folder, role) };
        let listen = vec![listen.to_owned()];
        Endpoints { mode, hears, tls, listen, ..Endpoints::default() }.open().await.unwrap()
    }
}

/// A vehicle's session with nothing behind it.
pub async fn open_vehicle(folder: &Path, listen: &str, excluded: &[String]) -> Session {
    Guard::Vehicle.open(folder, listen, excluded).await
}

/// A router's session.
pub async fn open_router(folder: &Path, listen: &str) -> Session {
    Guard::Ground.open(folder, listen, &[]).await
}

/// A session without rules, with the certificate of a role.
pub async fn attacker(folder: &Path, role: &str, connect: &str) -> Session {
    try_to_connect(folder, role, connect).await.unwrap()
}

/// Opens a session that may be refused, or that finds no listener.
pub async fn try_to_connect(folder: &Path, role: &str, connect: &str) -> zenoh::Result<Session> {
    let tls = certificates(folder, role);
    let tls = serde_json::json!({
        "root_ca_certificate": tls.authority, "enable_mtls": true,
        "connect_certificate": tls.certificate, "connect_private_key": tls.key,
    });
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"client\"".to_owned()),
        ("connect/endpoints", serde_json::json!([connect]).to_string()),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("transport/link/tls", tls.to_string()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    zenoh::open(config).await
}

/// Words that arrived.
#[derive(Clone, Default)]
struct Arrived(Arc<Mutex<BTreeSet<String>>>);

impl Arrived {
    fn take(&self, words: Option<&ZBytes>) {
        if let Some(words) = words.and_then(|bytes| bytes.try_to_string().ok()) {
            self.0.lock().unwrap().insert(words.into_owned());
        }
    }

    fn has(&self, words: &str) -> bool {
        self.0.lock().unwrap().contains(words)
    }
}

/// One role at one guard.
struct Scene {
    guard: Session,
    attacker: Session,
    allowed: BTreeSet<Field>,
    achieved: BTreeSet<Field>,
}

impl Scene {
    /// Plays the attacker, and returns what succeeds.
    async fn play(mut self) -> BTreeSet<Field> {
        self.send().await;
        self.watch().await;
        self.be_seen().await;
        // Refused ones first: nothing of the others is on its way then.
        let mut keys = KEYS;
        for deed in ["subscribe", "offer answers"] {
            keys.sort_by_key(|key| self.allowed.contains(&(deed, *key)));
            for key in keys {
                let is_heard =
                    if deed == "subscribe" { self.hears(key).await } else { self.is_asked(key).await };
                if is_heard {
                    self.achieved.insert((deed, key));
                }
            }
        }
        let _ = self.attacker.close().await;
        let _ = self.guard.close().await;
        self.achieved
    }

    /// Puts, deletes and queries, all at once.
    async fn send(&mut self) {
        let arrived = Arrived::default();
        let heard = arrived.clone();
        let everything =
            self.guard.declare_subscriber("**").callback(move |sample| heard.take(sample.attachment()));
        let _everything = everything.await.unwrap();
        let mut answering = Vec::new();
        for key in ["plumbline/drone/**", "plumbline/hawk/**"] {
            let asked = arrived.clone();
            let queryable =
                self.guard.declare_queryable(key).callback(move |query| asked.take(query.attachment()));
            answering.push(queryable.await.unwrap());
        }
        let fields = fields();
        for (deed, key) in &fields {
            let words = format!("{deed} {key}");
            let block = CongestionControl::Block;
            match *deed {
                "put" => {
                    self.attacker.put(*key, "x").attachment(words).congestion_control(block).await.unwrap()
                }
                "delete" => {
                    self.attacker.delete(*key).attachment(words).congestion_control(block).await.unwrap()
                }
                "query" => {
                    drop(self.attacker.get(*key).attachment(words).target(QueryTarget::All).await.unwrap())
                }
                _ => {}
            }
        }
        let came = |field: &Field| arrived.has(&format!("{} {}", field.0, field.1));
        let sent = |field: &&Field| matches!(field.0, "put" | "delete" | "query");
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end && !self.allowed.iter().filter(sent).all(came) {
            tokio::time::sleep(QUIET / 5).await;
        }
        tokio::time::sleep(QUIET).await;
        self.achieved.extend(fields.iter().filter(sent).filter(|field| came(field)));
    }

    /// Asks for tokens that the guard declares.
    async fn watch(&mut self) {
        let mut tokens = Vec::new();
        for key in &KEYS[..3] {
            tokens.push(self.guard.liveliness().declare_token(*key).await.unwrap());
        }
        for key in KEYS {
            let is_allowed = self.allowed.contains(&("watch who is alive", key));
            let end = Instant::now() + if is_allowed { PATIENCE } else { QUIET };
            let mut is_seen = false;
            while !is_seen && Instant::now() < end {
                let replies = self.attacker.liveliness().get(key).timeout(2 * QUIET).await.unwrap();
                is_seen = replies.recv_async().await.is_ok_and(|reply| reply.result().is_ok());
            }
            if is_seen {
                self.achieved.insert(("watch who is alive", key));
            }
        }
    }

    /// Declares tokens; the guard looks.
    async fn be_seen(&mut self) {
        let mut tokens = Vec::new();
        for key in KEYS {
            tokens.extend(self.attacker.liveliness().declare_token(key).await);
        }
        let end = Instant::now() + PATIENCE;
        let mut seen = BTreeSet::new();
        let mut is_last = false;
        while !is_last {
            tokio::time::sleep(QUIET).await;
            let is_complete = |seen: &BTreeSet<Field>| {
                self.allowed
                    .iter()
                    .filter(|(deed, _)| *deed == "be seen alive")
                    .all(|field| seen.contains(field))
            };
            is_last = is_complete(&seen) || Instant::now() > end;
            let replies = self.guard.liveliness().get("**").timeout(PATIENCE).await.unwrap();
            while let Ok(reply) = replies.recv_async().await {
                let Ok(sample) = reply.result() else { continue };
                let key = KEYS.into_iter().find(|key| *key == sample.key_expr().as_str());
                seen.extend(key.map(|key| ("be seen alive", key)));
            }
        }
        self.achieved.extend(seen);
    }

    /// True if a subscription receives what the guard publishes.
    async fn hears(&self, key: &'static str) -> bool {
        let arrived = Arrived::default();
        let heard = arrived.clone();
        let subscriber =
            self.attacker.declare_subscriber(key).callback(move |sample| heard.take(sample.attachment()));
        let _subscriber = subscriber.await.unwrap();
        let end = self.end("subscribe", key);
        while !arrived.has(key) && Instant::now() < end {
            tokio::time::sleep(QUIET / 3).await;
            for published in &KEYS[..3] {
                self.guard.put(*published, "x").attachment(key).await.unwrap();
            }
        }
        arrived.has(key)
    }

    /// True if a queryable receives the queries of the guard.
    async fn is_asked(&self, key: &'static str) -> bool {
        let arrived = Arrived::default();
        let heard = arrived.clone();
        let queryable = self.attacker.declare_queryable(key).complete(true);
        let _queryable = queryable.callback(move |query| heard.take(query.attachment())).await.unwrap();
        let end = self.end("offer answers", key);
        while !arrived.has(key) && Instant::now() < end {
            tokio::time::sleep(QUIET / 3).await;
            for asked in &KEYS[..3] {
                drop(self.guard.get(*asked).target(QueryTarget::All).attachment(key).await.unwrap());
            }
        }
        arrived.has(key)
    }

    fn end(&self, deed: &'static str, key: &'static str) -> Instant {
        Instant::now() + if self.allowed.contains(&(deed, key)) { PATIENCE } else { 2 * QUIET }
    }
}

#[test]
fn network_every_role_may_do_what_the_table_says_and_nothing_else() {
    let folder = with_keys();
    let mut wrong = Vec::new();
    runtime().block_on(async {
        let mut scenes = Vec::new();
        for guard in [Guard::Ground, Guard::Vehicle] {
            for (number, (role, file)) in ROLES.into_iter().enumerate() {
                let endpoint = format!("tls/127.0.0.1:{}", free_port());
                let scene = Scene {
                    guard: guard.open(folder.path(), &endpoint, &[]).await,
                    attacker: attacker(folder.path(), file, &endpoint).await,
                    allowed: allowed(number, guard),
                    achieved: BTreeSet::new(),
                };
                let allowed = scene.allowed.clone();
                scenes.push((guard, role, allowed, tokio::spawn(scene.play())));
            }
        }
        for (guard, role, allowed, scene) in scenes {
            let achieved = scene.await.unwrap();
            wrong.extend(
                achieved.difference(&allowed).map(|field| format!("{guard:?}: {role} could {field:?}")),
            );
            wrong.extend(
                allowed.difference(&achieved).map(|field| format!("{guard:?}: {role} could not {field:?}")),
            );
        }
    });
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn network_an_excluded_certificate_gets_no_link_and_the_next_one_of_its_holder_does_all() {
    let folder = tempfile::tempdir().unwrap();
    let [old, new] = ["old", "new"].map(|name| folder.path().join(name));
    make_keys(&old, false);
    std::fs::create_dir(&new).unwrap();
    for entry in std::fs::read_dir(&old).unwrap().map(Result::unwrap) {
        std::fs::copy(entry.path(), new.join(entry.file_name())).unwrap();
    }
    make_keys(&new, true);
    let key = "plumbline/drone/command/reset";
    runtime().block_on(async {
        let endpoint = format!("tls/127.0.0.1:{}", free_port());
        let vehicle = Guard::Vehicle.open(&new, &endpoint, &["operator.1".into()]).await;
        let arrived = Arrived::default();
        let asked = arrived.clone();
        let queryable = vehicle.declare_queryable(key).callback(move |query| asked.take(query.attachment()));
        let _queryable = queryable.await.unwrap();
        let refused = try_to_connect(&old, "operator", &endpoint).await;
        assert!(refused.is_err(), "the excluded one gets no link");
        let operator = attacker(&new, "operator", &endpoint).await;
        let end = Instant::now() + PATIENCE;
        while !arrived.has("second") && Instant::now() < end {
            drop(operator.get(key).attachment("second").await.unwrap());
            tokio::time::sleep(QUIET / 3).await;
        }
        let _ = operator.close().await;
        assert!(arrived.has("second"), "the renewed certificate serves");
    });
}

#[test]
fn network_a_router_whose_certificate_is_excluded_is_not_connected_to() {
    let folder = with_keys();
    runtime().block_on(async {
        let endpoint = format!("tls/127.0.0.1:{}", free_port());
        let router = Guard::Ground.open(folder.path(), &endpoint, &[]).await;
        let connecting = |excluded: &[String]| {
            let tls = TlsConfig { excluded: excluded.to_vec(), ..certificates(folder.path(), "viewer") };
            let connect = vec![endpoint.clone()];
            let hears = vec!["drone".to_owned()];
            Endpoints { mode: Mode::Client, hears, tls, connect, ..Endpoints::default() }
        };
        let error = connecting(&["router".into()]).open().await.err().map(|error| error.to_string());
        assert!(error.is_some(), "no link to it");
        let station = connecting(&["operator".into()]).open().await.unwrap();
        let _ = station.close().await;
        let _ = router.close().await;
    });
}

/// A vehicle in this process, with nothing that it could reset.
fn vehicle(endpoints: Endpoints) -> Publisher {
    let config = Config::preset("sim").unwrap();
    Publisher::start(&config, &endpoints, Arc::default(), false).unwrap().0
}

#[test]
fn network_nobody_commands_through_a_router_of_the_vehicles_host() {
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let runtime = runtime();
    let (listen, connect) = (vec![endpoint.clone()], vec![endpoint]);
    let router =
        Endpoints { mode: Mode::Router, listen, hears: vec!["drone".into()], ..Endpoints::default() };
    let router = runtime.block_on(router.open()).unwrap();
    let drone = vehicle(Endpoints { connect: connect.clone(), ..Endpoints::default() });
    let outcome = runtime.block_on(async {
        let somebody =
            Endpoints { mode: Mode::Client, connect, ..Endpoints::default() }.open().await.unwrap();
        assert!(command::find(&somebody, "drone").await);
        let outcome = command::reset(&somebody, "drone", ResetWords::Soft).await;
        let _ = somebody.close().await;
        outcome
    });
    drop(drone);
    let _ = runtime.block_on(async { router.close().await });
    let words = outcome.unwrap_err();
    assert!(words.contains("without authentication"), "{words}");
}

#[test]
fn network_somebody_who_answers_everything_reports_no_command_as_done() {
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let runtime = runtime();
    let drone = vehicle(Endpoints {
        listen: vec![endpoint.clone()],
        commands: CommandAccess::Authenticated,
        ..Endpoints::default()
    });
    let outcome = runtime.block_on(async {
        let client =
            || Endpoints { mode: Mode::Client, connect: vec![endpoint.clone()], ..Endpoints::default() };
        let rogue = client().open().await.unwrap();
        let heard = Arrived::default();
        let asked = heard.clone();
        let answering = rogue.declare_queryable("**").complete(true).callback(move |query| {
            asked.take(Some(&ZBytes::from("asked")));
            // A reset that was done, in the wire format: "words" is the second field.
            let done = [&[0x12, 6][..], b"rogue!"].concat();
            drop(zenoh::Wait::wait(query.reply("plumbline/*/command/reset", done)));
        });
        let _answering = answering.await.unwrap();
        let station = client().open().await.unwrap();
        assert!(command::find(&station, "drone").await);
        let mut outcome = command::reset(&station, "drone", ResetWords::Soft).await;
        let end = Instant::now() + PATIENCE;
        while !heard.has("asked") && Instant::now() < end {
            outcome = command::reset(&station, "drone", ResetWords::Soft).await;
        }
        assert!(heard.has("asked"), "the rogue was asked");
        outcome
    });
    drop(drone);
    let words = outcome.unwrap_err();
    assert!(words.contains("no frame has arrived since"), "{words}");
}
