//! The local socket and the network process: real flights, with readers of every kind.

use super::supervised::runtime;
use super::vehicle::{PLUMBLINE, Running, eventually, flight, free_port, render};
use plumbline_client::Local;
use plumbline_config::Config;
use plumbline_estimator::ResetKind;
use plumbline_flight::local::LocalSocket;
use plumbline_flight::local::record::Kinds;
use plumbline_flight::local::request::{Request, RequestStatus};
use plumbline_flight::pipeline::Stamps;
use plumbline_flight::pipeline::listener::{Producer, Subscriber as _};
use plumbline_link::net::{Endpoints, now_ns};
use plumbline_record::Said;
use plumbline_record::local::content::LocalRecord;
use plumbline_test_support::{Need, skip};
use serde_json::Value;
use std::collections::BTreeMap;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Length of the flights that are compared, s.
pub const FLIGHT_S: u32 = 16;
/// Length of the flights that are only read, s.
pub const READ_S: u32 = 8;
/// Longest wait.
const PATIENCE: Duration = Duration::from_secs(15);
/// A user with no rights.
const SOMEBODY: u32 = 65_534;

/// A flight of a test with its folder, in which everybody may look.
pub struct Flight {
    folder: tempfile::TempDir,
    duration_s: u32,
}

impl Flight {
    pub fn new(duration_s: u32) -> Self {
        render(duration_s);
        let folder = tempfile::tempdir().unwrap();
        std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
        Self { folder, duration_s }
    }

    pub fn socket(&self) -> PathBuf {
        self.folder.path().join("local")
    }

    fn report(&self) -> PathBuf {
        self.folder.path().join("report.json")
    }

    /// The command, with a report and a socket that everybody may read.
    pub fn command(&self) -> Command {
        let mut command = flight("drone", self.duration_s);
        command.arg("--report").arg(self.report());
        command.args(["--set", &format!("local.path=\"{}\"", self.socket().display())]);
        command.args(["--set", "local.mode=\"0666\""]);
        command
    }

    /// Waits for the end of a flight, and reads its report.
    pub fn finish(&self, mut flying: Running) -> Value {
        let status = flying.child.wait().unwrap();
        assert!(status.success(), "{}", flying.words());
        crate::json(self.report())
    }
}

