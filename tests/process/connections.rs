//! Connections that cannot be made are explained, and nothing waits for ever or ignores a signal.

use super::vehicle::{PLUMBLINE, Running, eventually, free_port};
use super::{fails, plumbline, stderr, succeeds};
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

#[test]
fn a_second_station_ends_when_an_address_that_it_serves_is_taken() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let nobody = format!("tcp/127.0.0.1:{}", free_port());
    for (served, cure) in [(&["--http"][..], "--no-http"), (&["--no-http", "--foxglove"], "--foxglove")] {
        let start = Instant::now();
        let arguments = [&["ground", "--connect", &nobody, "--duration", "60"], served, &[&address]].concat();
        fails(&arguments, 1, &[&address, cure]);
        assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
    }
}

#[test]
fn a_station_that_hears_nobody_ends_on_a_signal() {
    let nobody = format!("tcp/127.0.0.1:{}", free_port());
    for signal in ["-INT", "-TERM"] {
        let mut command = Command::new(PLUMBLINE);
        command.args(["ground", "--no-http", "--plain", "--connect", &nobody]);
        let mut station = Running::start(command);
        eventually("it says what is the matter", Duration::from_secs(10), || {
            station.words().contains("no listener at that port yet")
        });
        Command::new("kill").args([signal, &station.child.id().to_string()]).status().unwrap();
        eventually("it ends", Duration::from_secs(5), || station.child.try_wait().unwrap().is_some());
        assert_eq!(station.child.wait().unwrap().code(), Some(0));
    }
}

#[test]
fn a_flight_goes_on_when_its_terminal_is_closed_and_after_signals_of_others() {
    let folder = tempfile::tempdir().unwrap();
    let frames = format!("driver.frames.listen=\"{}\"", folder.path().join("frames").display());
    let mut command = Command::new(PLUMBLINE);
    command.args(["fly", "--config", "euroc", "--set", &frames, "--set"]);
    command.arg("driver.imu.connect=\"serial:///dev/nowhere:921600\"");
    let mut flight = Running::start(command);
    let signal = |flight: &Running, name: &str| {
        Command::new("kill").args([name, &flight.child.id().to_string()]).status().unwrap();
    };
    eventually("it waits for its sensors", Duration::from_secs(20), || {
        flight.words().contains("/dev/nowhere")
    });
    for (k, name) in ["-HUP", "-USR1", "-ALRM"].into_iter().enumerate() {
        signal(&flight, name);
        let is_told = || flight.words().matches("the flight continues").count() > k;
        eventually("it says so", Duration::from_secs(10), is_told);
    }
    assert!(flight.child.try_wait().unwrap().is_none(), "{}", flight.words());
    signal(&flight, "-TERM");
    eventually("it ends", Duration::from_secs(10), || flight.child.try_wait().unwrap().is_some());
}

#[test]
fn a_station_that_heard_nobody_says_why_and_fails() {
    let nobody = format!("tcp/127.0.0.1:{}", free_port());
    let listens = |endpoint: &str, words: &str| {
        let output = plumbline(&["ground", "--no-http", "--json", "--connect", endpoint, "--duration", "3"]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains(endpoint) && said.contains(words), "{said}");
        assert!(!said.contains(".rs:") && !said.contains('\u{1b}'), "{said}");
    };
    std::thread::scope(|scope| {
        scope.spawn(|| listens(&nobody, "no listener at that port"));
        scope.spawn(|| listens("tcp/no-such-host.invalid:7447", "host name is unknown"));
    });
}

#[test]
fn endpoints_that_cannot_work_are_wrong_usage() {
    for endpoint in ["127.0.0.1:7447", "http/127.0.0.1:1", "tcp/host", "tcp/host:port", "tls/127.0.0.1:1"] {
        fails(&["ground", "--no-http", "--connect", endpoint, "--duration", "2"], 2, &[endpoint]);
        fails(&["router", "--listen", endpoint], 2, &[endpoint]);
        fails(&["reset", "drone", "--connect", endpoint], 2, &[endpoint]);
    }
    let publish = ["replay", "sim:room", "--scale", "0.5", "--publish", "--listen", "tcp/x"];
    fails(&publish, 2, &["tcp/x", "names no port"]);
    fails(&["router", "--listen", "tcp/192.0.2.1:7447"], 2, &["192.0.2.1", "address of this host"]);
}

