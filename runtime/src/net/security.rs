//! Who may connect, and who may do what: settings for Zenoh, and the rule for commands.
//!
//! With certificates every link is mutual TLS, and the common name of a peer's certificate is its role:
//! `vehicle` and `router` may publish, `operator` (and a router, which keeps the same rules) may command,
//! `viewer` may look. With names and passwords those listed as operators may command. Processes of this host
//! that come over plain TCP on the loopback interface may do everything.

use super::ROOT;
use super::endpoints::Endpoints;
use super::error::NetError;
use plumbline_config::options::Commands;
use serde_json::{Value, json};
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

/// Common names of certificates that may command.
pub const COMMANDERS: [&str; 2] = ["operator", "router"];
/// Common names of certificates that may publish.
pub const PUBLISHERS: [&str; 2] = ["vehicle", "router"];
/// Longest password file that is read, bytes.
const MAX_PASSWORD_BYTES: u64 = 4_096;

/// Settings of Zenoh for certificates, passwords and access; empty when there are none.
///
/// # Errors
/// When a file cannot be read.
pub fn settings(endpoints: &Endpoints) -> Result<Vec<(&'static str, String)>, NetError> {
    let mut settings = Vec::new();
    let (tls, login) = (&endpoints.tls, &endpoints.login);
    if tls.is_given() {
        let files = [
            ("network.tls.authority", &tls.authority),
            ("network.tls.certificate", &tls.certificate),
            ("network.tls.key", &tls.key),
        ];
        for (key, path) in files {
            readable(key, path)?;
        }
        settings.push(("transport/link/tls", tls_settings(endpoints).to_string()));
    }
    let mut usrpwd = serde_json::Map::new();
    if !login.user.is_empty() {
        let password = first_line("network.login.password_file", &login.password_file)?;
        usrpwd.insert("user".into(), json!(login.user));
        usrpwd.insert("password".into(), json!(password));
    }
    if has_users(endpoints) {
        readable("network.login.users_file", &login.users_file)?;
        usrpwd.insert("dictionary_file".into(), json!(login.users_file));
    }
    if !usrpwd.is_empty() {
        settings.push(("transport/auth/usrpwd", Value::Object(usrpwd).to_string()));
    }
    if tls.is_given() || has_users(endpoints) {
        settings.push(("access_control", access(endpoints).to_string()));
    }
    Ok(settings)
}

fn has_users(endpoints: &Endpoints) -> bool {
    !endpoints.login.users_file.as_os_str().is_empty()
}

fn tls_settings(endpoints: &Endpoints) -> Value {
    let tls = &endpoints.tls;
    json!({
        "root_ca_certificate": tls.authority,
        "listen_certificate": tls.certificate,
        "listen_private_key": tls.key,
        "connect_certificate": tls.certificate,
        "connect_private_key": tls.key,
        "enable_mtls": true,
        "verify_name_on_connect": true,
        "close_link_on_expiration": true,
    })
}

/// Everybody may look; only some may command or publish. Of several subjects that fit a peer one that
/// allows is enough.
fn access(endpoints: &Endpoints) -> Value {
    let with_certificates = endpoints.tls.is_given();
    let commands = [format!("{ROOT}/*/command/**")];
    let all = [format!("{ROOT}/**")];
    let publishing = ["put", "delete", "declare_queryable", "reply", "liveliness_token"];
    let rule = |id: &str, permission: &str, messages: &[&str], keys: &[String]| json!({"id": id, "permission": permission, "flows": ["ingress"], "messages": messages, "key_exprs": keys});
    let mut rules = vec![
        rule("no commands", "deny", &["query"], &commands),
        rule("commands", "allow", &["query"], &commands),
    ];
    let mut subjects = vec![
        json!({"id": "everybody"}),
        json!({"id": "this host", "interfaces": ["lo"], "link_protocols": ["tcp"]}),
    ];
    let mut policies = vec![
        json!({"rules": ["no commands"], "subjects": ["everybody"]}),
        json!({"rules": ["commands"], "subjects": ["this host"]}),
    ];
    if with_certificates {
        rules.push(rule("no publishing", "deny", &publishing, &all));
        rules.push(rule("publishing", "allow", &publishing, &all));
        subjects.push(json!({"id": "commanders", "cert_common_names": COMMANDERS}));
        subjects.push(json!({"id": "publishers", "cert_common_names": PUBLISHERS}));
        policies.push(json!({"rules": ["no publishing"], "subjects": ["everybody"]}));
        policies.push(json!({"rules": ["publishing"], "subjects": ["this host", "publishers"]}));
        policies.push(json!({"rules": ["commands"], "subjects": ["commanders"]}));
    }
    if !endpoints.login.operators.is_empty() {
        subjects.push(json!({"id": "operators", "usernames": endpoints.login.operators}));
        policies.push(json!({"rules": ["commands"], "subjects": ["operators"]}));
    }
    json!({
        "enabled": true, "default_permission": "allow",
        "rules": rules, "subjects": subjects, "policies": policies,
    })
}

