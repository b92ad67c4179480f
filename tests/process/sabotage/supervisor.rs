//! Starts a command, and starts it again, by the rules of our systemd unit: readiness, watchdog, restarts and their limit, as
//! systemd.service(5) has them. Containers have no systemd running; where one can be booted `realtime/systemd.rs` does.

use std::collections::BTreeMap;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Child, Command};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Start limit of a unit without StartLimitIntervalSec and StartLimitBurst: s, starts.
const START_LIMIT: (f64, usize) = (10.0, 5);

/// Settings of the unit file.
#[derive(Clone, Debug)]
pub struct Unit {
    settings: BTreeMap<String, String>,
}

impl Unit {
    /// Ours.
    pub fn ours() -> Self {
        let file = plumbline_test_support::workspace().join("runtime/systemd/plumbline.service");
        Self::read(&std::fs::read_to_string(file).unwrap())
    }

    fn read(text: &str) -> Self {
        let setting =
            |line: &str| line.split_once('=').map(|(key, value)| (key.to_owned(), value.to_owned()));
        Self { settings: text.lines().filter(|line| !line.starts_with('#')).filter_map(setting).collect() }
    }

    pub fn get(&self, key: &str) -> &str {
        self.settings.get(key).map_or("", String::as_str)
    }

    /// A time; without a unit it is in seconds.
    pub fn time(&self, key: &str) -> Option<Duration> {
        let text = self.settings.get(key)?;
        let seconds = match text.strip_suffix("ms") {
            Some(ms) => ms.parse::<f64>().ok()? * 1e-3,
            None => text.strip_suffix('s').unwrap_or(text).parse().ok()?,
        };
        Some(Duration::from_secs_f64(seconds))
    }

    /// True if a process is restarted after its end, successful or not.
    fn restarts_after(&self, is_success: bool) -> bool {
        match self.get("Restart") {
            "always" => true,
            "on-failure" => !is_success,
            _ => false,
        }
    }

    /// True if these starts exceed the limit.
    fn gives_up(&self, starts: &[Instant]) -> bool {
        let interval = self.time("StartLimitIntervalSec").unwrap_or(Duration::from_secs_f64(START_LIMIT.0));
        let burst = self.get("StartLimitBurst").parse().unwrap_or(START_LIMIT.1);
        !interval.is_zero() && starts.iter().filter(|start| start.elapsed() < interval).count() >= burst
    }
}

/// Observations of the command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Seen {
    Started,
    Ready,
    Alive,
    Stopping,
    /// It gave no sign of life for too long, and was killed.
    Silent,
    /// With a status of its own, if not by a signal.
    Ended(Option<i32>),
    GivenUp,
}

