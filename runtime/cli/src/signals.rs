//! Signals that end a command. A worker ([`supervisor`]) is stopped by its supervisor instead.

use super::supervisor;
use signal_hook::consts::{SIGALRM, SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1};
use signal_hook::iterator::Signals;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Status of a command that a second signal has ended.
const INTERRUPTED: i32 = 130;

/// Set by the first signal that ends a program; a second one ends the process at once.
///
/// # Errors
/// When no handler can be installed.
pub fn stop_on_signal() -> anyhow::Result<Arc<AtomicBool>> {
    stop_unless(|_| false)
}

/// As [`stop_on_signal`], but a flight goes on when its terminal is closed, and after signals that are not for it.
///
/// # Errors
/// When no handler can be installed.
pub fn stop_in_flight() -> anyhow::Result<Arc<AtomicBool>> {
    stop_unless(|signal| {
        let is_ignored = [SIGHUP, SIGUSR1, SIGALRM].contains(&signal);
        if is_ignored {
            tracing::warn!(
                "signal {signal} (SIGHUP: the terminal was closed) is ignored; the flight continues, SIGTERM ends it"
            );
        }
        is_ignored
    })
}

/// Ignores all of them: somebody else ends this process.
///
/// # Errors
/// When no handler can be installed.
pub fn ignore_signals() -> anyhow::Result<()> {
    stop_unless(|_| true).map(|_| ())
}

fn stop_unless(is_ignored: impl Fn(i32) -> bool + Send + 'static) -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGQUIT, SIGHUP, SIGUSR1, SIGALRM])?;
    let is_worker = supervisor::is_worker();
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        for signal in signals.forever() {
            let is_supervisors = is_worker && signal != supervisor::STOP;
            if !is_supervisors && !is_ignored(signal) && flag.swap(true, Ordering::Relaxed) {
                std::process::exit(INTERRUPTED);
            }
        }
    })?;
    Ok(stop)
}