#[test]
fn a_page_for_others_is_opened_by_no_name_that_somebody_made_to_point_there() {
    let port = free_port();
    let nobody = format!("tcp/127.0.0.1:{}", free_port());
    let mut command = Command::new(PLUMBLINE);
    command.args(["ground", "--plain", "--connect", &nobody, "--http", &format!("0.0.0.0:{port}")]);
    let _station = Running::start(command);
    eventually("the page is served", Duration::from_secs(10), || {
        TcpStream::connect(("127.0.0.1", port)).is_ok()
    });
    let ask = |request: &str, host: &str, body: &str| {
        let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        let length = body.len();
        let head = format!(
            "{request} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\nContent-Type: application/json\r\n\
             Content-Length: {length}\r\n\r\n{body}"
        );
        stream.write_all(head.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    };
    let address = format!("127.0.0.1:{port}");
    assert!(ask("GET /", &address, "").starts_with("HTTP/1.1 200"));
    assert!(ask("GET /", &format!("192.168.1.7:{port}"), "").starts_with("HTTP/1.1 200"));
    assert!(ask("GET /", &format!("evil.example:{port}"), "").starts_with("HTTP/1.1 403"));
    // Without commands it resets nothing either.
    let answer = ask("POST /api/vehicles/drone/reset", &address, r#"{"kind":"soft"}"#);
    assert!(answer.starts_with("HTTP/1.1 403") && answer.contains("--allow-commands"), "{answer}");
}

#[test]
fn a_port_that_is_taken_is_told() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = format!("tcp/{}", taken.local_addr().unwrap());
    fails(&["router", "--listen", &endpoint], 1, &[&endpoint, "port already in use"]);
}

/// Options that name the files of a role.
fn access(folder: &Path, authority: &Path, role: &str) -> Vec<String> {
    let options = [
        ("--authority", authority.join("authority.pem")),
        ("--certificate", folder.join(format!("{role}.pem"))),
        ("--key", folder.join(format!("{role}.key"))),
    ];
    options.into_iter().flat_map(|(option, file)| [option.to_owned(), file.display().to_string()]).collect()
}

#[test]
fn stations_that_are_not_let_in_are_told_why() {
    let folder = tempfile::tempdir().unwrap();
    let [ours, others] = ["ours", "others"].map(|name| folder.path().join(name));
    for folder in [&ours, &others] {
        let made = Command::new(PLUMBLINE).arg("keys").arg(folder).stdout(Stdio::null()).status().unwrap();
        assert!(made.success());
    }
    let port = free_port();
    let mut router = Command::new(PLUMBLINE);
    router
        .args(["router", "--listen", &format!("tls/127.0.0.1:{port}")])
        .args(access(&ours, &ours, "router"));
    let _router = Running::start(router);
    eventually("the router listens", Duration::from_secs(10), || {
        std::net::TcpStream::connect(("127.0.0.1", port)).is_ok()
    });
    let is_told = |protocol: &str, access: Vec<String>, words: &str| {
        let endpoint = format!("{protocol}/127.0.0.1:{port}");
        let output = Command::new(PLUMBLINE)
            .args(["ground", "--no-http", "--json", "--duration", "2", "--connect", &endpoint])
            .args(access)
            .output()
            .unwrap();
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains(words), "'{words}' is missing in: {said}");
    };
    std::thread::scope(|scope| {
        scope.spawn(|| is_told("tls", access(&others, &others, "operator"), "signed by another authority"));
        scope.spawn(|| is_told("tls", access(&others, &ours, "viewer"), "does not accept our certificate"));
        scope.spawn(|| is_told("tcp", Vec::new(), "does it ask for certificates"));
    });
}

#[test]
fn keys_are_added_and_renewed_in_their_folder() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_str().unwrap();
    for arguments in [&["keys", path][..], &["keys", path, "--vehicle", "hawk"], &["keys", path, "--renew"]] {
        succeeds(arguments);
    }
    fails(&["keys", path, "--vehicle", "hawk"], 2, &["vehicle-hawk.pem", "--renew"]);
    fails(&["keys", path, "--vehicle", "kite", "--renew"], 2, &["vehicle-kite.pem"]);
    fails(&["keys", path, "--vehicle", "../kite"], 2, &["--vehicle ../kite"]);
    let port = free_port();
    let mut router = Command::new(PLUMBLINE);
    router.args(["router", "--listen", &format!("tls/127.0.0.1:{port}")]);
    router.args(access(folder.path(), folder.path(), "vehicle-hawk"));
    let _router = Running::start(router);
    eventually("the renewed certificate serves", Duration::from_secs(10), || {
        let output = Command::new(PLUMBLINE)
            .args(["reset", "hawk", "--connect", &format!("tls/127.0.0.1:{port}")])
            .args(access(folder.path(), folder.path(), "operator"))
            .output()
            .unwrap();
        stderr(&output).contains("no vehicle of that name")
    });
}
