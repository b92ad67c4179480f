//! Real vehicles for network tests: replays in real time of a simulated flight, rendered once beforehand.

use plumbline_test_support::kept;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// The command under test.
pub const PLUMBLINE: &str = env!("CARGO_BIN_EXE_plumbline");

/// A port of the loopback interface that was free a moment ago.
pub fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Waits until `ready`, or fails with `what` after `patience`.
pub fn eventually(what: &str, patience: Duration, mut ready: impl FnMut() -> bool) {
    let end = Instant::now() + patience;
    while !ready() {
        assert!(Instant::now() < end, "not within {patience:?}: {what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// A running process whose words on stderr are kept. It ends with the test.
pub struct Running {
    pub child: Child,
    words: Arc<Mutex<String>>,
}

impl Running {
    pub fn start(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let words = Arc::new(Mutex::new(String::new()));
        let (theirs, stderr) = (Arc::clone(&words), child.stderr.take().unwrap());
        std::thread::spawn(move || keep(stderr, &theirs));
        Self { child, words }
    }

    /// Output so far.
    pub fn words(&self) -> String {
        self.words.lock().unwrap().clone()
    }

    /// The process that works: of a router or a station the one that their supervisor has started, else itself.
    pub fn worker(&self) -> u32 {
        let itself = self.child.id();
        crate::local::children(itself).first().copied().unwrap_or(itself)
    }

    /// Ends it as a person would, with Ctrl-C, and waits.
    pub fn interrupt(&mut self) {
        let _ = Command::new("kill").args(["-INT", &self.child.id().to_string()]).status();
        let _ = self.child.wait();
    }

    /// Ends it as a power failure would.
    pub fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.kill();
    }
}

fn keep(stderr: ChildStderr, words: &Mutex<String>) {
    let mut lines = BufReader::new(stderr.take(1 << 20));
    let mut line = String::new();
    while lines.read_line(&mut line).is_ok_and(|count| count > 0) {
        words.lock().unwrap().push_str(&std::mem::take(&mut line));
    }
}

/// Vehicles on a station's page, read at its web socket.
pub struct Page {
    socket: TcpStream,
    bytes: Vec<u8>,
    fleet: Value,
}

impl Page {
    /// Opens the socket of the station whose page is at `address`, once it is served.
    pub fn open(address: &str) -> Self {
        let mut socket = None;
        eventually("the page is served", Duration::from_secs(30), || {
            socket = TcpStream::connect(address).ok();
            socket.is_some()
        });
        let mut socket = socket.unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
        write!(
            socket,
            "GET /ws HTTP/1.1\r\nHost: {address}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )
        .unwrap();
        Self { socket, bytes: Vec::new(), fleet: Value::Null }
    }

    /// The newest message on the fleet; `Null` before the first.
    pub fn fleet(&mut self) -> &Value {
        let mut some = [0; 1 << 16];
        while let Ok(count @ 1..) = self.socket.read(&mut some) {
            self.bytes.extend_from_slice(&some[..count]);
            self.keep_newest();
        }
        &self.fleet
    }

    /// Frames of the server are not masked, so that messages are there as they are.
    fn keep_newest(&mut self) {
        const BEGIN: &[u8] = b"{\"malformed\":";
        let find = |bytes: &[u8]| bytes.windows(BEGIN.len()).position(|window| window == BEGIN);
        while let Some(begin) = find(&self.bytes) {
            self.bytes.drain(..begin);
            let mut messages = serde_json::Deserializer::from_slice(&self.bytes).into_iter();
            match messages.next() {
                Some(Ok(fleet)) => self.fleet = fleet,
                Some(Err(error)) if error.is_eof() => return,
                _ => {}
            }
            self.bytes.drain(..BEGIN.len());
        }
        let kept = self.bytes.len().saturating_sub(BEGIN.len());
        self.bytes.drain(..kept);
    }

    /// Waits until `ready` for the newest message on the fleet.
    pub fn wait(&mut self, what: &str, patience: Duration, ready: impl Fn(&Value) -> bool) {
        eventually(what, patience, || ready(self.fleet()));
    }
}

/// Gives a vehicle its certificate of the folder.
pub fn certify(vehicle: &mut Command, folder: &Path) {
    for (key, name) in
        [("authority", "authority.pem"), ("certificate", "vehicle.pem"), ("key", "vehicle.key")]
    {
        vehicle.arg("--set").arg(format!("network.tls.{key}={:?}", folder.join(name)));
    }
}

/// Memory of a process by its name in the status that the kernel tells, MB; 0 for one that is over.
pub fn memory_mb(process: u32, name: &str) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let kb = status
        .lines()
        .find_map(|line| line.strip_prefix(name)?.strip_prefix(':')?.trim().strip_suffix(" kB"));
    kb.map_or(0.0, |kb| kb.parse::<f64>().unwrap() / 1024.0)
}

/// Memory that a process holds, MB.
pub fn resident_mb(process: u32) -> f64 {
    memory_mb(process, "VmRSS")
}

/// Folder of rendered flights, shared by the tests of a build.
pub fn cache() -> PathBuf {
    kept::folder().join("flights")
}

/// Arguments of a flight of so many seconds at real time that publishes.
pub fn flight(name: &str, duration_s: u32) -> Command {
    let mut command = Command::new(PLUMBLINE);
    let duration = duration_s.to_string();
    command.args(["replay", "sim:room", "--start", "2", "--scale", "0.5", "--no-lines", "--speed", "1"]);
    command.args(["--duration", &duration, "--publish", "--set", &format!("network.vehicle=\"{name}\"")]);
    command.arg("--cache").arg(cache());
    command
}

/// Renders the flight of so many seconds, so that a vehicle starts at once.
pub fn render(duration_s: u32) {
    render_as(&["sim:room", "--start=2", "--scale=0.5"], duration_s);
}

/// Renders so many seconds of a flight for all tests that fly it.
pub fn render_as(scene: &[&str], duration_s: u32) {
    kept::done_once(&format!("{scene:?} for {duration_s} s"), || {
        let mut command = Command::new(PLUMBLINE);
        command.arg("replay").args(scene).args(["--no-lines", "--duration", &duration_s.to_string()]);
        crate::done(command.arg("--cache").arg(cache()));
    });
}
