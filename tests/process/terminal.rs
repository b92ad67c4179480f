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

/// A pseudo-terminal of 24 rows and 80 columns: its controlling end, and three handles of the other.
fn terminal() -> (File, [Stdio; 3]) {
    let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&controller).unwrap();
    unlockpt(&controller).unwrap();
    let path = ptsname(&controller, Vec::new()).unwrap().into_string().unwrap();
    let size = Command::new("stty").args(["-F", &path, "rows", "24", "columns", "80"]).status().unwrap();
    assert!(size.success());
    let no_control = OFlags::NOCTTY.bits() as i32;
    let end =
        || Stdio::from(File::options().read(true).write(true).custom_flags(no_control).open(&path).unwrap());
    (File::from(controller), [end(), end(), end()])
}

/// Contents of a terminal after these bytes: text, places of the cursor, and what is erased (ECMA-48). Lines move up where they
/// are written below the last row.
fn screen(bytes: &str) -> Vec<String> {
    let mut rows = vec![vec![' '; 80]; 24];
    let (mut row, mut column, mut chars) = (0, 0, bytes.chars());
    while let Some(c) = chars.next() {
        match c {
            '\u{1b}' => {
                if chars.next() != Some('[') {
                    continue;
                }
                let mut parameters = String::new();
                let end = chars.by_ref().find(|c| {
                    let is_end = ('@'..='~').contains(c);
                    if !is_end {
                        parameters.push(*c);
                    }
                    is_end
                });
                let numbers: Vec<usize> = parameters.split(';').map(|n| n.parse().unwrap_or(1)).collect();
                match end {
                    Some('H') => {
                        row = numbers[0].max(1) - 1;
                        column = numbers.get(1).map_or(0, |n| n.max(&1) - 1);
                    }
                    Some('K') => rows[row.min(23)][column.min(80)..].fill(' '),
                    Some('J') => rows = vec![vec![' '; 80]; 24],
                    // The alternate screen.
                    Some('h') if parameters.starts_with("?1049") => rows = vec![vec![' '; 80]; 24],
                    _ => {}
                }
            }
            '\r' => column = 0,
            '\n' if row == 23 => {
                rows.remove(0);
                rows.push(vec![' '; 80]);
            }
            '\n' => row += 1,
            c if !c.is_control() => {
                rows[row.min(23)][column.min(79)] = c;
                column += 1;
            }
            _ => {}
        }
    }
    rows.into_iter().map(|row| row.into_iter().collect::<String>().trim_end().to_owned()).collect()
}

/// The station shows why it hears nobody; lines of the log wait until its view gives the terminal back.
#[test]
fn lines_of_the_log_do_not_tear_the_view() {
    let (mut controller, ends) = terminal();
    let mut station = Station::start(&[], ends);
    let mut shown = String::new();
    let mut read = |shown: &mut String| {
        let mut bytes = [0; 4_096];
        let count = controller.read(&mut bytes).unwrap();
        shown.push_str(&String::from_utf8_lossy(&bytes[..count]));
    };
    eventually("the cause is shown", PATIENCE, || {
        read(&mut shown);
        screen(&shown).join("\n").contains("no listener at that port")
    });
    let rows = screen(&shown);
    println!("{}", rows.join("\n"));
    assert!(rows[0].contains("no vehicle received yet"), "{rows:#?}");
    assert!(!rows.iter().any(|row| row.contains("WARN")) && rows[23].contains("Ctrl-C: quit"), "{rows:#?}");
    // Afterwards the lines are in the terminal.
    Command::new("kill").args(["-INT", &station.0.id().to_string()]).status().unwrap();
    let restored = "\u{1b}[?1049l";
    eventually("the lines are written", PATIENCE, || {
        read(&mut shown);
        shown.rsplit(restored).next().is_some_and(|after| after.contains("no listener at that port"))
            && shown.contains(restored)
    });
    station.ends(0);
}

#[test]
fn the_view_ends_with_its_terminal() {
    let (mut controller, ends) = terminal();
    let mut station = Station::start(&[], ends);
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
