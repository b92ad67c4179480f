//! A bad radio link: vehicle, router and two stations in network namespaces of their own, and an emulator of
//! loss, delay and rate between vehicle and router (`tests/python/bad_link.py`).

use crate::json;
use crate::vehicle::{PLUMBLINE, Running, flight, render, resident_mb};
use plumbline_test_support::{Need, SOAK_IN_FULL_MIN, skip, soak_minutes};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

/// Network namespaces that go with the test.
struct Namespaces(Vec<String>);

impl Namespaces {
    /// `None` where the host does not allow it; the test says so.
    fn new(names: &[&str]) -> Option<Self> {
        let mut made = Self(Vec::new());
        for name in names {
            let name = format!("pl{}-{name}", std::process::id());
            if !ip(&["netns", "add", &name]) {
                skip(Need::NetworkNamespaces, "none can be made (root and iproute2 are needed)");
                return None;
            }
            ip(&["-n", &name, "link", "set", "lo", "up"]);
            made.0.push(name);
        }
        Some(made)
    }

    /// A good link between two of them.
    fn join(&self, a: usize, b: usize, address_a: &str, address_b: &str) {
        let (name_a, name_b) = (&self.0[a], &self.0[b]);
        let (end_a, end_b) = (format!("e{a}{b}"), format!("e{b}{a}"));
        assert!(ip(&[
            "link", "add", &end_a, "netns", name_a, "type", "veth", "peer", "name", &end_b, "netns", name_b
        ]));
        for (name, end, address) in [(name_a, &end_a, address_a), (name_b, &end_b, address_b)] {
            assert!(ip(&["-n", name, "addr", "add", address, "dev", end]));
            assert!(ip(&["-n", name, "link", "set", end, "up"]));
        }
    }

    /// A command that runs inside one of them.
    fn command(&self, index: usize, inner: &Command) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.0[index]]);
        command.arg(inner.get_program()).args(inner.get_args());
        command
    }
}

impl Drop for Namespaces {
    fn drop(&mut self) {
        for name in &self.0 {
            ip(&["netns", "del", name]);
        }
    }
}

fn ip(arguments: &[&str]) -> bool {
    Command::new("ip").args(arguments).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
}

/// The emulator of a bad link between two namespaces.
struct BadLink {
    child: Child,
    orders: ChildStdin,
    _words: BufReader<ChildStdout>,
}

