//! A station ends when the terminal that it is watched from goes away, and when nobody reads what it prints.

use super::vehicle::{PLUMBLINE, eventually, free_port};
use rustix::fs::OFlags;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// An open station that hears nobody ends within this time.
const PATIENCE: Duration = Duration::from_secs(10);

/// Ends with the test, whatever becomes of it.
struct Station(Child);

impl Drop for Station {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Station {
    fn start(arguments: &[&str], ends: [Stdio; 3]) -> Self {
        let nobody = format!("tcp/127.0.0.1:{}", free_port());
        let [stdin, stdout, stderr] = ends;
        let mut command = Command::new(PLUMBLINE);
        command.args(["ground", "--no-http", "--connect", &nobody]).args(arguments);
        Self(command.stdin(stdin).stdout(stdout).stderr(stderr).spawn().unwrap())
    }

    fn ends(&mut self, status: i32) {
        eventually("it ends", PATIENCE, || self.0.try_wait().unwrap().is_some());
        assert_eq!(self.0.wait().unwrap().code(), Some(status));
    }
}

#[test]
fn the_view_ends_with_its_terminal() {
    let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&controller).unwrap();
    unlockpt(&controller).unwrap();
    let path = ptsname(&controller, Vec::new()).unwrap().into_string().unwrap();
    let size = Command::new("stty").args(["-F", &path, "rows", "24", "columns", "80"]).status().unwrap();
    assert!(size.success());
    let no_control = OFlags::NOCTTY.bits() as i32;
    let end =
        || Stdio::from(File::options().read(true).write(true).custom_flags(no_control).open(&path).unwrap());
    let mut station = Station::start(&[], [end(), end(), end()]);
    let mut controller = File::from(controller);
    let mut shown = String::new();
    eventually("the view is drawn", PATIENCE, || {
        let mut bytes = [0; 4_096];
        let count = controller.read(&mut bytes).unwrap();
        shown.push_str(&String::from_utf8_lossy(&bytes[..count]));
        // Blanks are passed over.
        shown.contains("received")
    });
    // The station is no child of the terminal: no signal tells it.
    drop(controller);
    station.ends(0);
}

#[test]
fn lines_end_with_their_reader() {
    let mut station = Station::start(&["--plain"], [Stdio::null(), Stdio::piped(), Stdio::null()]);
    drop(station.0.stdout.take());
    station.ends(0);
}

#[test]
fn a_station_ends_when_its_terminal_hangs_up() {
    let mut station = Station::start(&["--plain"], [Stdio::null(), Stdio::piped(), Stdio::null()]);
    let mut first = [0];
    station.0.stdout.as_mut().unwrap().read_exact(&mut first).unwrap();
    Command::new("kill").args(["-HUP", &station.0.id().to_string()]).status().unwrap();
    station.ends(0);
}
