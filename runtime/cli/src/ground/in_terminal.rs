//! The view of a ground station in the terminal.

use super::super::log_lines;
use parking_lot::Mutex;
use plumbline_ground::fleet::Fleet;
use plumbline_ground::view;
use std::collections::VecDeque;
use std::io::Write as _;
use std::sync::Arc;

/// Lines of the log that wait for the end of the view.
const MAX_LINES: usize = 200;

/// Shows the view in the terminal. What is logged meanwhile is written to the terminal afterwards.
pub fn show(fleet: &Mutex<Fleet>, about: &str, is_over: &impl Fn() -> bool) -> std::io::Result<()> {
    let waiting = Arc::new(Mutex::new(VecDeque::<Vec<u8>>::new()));
    let lines = Arc::clone(&waiting);
    let redirected = log_lines::redirect(move |line| {
        let mut lines = lines.lock();
        if lines.len() == MAX_LINES {
            lines.pop_front();
        }
        lines.push_back(line.to_owned());
    });
    let shown = view::show(fleet, about, is_over);
    drop(redirected);
    // A terminal that is gone takes no lines.
    let (mut stderr, waiting) = (std::io::stderr().lock(), waiting.lock());
    let _ = waiting.iter().try_for_each(|line| stderr.write_all(line));
    shown
}