/// Why commands are refused whoever gives them; `None` when who may is left to the access rules.
#[must_use]
pub fn refusal(commands: Commands, endpoints: &Endpoints) -> Option<String> {
    match commands {
        Commands::Anybody => return None,
        Commands::Nobody => {
            return Some("this vehicle takes no commands: network.commands is \"nobody\"".into());
        }
        Commands::Authenticated => {}
    }
    let cure =
        "give certificates in [network.tls] and endpoints that begin with tls/, or set network.commands";
    if endpoints.scouting && !endpoints.tls.is_given() && !has_users(endpoints) {
        return Some(format!("commands are refused: multicast scouting lets anybody in; {cure}"));
    }
    let is_closed = |endpoint: &String| {
        is_loopback(endpoint) || (endpoint.starts_with("tls/") && endpoints.tls.is_given())
    };
    if let Some(open) = endpoints.listen.iter().find(|e| !is_closed(e) && !has_users(endpoints)) {
        return Some(format!("commands are refused: anybody can connect to {open}; {cure}"));
    }
    let open = endpoints.connect.iter().find(|e| !is_closed(e) && endpoints.login.user.is_empty());
    open.map(|open| format!("commands are refused: nobody knows who commands through {open}; {cure}"))
}

/// Whether an endpoint such as `tcp/127.0.0.1:7447` is this host's alone.
#[must_use]
pub fn is_loopback(endpoint: &str) -> bool {
    let address = endpoint.split_once('/').map_or(endpoint, |(_, address)| address);
    let host = address.split(['?', '#']).next().and_then(|a| a.rsplit_once(':')).map_or("", |(host, _)| host);
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

fn file_error(key: &'static str, path: &Path, message: &str) -> NetError {
    NetError::File { path: path.to_owned(), key, message: message.to_owned() }
}

fn readable(key: &'static str, path: &Path) -> Result<(), NetError> {
    let cannot = |error: std::io::Error| file_error(key, path, &format!("cannot be read: {error}"));
    let is_file = File::open(path).and_then(|file| file.metadata()).map_err(cannot)?.is_file();
    if is_file { Ok(()) } else { Err(file_error(key, path, "is no file")) }
}

fn first_line(key: &'static str, path: &Path) -> Result<String, NetError> {
    let mut text = String::new();
    File::open(path)
        .and_then(|file| file.take(MAX_PASSWORD_BYTES).read_to_string(&mut text))
        .map_err(|error| file_error(key, path, &format!("cannot be read: {error}")))?;
    let line = text.lines().next().unwrap_or_default().trim_end().to_owned();
    if line.is_empty() { Err(file_error(key, path, "holds no password on its first line")) } else { Ok(line) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::options::{LoginConfig, TlsConfig};

    fn listening_on(endpoint: &str) -> Endpoints {
        Endpoints { listen: vec![endpoint.into()], ..Endpoints::default() }
    }

    #[test]
    fn loopback_is_told_from_the_rest() {
        for endpoint in ["tcp/127.0.0.1:7447", "tcp/localhost:1", "udp/[::1]:7447", "tls/127.1.2.3:7#a=b"] {
            assert!(is_loopback(endpoint), "{endpoint}");
        }
        for endpoint in
            ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/10.0.0.1:7447", "tcp/localhost.evil:1", "x"]
        {
            assert!(!is_loopback(endpoint), "{endpoint}");
        }
    }

    #[test]
    fn commands_are_refused_where_anybody_can_connect() {
        let open = listening_on("tcp/0.0.0.0:7447");
        assert!(refusal(Commands::Authenticated, &open).unwrap().contains("tcp/0.0.0.0:7447"));
        assert_eq!(refusal(Commands::Anybody, &open), None);
        let alone = listening_on("tcp/127.0.0.1:7447");
        assert_eq!(refusal(Commands::Authenticated, &alone), None);
        assert!(refusal(Commands::Nobody, &alone).is_some());
        assert!(refusal(Commands::Authenticated, &Endpoints { scouting: true, ..alone }).is_some());
        let out = Endpoints { connect: vec!["tcp/10.0.0.1:7447".into()], ..Endpoints::default() };
        assert!(refusal(Commands::Authenticated, &out).unwrap().contains("10.0.0.1"));
    }

    #[test]
    fn certificates_and_names_open_the_way_for_commands() {
        let tls = TlsConfig { authority: "a".into(), certificate: "c".into(), key: "k".into() };
        let closed = Endpoints { tls: tls.clone(), ..listening_on("tls/0.0.0.0:7447") };
        assert_eq!(refusal(Commands::Authenticated, &closed), None);
        let half = Endpoints { tls, ..listening_on("tcp/0.0.0.0:7447") };
        assert!(refusal(Commands::Authenticated, &half).is_some());
        let login = LoginConfig { users_file: "u".into(), ..LoginConfig::default() };
        let named = Endpoints { login, ..listening_on("tcp/0.0.0.0:7447") };
        assert_eq!(refusal(Commands::Authenticated, &named), None);
    }

    #[test]
    fn a_missing_file_is_named_with_its_key() {
        let tls = TlsConfig { authority: "/nowhere/ca.pem".into(), certificate: "c".into(), key: "k".into() };
        let error = settings(&Endpoints { tls, ..Endpoints::default() }).unwrap_err().to_string();
        assert!(error.contains("/nowhere/ca.pem") && error.contains("network.tls.authority"), "{error}");
    }

    #[test]
    fn without_keys_nothing_is_set() {
        assert!(settings(&Endpoints::default()).unwrap().is_empty());
    }
}