impl BadLink {
    /// 10 % loss, 100 ms delay with 20 ms of jitter, 200 kbit/s, always the same.
    fn start(spaces: &Namespaces) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/python/bad_link.py");
        let mut child = Command::new("python3")
            .arg(script)
            .args(["1", "0.1", "100", "20", "200", &spaces.0[0], "10.77.0.1", &spaces.0[1], "10.77.0.2"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let mut words = BufReader::new(child.stdout.take().unwrap());
        words.read_line(&mut line).unwrap();
        assert_eq!(line.trim(), "ready");
        let orders = child.stdin.take().unwrap();
        Self { child, orders, _words: words }
    }

    fn order(&mut self, order: &str) {
        writeln!(self.orders, "{order}").unwrap();
    }
}

impl Drop for BadLink {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Flies over the bad link, cuts it for a while, and returns the reports of the vehicle and the stations.
fn partitioned(before_s: u32, down_s: u32, after_s: u32) -> Option<(Value, [Value; 2])> {
    let spaces = Namespaces::new(&["vehicle", "router", "ground1", "ground2"])?;
    spaces.join(1, 2, "10.77.1.1/24", "10.77.1.2/24");
    spaces.join(1, 3, "10.77.2.1/24", "10.77.2.2/24");
    let seconds = before_s + down_s + after_s;
    render(seconds);
    let folder = tempfile::tempdir().unwrap();
    let mut link = BadLink::start(&spaces);
    let mut inner = Command::new(PLUMBLINE);
    inner.args(["router", "--listen", "tcp/0.0.0.0:7447"]);
    let router = Running::start(spaces.command(1, &inner));
    let reports = [1, 2].map(|k| folder.path().join(format!("ground{k}.json")));
    let mut stations: Vec<Running> = (0..2)
        .map(|k| {
            let mut inner = Command::new(PLUMBLINE);
            let endpoint = format!("tcp/10.77.{}.1:7447", k + 1);
            inner
                .args(["ground", "--plain", "--no-http", "--connect", &endpoint, "--report"])
                .arg(&reports[k]);
            Running::start(spaces.command(k + 2, &inner))
        })
        .collect();
    let report = folder.path().join("vehicle.json");
    let mut inner = flight("drone", seconds);
    inner
        .args(["--connect", "tcp/10.77.0.2:7447"])
        .args(["--set", "network.link=\"radio\"", "--report"])
        .arg(&report);
    let mut vehicle = Running::start(spaces.command(0, &inner));
    std::thread::sleep(Duration::from_secs(u64::from(before_s)));
    let settled_mb = [&router, &stations[0]].map(|process| resident_mb(process.worker()));
    link.order("down");
    std::thread::sleep(Duration::from_secs(u64::from(down_s)));
    link.order("up");
    // The vehicle stays until its flight is over; just before, everything missed must have come.
    std::thread::sleep(Duration::from_secs(u64::from(after_s) - 3));
    stations.iter_mut().for_each(Running::interrupt);
    let grown_mb = [resident_mb(router.worker()) - settled_mb[0], 0.0];
    assert!(grown_mb[0] < 8.0, "the router grew by {grown_mb:?} MB");
    assert!(vehicle.child.wait().unwrap().success(), "{}", vehicle.words());
    let reports = reports.map(|path| json(&path));
    println!("vehicle {:#}\nstations {:#}\n{:#}", json(&report)["live"], reports[0], reports[1]);
    Some((json(&report), reports))
}

fn check(stations: &[Value; 2], down_s: u32) {
    for station in stations {
        let vehicle = &station["vehicles"]["drone"];
        let resumed_s = vehicle["odom"]["longest_gap_s"].as_f64().unwrap() - f64::from(down_s);
        println!("odometry resumed {resumed_s:.2} s after the link");
        // TCP repeats what was lost ever more seldom, and a connection takes six passages of the bad link.
        assert!(resumed_s < 5.0, "odometry resumed {resumed_s:.2} s after the link: {vehicle}");
        assert_eq!(vehicle["keyframes"]["have"], vehicle["keyframes"]["announced"], "{vehicle}");
        assert!(vehicle["keyframes"]["have"].as_u64().unwrap() > 3, "{vehicle}");
        assert_eq!(station["malformed"], 0);
    }
}

#[test]
#[ignore = "a minute: `make soak`"]
fn soak_network_link_that_is_bad_and_then_gone_for_a_while() {
    let Some((_, stations)) = partitioned(8, 8, 24) else { return };
    check(&stations, 8);
}

/// Pairs of flights, with and without a network: single ones scatter by more than the network could do.
fn pairs() -> usize {
    if soak_minutes() < SOAK_IN_FULL_MIN { 2 } else { 3 }
}

#[test]
#[ignore = "ten minutes: `make soak`"]
fn soak_network_partition_of_twenty_seconds_leaves_the_estimator_alone() {
    let (mut with, mut without) = (Vec::new(), Vec::new());
    for _ in 0..pairs() {
        let Some((vehicle, stations)) = partitioned(20, 20, 40) else { return };
        check(&stations, 20);
        let alone = flown_alone(80);
        // A stall of the host can cost either flight a frame.
        if is_whole(&vehicle) && is_whole(&alone) {
            assert_eq!(vehicle["estimate_digest"], alone["estimate_digest"]);
        }
        for (figures, report) in [(&mut with, &vehicle), (&mut without, &alone)] {
            println!("odometry {}", report["live"]["sample_to_odometry_ms"]);
            figures.push(report["frame_ms"]["p99"].as_f64().unwrap());
        }
    }
    println!("frame p99 {with:.2?} ms over the bad link, {without:.2?} ms without a network");
    [&mut with, &mut without].into_iter().for_each(|figures| figures.sort_by(f64::total_cmp));
    assert!(with[with.len() / 2] < 1.1 * without[without.len() / 2], "{with:?} against {without:?} ms");
}

/// Nothing was shed.
fn is_whole(report: &Value) -> bool {
    ["frames_shed", "frames_passed_over", "frames_short_of_samples", "steps_down"]
        .iter()
        .all(|name| report["live"][*name] == 0)
}

/// The report of the same flight without a network.
fn flown_alone(seconds: u32) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("alone.json");
    let mut alone = Command::new(PLUMBLINE);
    alone.args(flight("drone", seconds).get_args().filter(|argument| *argument != "--publish"));
    alone.arg("--report").arg(&report);
    assert!(alone.stdout(Stdio::null()).status().unwrap().success());
    json(&report)
}
