//! The view of a ground station in the terminal.

use super::super::log_lines;
use plumbline_ground::fleet::Fleet;
use plumbline_ground::view;
use std::io::Write as _;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

/// Shows the view in the terminal, with the log in a pane of it. What was logged meanwhile stays in the terminal afterwards.
pub fn show(
    fleet: &Mutex<Fleet>,
    about: &str,
    is_over: &impl Fn() -> bool,
    stop: &AtomicBool,
) -> std::io::Result<()> {
    let log = LogInView::start();
    view::show(fleet, &log.pane, about, is_over, stop)
}

/// Lines of the log go into a pane as long as this is there, and are written to the terminal when it goes.
struct LogInView {
    pane: Arc<view::LogPane>,
    redirected: Option<log_lines::Redirected>,
}

impl LogInView {
    fn start() -> Self {
        let pane = Arc::new(view::LogPane::new());
        let lines_to = Arc::clone(&pane);
        Self { pane, redirected: Some(log_lines::redirect(move |line| lines_to.push(line))) }
    }
}

impl Drop for LogInView {
    fn drop(&mut self) {
        drop(self.redirected.take());
        // A terminal that is gone takes no lines.
        let mut stderr = std::io::stderr().lock();
        let _ = self.pane.take().iter().try_for_each(|line| writeln!(stderr, "{line}"));
    }
}