/// Connects as soon as the socket is there.
pub fn connected(socket: &Path) -> UnixStream {
    let end = Instant::now() + PATIENCE;
    loop {
        match UnixStream::connect(socket) {
            Ok(stream) => return stream,
            Err(error) => assert!(Instant::now() < end, "{}: {error}", socket.display()),
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Digests of the flight of so many seconds, without readers and without a network.
pub fn flown_alone(duration_s: u32) -> (Value, Value) {
    render(duration_s);
    let (duration, cache) = (duration_s.to_string(), super::vehicle::cache());
    let mut command = Command::new(PLUMBLINE);
    command.args(["replay", "sim:room", "--start", "2", "--scale", "0.5", "--no-lines", "--json"]);
    let output = crate::done(command.args(["--duration", &duration]).arg("--cache").arg(cache));
    digests(&serde_json::from_slice(&output.stdout).unwrap())
}

/// [`flown_alone`] for [`FLIGHT_S`].
fn undisturbed() -> (Value, Value) {
    static DIGESTS: OnceLock<(Value, Value)> = OnceLock::new();
    DIGESTS.get_or_init(|| flown_alone(FLIGHT_S)).clone()
}

pub fn digests(report: &Value) -> (Value, Value) {
    (report["estimate_digest"].clone(), report["odometry_digest"].clone())
}

/// True if a busy host has refused a frame, or let an estimate come late: then there is nothing to compare.
pub fn was_disturbed(report: &Value) -> bool {
    let counts = ["frames_shed", "frames_short_of_samples", "steps_down", "late_corrections"];
    counts.iter().any(|key| report["live"][key].as_f64() != Some(0.0))
}

/// Flies until a flight went undisturbed, three times at most; its estimates and odometry are those of virtual time.
pub fn costs_the_flight_nothing(fly: impl Fn() -> Value) {
    for _ in 0..3 {
        let report = fly();
        println!("sample to odometry, ms: {}", report["live"]["sample_to_odometry_ms"]);
        println!("ticks late by, ms: {}", report["live"]["tick_late_ms"]);
        assert_eq!(report["hot_path_allocations"], 0);
        if !was_disturbed(&report) {
            return assert_eq!(digests(&report), undisturbed());
        }
    }
    panic!("no flight went undisturbed");
}

/// Processes that the threads of a process have started.
pub fn children(process: u32) -> Vec<u32> {
    let threads = std::fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten();
    let lists = threads.filter_map(|thread| std::fs::read_to_string(thread.path().join("children")).ok());
    lists.flat_map(|list| list.split_whitespace().map(|id| id.parse().unwrap()).collect::<Vec<_>>()).collect()
}

fn kill(process: u32) {
    let killed = Command::new("kill").args(["-KILL", &process.to_string()]).status().unwrap();
    assert!(killed.success());
}

/// A station of this process that notes when it last heard odometry, ns since 1970.
async fn listen(endpoint: &str, heard_ns: Arc<AtomicI64>) -> zenoh::Session {
    let endpoints =
        Endpoints { connect: vec![endpoint.to_owned()], hears: vec!["drone".into()], ..Endpoints::default() };
    let session = endpoints.open().await.unwrap();
    let note = move |_| heard_ns.store(now_ns(), Ordering::Relaxed);
    session.declare_subscriber("plumbline/drone/odom").callback(note).background().await.unwrap();
    session
}

/// Kills the network process every other second, so often. The times until a station heard the vehicle again, s.
fn kill_again_and_again(vehicle: &Running, endpoint: &str, times: usize) -> Vec<f64> {
    let runtime = runtime();
    let heard_ns = Arc::new(AtomicI64::new(0));
    let heard_since = |time_ns: i64| heard_ns.load(Ordering::Relaxed) > time_ns;
    let session = runtime.block_on(listen(endpoint, Arc::clone(&heard_ns)));
    eventually("the station hears the vehicle", PATIENCE, || heard_since(0));
    let mut silences_s = Vec::new();
    for _ in 0..times {
        let link = children(vehicle.child.id());
        assert_eq!(link.len(), 1, "{}", vehicle.words());
        kill(link[0]);
        // What it had sent before may still come.
        std::thread::sleep(Duration::from_millis(20));
        let killed_ns = now_ns();
        eventually("the station hears the vehicle again", PATIENCE, || heard_since(killed_ns));
        silences_s.push((heard_ns.load(Ordering::Relaxed) - killed_ns) as f64 * 1e-9);
        std::thread::sleep(Duration::from_millis(700));
    }
    let _ = runtime.block_on(async { session.close().await });
    silences_s
}

/// Speaks to the socket of a flight as a user with no rights: see [`commands_of_users_without_rights_are_refused`].
#[test]
#[ignore = "a process of another test"]
fn a_reader_of_another_user() {
    let Ok(socket) = std::env::var("PLUMBLINE_TEST_SOCKET") else { return };
    let mut client = Local::over(connected(Path::new(&socket)));
    assert_eq!(client.next_record().unwrap(), LocalRecord::Hello(false));
    let mut requests = client.requests().unwrap();
    for request in [Request::Reset(ResetKind::Hard), Request::SaveMap, Request::Watch(5_000), Request::Ready]
    {
        requests.send(&request).unwrap();
    }
    let (mut refused, mut odometry) = (0, 0);
    while refused < 4 || odometry < 100 {
        match client.next_record().unwrap() {
            LocalRecord::Answer(answer) => {
                assert_eq!(answer.status, RequestStatus::Refused);
                refused += 1;
            }
            LocalRecord::Odometry(..) => odometry += 1,
            _ => {}
        }
    }
}

#[test]
fn commands_of_users_without_rights_are_refused() {
    if !rustix::process::geteuid().is_root() {
        return skip(Need::OtherUser, "another user can be had by root alone");
    }
    let flight = Flight::new(READ_S);
    let mut vehicle = Running::start(flight.command());
    drop(connected(&flight.socket()));
    crate::done(
        Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "local::a_reader_of_another_user", "--ignored"])
            .env("PLUMBLINE_TEST_SOCKET", flight.socket())
            .uid(SOMEBODY)
            .gid(SOMEBODY),
    );
    vehicle.interrupt();
    assert_eq!(flight.finish(vehicle)["resets"], 0);
}

#[test]
fn a_flight_whose_socket_cannot_be_made_is_wrong_usage() {
    let folder = tempfile::tempdir().unwrap();
    let notes = folder.path().join("notes");
    std::fs::write(&notes, "").unwrap();
    let missing = folder.path().join("missing/local");
    for (path, words) in [(&notes, "is not a socket"), (&missing, "local.path")] {
        let set = format!("local.path=\"{}\"", path.display());
        super::fails(
            &["replay", "sim:room", "--duration", "1", "--set", &set],
            2,
            &[words, path.to_str().unwrap()],
        );
    }
}

/// Lines that programs print which read the socket beside one flight.
fn printed_by(programs: Vec<Command>, flight: &Flight) -> Vec<Vec<String>> {
    let vehicle = Running::start(flight.command());
    drop(connected(&flight.socket()));
    let start = |mut program: Command| {
        program.arg(flight.socket()).stdout(Stdio::piped()).stderr(Stdio::inherit()).spawn().unwrap()
    };
    let started: Vec<Child> = programs.into_iter().map(start).collect();
    let outputs: Vec<_> = std::thread::scope(|scope| {
        let readers: Vec<_> =
            started.into_iter().map(|child| scope.spawn(|| child.wait_with_output().unwrap())).collect();
        readers.into_iter().map(|reader| reader.join().unwrap()).collect()
    });
    flight.finish(vehicle);
    let lines = |output: Output| {
        assert!(output.status.success());
        String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
    };
    outputs.into_iter().map(lines).collect()
}

/// Every line has a stamp, a position and a state; nothing was lost, and the vehicle was tracked.
fn assert_odometry(lines: &[String]) {
    let tracking = lines.iter().filter(|line| line.contains("tracking  quality")).count();
    println!("{} lines, {tracking} of them tracking; {:?}", lines.len(), lines.last());
    assert!(lines.iter().all(|line| !line.starts_with("lost")));
    assert!(tracking > 100 * READ_S as usize, "{lines:?}");
    let stamp = |line: &String| line.split(' ').next().unwrap().parse::<f64>().unwrap();
    assert!(lines.is_sorted_by_key(stamp));
}

#[test]
fn the_examples_in_python_and_c_print_odometry() {
    let project = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let flight = Flight::new(READ_S);
    let mut programs = Vec::new();
    if let Some(python) = super::python::interpreter("socket, struct") {
        let mut program = Command::new(python);
        program.arg(project.join("examples/read_local.py"));
        programs.push(program);
    }
    let program = flight.folder.path().join("read_local");
    let mut compiler = Command::new("cc");
    compiler.args(["-O2", "-Wall", "-Werror", "-o"]).arg(&program).arg(project.join("examples/read_local.c"));
    match compiler.status() {
        Ok(status) => assert!(status.success()),
        Err(error) => return skip(Need::Compiler, format_args!("cc: {error}")),
    }
    programs.push(Command::new(program));
    for lines in printed_by(programs, &flight) {
        assert_odometry(&lines);
    }
}

#[test]
fn a_network_process_started_by_hand_serves_one_flight_after_the_other() {
    let flight = Flight::new(READ_S);
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let mut link = Command::new(PLUMBLINE);
    link.args(["link", "--listen", &endpoint, "--socket"]).arg(flight.socket());
    let mut link = Running::start(link);
    eventually("it says what it waits for", PATIENCE, || link.words().contains("no flight yet"));
    let runtime = runtime();
    for _ in 0..2 {
        let mut vehicle = Command::new(PLUMBLINE);
        let with_network = flight.command();
        // A flight without a network of its own.
        vehicle.args(with_network.get_args().filter(|argument| *argument != "--publish"));
        let mut vehicle = Running::start(vehicle);
        let heard_ns = Arc::new(AtomicI64::new(0));
        drop(connected(&flight.socket()));
        let session = runtime.block_on(listen(&endpoint, Arc::clone(&heard_ns)));
        eventually("the flight is heard", PATIENCE, || heard_ns.load(Ordering::Relaxed) > 0);
        let _ = runtime.block_on(async { session.close().await });
        vehicle.kill();
    }
    link.interrupt();
}

/// Tests that measure rates and times: see `.config/nextest.toml`.
mod realtime {
    use super::*;

    #[test]
    fn a_network_process_that_is_killed_is_back_within_two_seconds_and_the_flight_is_the_same() {
        costs_the_flight_nothing(|| {
            let flight = Flight::new(FLIGHT_S);
            let endpoint = format!("tcp/127.0.0.1:{}", free_port());
            let mut command = flight.command();
            command.args(["--listen", &endpoint]);
            let vehicle = Running::start(command);
            drop(connected(&flight.socket()));
            let silences_s = kill_again_and_again(&vehicle, &endpoint, 6);
            println!("heard again after {silences_s:.2?} s");
            assert!(silences_s.iter().all(|silence| *silence < 2.0), "{silences_s:?}");
            let words = vehicle.words();
            assert!(words.contains("the network process ended (signal: 9 (SIGKILL))"), "{words}");
            flight.finish(vehicle)
        });
    }

    #[test]
    fn sixty_four_readers_that_never_read_delay_neither_the_flight_nor_a_reader_that_does() {
        costs_the_flight_nothing(|| {
            let flight = Flight::new(FLIGHT_S);
            let vehicle = Running::start(flight.command());
            let quick = std::thread::spawn({
                let socket = flight.socket();
                move || read_to_the_end(Local::over(connected(&socket)), Instant::now())
            });
            let mut stalled: Vec<Local> = (0..64).map(|_| Local::over(connected(&flight.socket()))).collect();
            for reader in &stalled {
                reader.requests().unwrap().send(&Request::Subscribe(Kinds::SUBSCRIBABLE)).unwrap();
            }
            // One of them wakes up shortly before the end.
            let late = stalled.pop().unwrap();
            let waking = Instant::now() + Duration::from_secs(u64::from(FLIGHT_S) - 2);
            let late = std::thread::spawn(move || read_to_the_end(late, waking));
            let report = flight.finish(vehicle);
            let (quick, late) = (quick.join().unwrap(), late.join().unwrap());
            println!("to a reader that reads: {quick:?}");
            println!("to one that slept: {late:?}");
            assert_eq!((quick.lost, quick.gaps), (0, 0));
            assert!(quick.received > 100 * u64::from(FLIGHT_S));
            assert!(late.lost > 0 && late.has_ended);
            drop(stalled);
            report
        });
    }

    /// Counts of a reader.
    #[derive(Debug, Default)]
    struct Got {
        received: u64,
        lost: u64,
        gaps: u64,
        has_ended: bool,
        /// From the hand-over on the flight's thread to the reader, us.
        p50_us: f64,
        p99_us: f64,
    }

    fn read_to_the_end(mut client: Local, from: Instant) -> Got {
        std::thread::sleep(from.saturating_duration_since(Instant::now()));
        let (mut got, mut delays, mut last) = (Got::default(), BTreeMap::new(), None);
        while let Ok(record) = client.next_record() {
            match record {
                LocalRecord::Odometry(odometry, handed_over_ns) => {
                    got.received += 1;
                    got.gaps += u64::from(last.is_some_and(|last| odometry.sequence != last + 1));
                    last = Some(odometry.sequence);
                    *delays.entry(now_ns() - handed_over_ns).or_insert(0u64) += 1;
                }
                LocalRecord::Lost(count) => got.lost = count,
                LocalRecord::End => got.has_ended = true,
                _ => {}
            }
        }
        let quantile = |fraction: f64| {
            let (mut seen, wanted) = (0, (got.received as f64 * fraction) as u64);
            let at = delays.iter().find(|(_, count)| {
                seen += **count;
                seen > wanted
            });
            at.map_or(f64::NAN, |(delay, _)| *delay as f64 * 1e-3)
        };
        (got.p50_us, got.p99_us) = (quantile(0.5), quantile(0.99));
        got
    }

    /// From the thread that hands odometry over to a reader, on a host that has nothing else to do.
    #[test]
    #[ignore = "needs a quiet host: make soak"]
    fn soak_local_socket_latency_is_below_a_tenth_of_a_millisecond() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("local");
        let change = |config: &mut Config| config.local.path = path.display().to_string();
        let config = Config::preset("sim").unwrap().with("test", change).unwrap();
        let mut socket = LocalSocket::start(&config, Stamps::OfHost, Arc::default()).unwrap();
        let reading = Local::over(connected(&path));
        let reading = std::thread::spawn(move || read_to_the_end(reading, Instant::now()));
        let mut tick = socket.listener(Producer::Tick);
        crate::network::send_at_200_hz(
            |odometry| tick.said(&Said::Odometry(odometry)),
            20,
            Duration::from_millis(100),
        );
        drop(socket);
        let got = reading.join().unwrap();
        println!("{got:?}");
        assert!(got.p50_us <= 100.0 && got.p99_us <= 300.0, "{got:?}");
    }
}

/// The network process does not outlive its flight, however that ends.
#[test]
fn a_flight_that_is_killed_takes_its_network_process_with_it() {
    let flight = Flight::new(READ_S);
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let mut command = flight.command();
    command.args(["--listen", &endpoint]);
    let mut vehicle = Running::start(command);
    drop(connected(&flight.socket()));
    let mut link = Vec::new();
    eventually("there is a network process", PATIENCE, || {
        link = children(vehicle.child.id());
        !link.is_empty()
    });
    // It bounds itself as soon as it runs.
    eventually("its memory is bounded", PATIENCE, || {
        let limits = std::fs::read_to_string(format!("/proc/{}/limits", link[0])).unwrap();
        limits.lines().any(|line| line.starts_with("Max data size") && !line.contains("unlimited"))
    });
    vehicle.kill();
    let process = PathBuf::from(format!("/proc/{}", link[0]));
    eventually("its network process is gone", PATIENCE, || !process.exists());
}
