//! A ground station: watches vehicles from afar, in the browser and in the terminal.
//!
//! [`listen`] fills the [`fleet`] from the network, [`recover`] queries what was missed; [`web`] and [`view`] show
//! it. Memory is bounded: vehicles, paths, maps, events.

pub mod attitude;
mod cameras;
pub mod channel;
pub mod clock;
pub mod command;
pub mod connection;
pub mod corrected;
pub mod drawn;
mod fields;
pub mod fleet;
pub mod foxglove;
#[cfg(any(test, feature = "fuzzing"))]
#[doc(hidden)]
pub mod fuzzing;
pub mod history;
mod listen;
pub mod map;
pub mod news;
mod recover;
pub mod report;
mod terminal;
#[cfg(test)]
mod test_messages;
pub mod track;
pub mod vehicle;
pub mod view;
pub mod web;

use fleet::Fleet;
use parking_lot::Mutex;
use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The view is drawn and input is looked at this often.
const REDRAW: Duration = Duration::from_millis(100);
/// Shown while no vehicle has been received.
const NO_VEHICLE: &str = "no vehicle received yet";

/// Set once the reader of stdout has closed it.
static READER_HAS_LEFT: AtomicBool = AtomicBool::new(false);

/// Waits until the station is to end, or nobody reads what it prints.
pub fn wait(is_over: &impl Fn() -> bool) {
    while !is_over() && !READER_HAS_LEFT.load(Ordering::Relaxed) {
        std::thread::sleep(REDRAW);
    }
}

/// Prints a line a second for each vehicle, or what is tried while there is none, as long as somebody reads them.
///
/// # Errors
/// When the output cannot be written.
pub fn print_lines(fleet: &Mutex<Fleet>, is_over: &impl Fn() -> bool) -> io::Result<()> {
    let mut next = Instant::now() + Duration::from_secs(1);
    while !is_over() {
        std::thread::sleep(REDRAW);
        if Instant::now() < next {
            continue;
        }
        next += Duration::from_secs(1);
        let (lines, network) = {
            let fleet = fleet.lock();
            (fleet.lines(Instant::now()), fleet.network.clone())
        };
        match print(&lines, &network) {
            Err(error) if terminal::is_gone(&error) => return Ok(()),
            outcome => outcome?,
        }
    }
    Ok(())
}

fn print(lines: &[String], network: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    match (lines.is_empty(), network.is_empty()) {
        (true, true) => writeln!(out, "{NO_VEHICLE}")?,
        (true, false) => writeln!(out, "{NO_VEHICLE}: {network}")?,
        _ => {}
    }
    for line in lines {
        writeln!(out, "{line}")?;
    }
    out.flush()
}
