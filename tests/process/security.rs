//! Authentication and authorization: real sessions with certificates, the right ones, wrong ones, and none.

use super::supervised::runtime;
use super::vehicle::{PLUMBLINE, Running, certify, eventually, flight, free_port, render};
use std::path::Path;
use std::process::{Command, Output};
use std::time::Duration;

fn keys(folder: &Path) {
    crate::done(Command::new(PLUMBLINE).arg("keys").arg(folder));
}

/// Options that name the files of a role.
fn as_role(folder: &Path, role: &str) -> Vec<String> {
    let file = |name: String| folder.join(name).display().to_string();
    vec![
        "--authority".into(),
        file("authority.pem".into()),
        "--certificate".into(),
        file(format!("{role}.pem")),
        "--key".into(),
        file(format!("{role}.key")),
    ]
}

fn reset(endpoint: &str, access: &[String]) -> Output {
    Command::new(PLUMBLINE).args(["reset", "drone", "--connect", endpoint]).args(access).output().unwrap()
}

/// States that a station with these keys receives within a few seconds.
fn states_heard(endpoint: &str, access: &[String]) -> usize {
    let heard = Command::new(PLUMBLINE)
        .args(["ground", "--json", "--no-http", "--duration", "2", "--connect", endpoint])
        .args(access)
        .output()
        .unwrap();
    String::from_utf8_lossy(&heard.stdout).lines().count()
}

#[test]
fn network_access_follows_the_certificate() {
    let folder = tempfile::tempdir().unwrap();
    let (ours, others) = (folder.path().join("ours"), folder.path().join("others"));
    keys(&ours);
    keys(&others);
    render(20);
    let endpoint = format!("tls/127.0.0.1:{}", free_port());
    let mut command = flight("drone", 20);
    certify(&mut command, &ours);
    command.args(["--listen", &endpoint]);
    let vehicle = Running::start(command);
    let said = |output: &Output| {
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
    };

    // A viewer sees the vehicle.
    eventually("a viewer hears the vehicle", Duration::from_secs(20), || {
        states_heard(&endpoint, &as_role(&ours, "viewer")) > 10
    });
    // It may not command.
    let refused = reset(&endpoint, &as_role(&ours, "viewer"));
    assert_eq!(refused.status.code(), Some(1), "{}", said(&refused));
    assert!(said(&refused).contains("may not command"), "{}", said(&refused));
    // A station with another authority's certificate, and those with none, hear nothing.
    let heard = std::thread::scope(|scope| {
        let uncertified = scope.spawn(|| states_without_certificate(&endpoint, &ours));
        let plain = scope.spawn(|| states_heard(&endpoint.replace("tls/", "tcp/"), &[]));
        let foreign = states_heard(&endpoint, &as_role(&others, "operator"));
        [foreign, uncertified.join().unwrap(), plain.join().unwrap()]
    });
    assert_eq!(heard, [0; 3]);
    eventually("the wrong certificate is in the log", Duration::from_secs(3), || {
        vehicle.words().contains("connection refused: a TLS handshake failed")
    });
    // An operator may.
    let done = reset(&endpoint, &as_role(&ours, "operator"));
    assert!(done.status.success(), "{}{}", said(&done), vehicle.words());
    assert!(said(&done).contains("soft reset done: the counter is now 1"), "{}", said(&done));
}

/// Messages that somebody who knows the authority but has no certificate receives.
fn states_without_certificate(endpoint: &str, folder: &Path) -> usize {
    let mut config = zenoh::Config::default();
    let settings = [
        ("mode", "\"client\"".to_owned()),
        ("connect/endpoints", format!("[\"{endpoint}\"]")),
        ("connect/timeout_ms", "2000".to_owned()),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("transport/link/tls/root_ca_certificate", format!("\"{}\"", folder.join("authority.pem").display())),
    ];
    for (key, value) in settings {
        config.insert_json5(key, &value).unwrap();
    }
    let runtime = runtime();
    runtime.block_on(async {
        let Ok(session) = zenoh::open(config).await else { return 0 };
        let Ok(subscriber) = session.declare_subscriber("plumbline/**").await else { return 0 };
        tokio::time::sleep(Duration::from_secs(2)).await;
        let heard = subscriber.drain().count();
        let _ = session.close().await;
        heard
    })
}

#[test]
fn network_commands_are_refused_where_anybody_can_connect() {
    render(20);
    let port = free_port();
    let mut command = flight("drone", 20);
    command.args(["--listen", &format!("tcp/0.0.0.0:{port}")]);
    let vehicle = Running::start(command);
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let mut told = String::new();
    eventually("the vehicle refuses", Duration::from_secs(10), || {
        let refused = reset(&endpoint, &[]);
        assert_eq!(refused.status.code(), Some(1));
        told = String::from_utf8_lossy(&refused.stderr).into_owned();
        told.contains("anybody can connect to tcp/0.0.0.0")
    });
    assert!(told.contains("network.commands"), "{told}");
    assert!(vehicle.words().contains("reset refused"), "{}", vehicle.words());
}