/// The supervisor and its command, ended with the test.
pub struct Supervisor {
    seen: Arc<Mutex<Vec<(Instant, Seen)>>>,
    pid: Arc<AtomicU32>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Supervisor {
    /// Runs what `command` makes, which is told how often it was started; `folder` holds the socket and the state.
    pub fn start(
        unit: Unit,
        folder: &Path,
        mut command: impl FnMut(usize) -> Command + Send + 'static,
    ) -> Self {
        let path = folder.join("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
        let watchdog = unit.time("WatchdogSec").unwrap();
        let (seen, stop) = (Arc::default(), Arc::new(AtomicBool::new(false)));
        let pid = Arc::new(AtomicU32::new(0));
        let run = Run { unit, socket, seen: Arc::clone(&seen), stop: Arc::clone(&stop) };
        let (theirs, state) = (Arc::clone(&pid), folder.to_owned());
        let thread = std::thread::spawn(move || {
            let mut starts = Vec::new();
            while !run.stop.load(Ordering::SeqCst) {
                let mut command = command(starts.len());
                command.env("NOTIFY_SOCKET", &path).env("STATE_DIRECTORY", &state);
                command.env("WATCHDOG_USEC", watchdog.as_micros().to_string()).env_remove("WATCHDOG_PID");
                starts.push(Instant::now());
                run.note(Seen::Started);
                let child = command.spawn().unwrap();
                theirs.store(child.id(), Ordering::SeqCst);
                let is_success = run.watch(child, watchdog);
                if !run.unit.restarts_after(is_success) {
                    return;
                }
                if run.unit.gives_up(&starts) {
                    return run.note(Seen::GivenUp);
                }
                std::thread::sleep(run.unit.time("RestartSec").unwrap_or(Duration::from_millis(100)));
            }
        });
        Self { seen, pid, stop, thread: Some(thread) }
    }

    /// Ends the process as a power failure of it would.
    pub fn kill_dash_nine(&self) {
        signal("-KILL", self.pid.load(Ordering::SeqCst));
    }

    pub fn seen(&self) -> Vec<(Instant, Seen)> {
        self.seen.lock().unwrap().clone()
    }

    /// Without the signs of life.
    pub fn story(&self) -> Vec<Seen> {
        self.seen().into_iter().map(|(_, seen)| seen).filter(|seen| *seen != Seen::Alive).collect()
    }

    /// `systemctl stop`.
    pub fn stop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Run {
    unit: Unit,
    socket: UnixDatagram,
    seen: Arc<Mutex<Vec<(Instant, Seen)>>>,
    stop: Arc<AtomicBool>,
}

impl Run {
    fn note(&self, seen: Seen) {
        self.seen.lock().unwrap().push((Instant::now(), seen));
    }

    /// Looks after one process until its end; whether that was a success.
    fn watch(&self, mut child: Child, patience: Duration) -> bool {
        let (mut is_ready, mut sign, mut stopped_at) = (false, Instant::now(), None);
        loop {
            let mut bytes = [0; 256];
            if let Ok(count) = self.socket.recv(&mut bytes) {
                sign = Instant::now();
                for line in std::str::from_utf8(&bytes[..count]).unwrap().lines() {
                    match line {
                        "READY=1" => {
                            is_ready = true;
                            self.note(Seen::Ready);
                        }
                        "WATCHDOG=1" => self.note(Seen::Alive),
                        "STOPPING=1" => {
                            is_ready = false;
                            self.note(Seen::Stopping);
                        }
                        other => panic!("{other}"),
                    }
                }
            }
            if is_ready && sign.elapsed() > patience {
                self.note(Seen::Silent);
                is_ready = false;
                let _ = child.kill();
            }
            if let Some(status) = child.try_wait().unwrap() {
                self.note(Seen::Ended(status.code()));
                return status.success();
            }
            if self.stop.load(Ordering::SeqCst) {
                let since = *stopped_at.get_or_insert_with(|| {
                    signal("-TERM", child.id());
                    Instant::now()
                });
                if since.elapsed() > self.unit.time("TimeoutStopSec").unwrap() {
                    let _ = child.kill();
                }
            }
        }
    }
}

fn signal(signal: &str, pid: u32) {
    assert!(Command::new("kill").args([signal, &pid.to_string()]).status().unwrap().success());
}

#[test]
fn the_unit_is_started_again_for_ever() {
    let unit = Unit::ours();
    assert_eq!((unit.get("Type"), unit.get("KillSignal")), ("notify", "SIGTERM"));
    assert!(unit.restarts_after(true) && unit.restarts_after(false));
    assert!(!unit.gives_up(&[Instant::now(); 1000]), "StartLimitIntervalSec = 0");
    assert!(unit.time("RestartSec").unwrap() <= Duration::from_millis(200));
    assert!(unit.get("ExecStart").contains(" fly --config ") && unit.get("ExecStart").contains(" --record "));
    let other = Unit::read("[Service]\nRestart=on-failure\nRestartSec=200ms\n");
    assert!(!other.restarts_after(true) && other.gives_up(&[Instant::now(); 5]));
    assert_eq!(other.time("RestartSec"), Some(Duration::from_millis(200)));
}

#[test]
fn a_command_that_falls_silent_is_killed_and_started_again() {
    let folder = tempfile::tempdir().unwrap();
    let said = "import os, socket, time; s = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM); \
                s.sendto(b'READY=1', os.environ['NOTIFY_SOCKET']); time.sleep(60)";
    let mut supervisor = Supervisor::start(Unit::ours(), folder.path(), move |_| {
        let mut command = Command::new("python3");
        command.args(["-c", said]);
        command
    });
    let end = Instant::now() + Duration::from_secs(20);
    while supervisor.story().iter().filter(|seen| **seen == Seen::Ready).count() < 2 {
        assert!(Instant::now() < end, "{:?}", supervisor.story());
        std::thread::sleep(Duration::from_millis(20));
    }
    supervisor.stop();
    let story = supervisor.story();
    let once = [Seen::Started, Seen::Ready, Seen::Silent, Seen::Ended(None), Seen::Started, Seen::Ready];
    assert_eq!(story[..6], once, "{story:?}");
}
