//! `router` and `ground` as two processes: the one that the user started, and the worker that it starts and, when that dies of a
//! fault, starts again. What a panic in a network library leaves behind cannot be trusted, and peers may be able to cause one;
//! so the worker ends on it, and the restart is here, also where no service manager is.
//!
//! Signals reach the supervisor, or both from a terminal. The worker ignores them and stops on [`STOP`] instead, which the
//! supervisor sends once for each; so a Ctrl-C counts once. The worker dies with its supervisor (PR_SET_PDEATHSIG).

use super::exit_status::FAULT;
use super::log_lines;
use super::restart::Restarts;
use anyhow::{Context as _, Result};
use plumbline_link::net::threads;
use rustix::process::{Pid, Signal, kill_process, set_parent_process_death_signal};
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};
use signal_hook::consts::{SIGCHLD, SIGHUP, SIGINT, SIGTERM, SIGUSR1};
use signal_hook::iterator::Signals;
use std::io::{IsTerminal as _, Write as _};
use std::path::PathBuf;
use std::process::{Child, Command, ExitCode, ExitStatus};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Environment variable of the worker: CLOCK_MONOTONIC when the command began, ns.
const VARIABLE: &str = "PLUMBLINE_SUPERVISED_SINCE_NS";
/// Signal by which the supervisor stops its worker.
pub const STOP: i32 = SIGUSR1;
/// Signals of the user, after which the worker is killed.
const PATIENCE_SIGNALS: u32 = 3;
/// Status of a command that a signal has ended before it could react.
const INTERRUPTED: u8 = 130;
/// Starts after a fault that may fail one after the other, as when the port is not free yet.
const MAX_FAILED_STARTS: u32 = 10;
/// The worker is looked at this often, also without a signal.
const GLANCE: Duration = Duration::from_secs(1);
/// Ends the alternate screen of a terminal and shows its cursor, as a view does that ends by itself.
const LEAVE_VIEW: &[u8] = b"\x1b[?1049l\x1b[?25h";

/// True if this process is a worker.
pub fn is_worker() -> bool {
    std::env::var_os(VARIABLE).is_some()
}

/// Moment at which the command began: before this process if that has been started again.
pub fn begun() -> Instant {
    let since_ns = std::env::var(VARIABLE).ok().and_then(|text| text.parse::<u64>().ok());
    let age = since_ns.and_then(|since_ns| monotonic_ns().checked_sub(since_ns)).map(Duration::from_nanos);
    let now = Instant::now();
    age.and_then(|age| now.checked_sub(age)).unwrap_or(now)
}

fn monotonic_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec.cast_unsigned() * 1_000_000_000 + now.tv_nsec.cast_unsigned()
}

/// Makes this process a worker: it ends with its supervisor, and on a panic of any of its threads.
///
/// # Errors
/// When the system refuses.
pub fn begin_work() -> Result<()> {
    log_lines::end_on_panic(FAULT);
    if is_worker() {
        set_parent_process_death_signal(Some(Signal::KILL)).context("PR_SET_PDEATHSIG")?;
    }
    Ok(())
}

/// Runs this command line in a worker until it ends by itself or the user stops it; its exit status.
///
/// # Errors
/// When no worker can be started.
pub fn run(name: &str) -> Result<ExitCode> {
    let signals = signals()?;
    let since_ns = monotonic_ns();
    let terminal = Terminal::remember();
    let (mut restarts, mut failed_starts, mut had_fault) = (Restarts::new(), 0, false);
    loop {
        let (status, stops) = live(start(since_ns)?, &signals)?;
        let is_settled = restarts.is_settled();
        let is_fault = status.code() == Some(FAULT.into()) || status.code().is_none();
        // A start after a fault may find its port still taken.
        failed_starts = if is_settled { 0 } else { failed_starts + 1 };
        let is_late_start =
            had_fault && !is_settled && status.code() == Some(1) && failed_starts <= MAX_FAILED_STARTS;
        if stops > 0 || !(is_fault || is_late_start) {
            // A worker that is stopped before it listens to signals has nothing to end.
            let by_signal = if stops < PATIENCE_SIGNALS { 0 } else { INTERRUPTED };
            let code = status.code().map_or(by_signal, |code| u8::try_from(code).unwrap_or(1));
            return Ok(ExitCode::from(code));
        }
        had_fault |= is_fault;
        terminal.restore();
        tracing::warn!("{name} ended by a fault ({status}); starting it again");
        if restarts.is_over(|pause| wait(&signals, pause)) {
            return Ok(ExitCode::SUCCESS);
        }
    }
}

/// Signals of the user and of workers that end.
fn signals() -> Result<Receiver<i32>> {
    let (sender, receiver) = channel();
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP, SIGCHLD])?;
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        for signal in signals.forever() {
            if sender.send(signal).is_err() {
                return;
            }
        }
    })?;
    Ok(receiver)
}

/// Waits; whether the user stopped it meanwhile.
fn wait(signals: &Receiver<i32>, pause: Duration) -> bool {
    let end = Instant::now() + pause;
    loop {
        match signals.recv_timeout(end.saturating_duration_since(Instant::now())) {
            Ok(SIGCHLD) => {}
            Err(RecvTimeoutError::Timeout) => return false,
            Ok(_) | Err(RecvTimeoutError::Disconnected) => return true,
        }
    }
}

fn start(since_ns: u64) -> Result<Child> {
    let mut command = Command::new(program()?);
    command.args(std::env::args_os().skip(1)).env(VARIABLE, since_ns.to_string());
    if std::env::var_os(threads::VARIABLE).is_none() {
        command.env(threads::VARIABLE, threads::LAYOUT);
    }
    command.spawn().context("cannot start the worker process")
}

/// This program, also after an update has replaced its file.
fn program() -> Result<PathBuf> {
    let program = std::env::current_exe()?;
    Ok(if program.exists() { program } else { "/proc/self/exe".into() })
}

/// One life of a worker: its status, and how often the user stopped it.
fn live(mut worker: Child, signals: &Receiver<i32>) -> Result<(ExitStatus, u32)> {
    let mut stops = 0;
    loop {
        if let Some(status) = worker.try_wait()? {
            return Ok((status, stops));
        }
        match signals.recv_timeout(GLANCE) {
            Ok(SIGCHLD) | Err(RecvTimeoutError::Timeout) => {}
            Ok(_) | Err(RecvTimeoutError::Disconnected) => {
                stops += 1;
                let _ = match stops < PATIENCE_SIGNALS {
                    true => kill_process(Pid::from_child(&worker), Signal::USR1),
                    false => kill_process(Pid::from_child(&worker), Signal::KILL),
                };
            }
        }
    }
}

/// Settings of the terminal before a worker draws on it.
struct Terminal(Option<Termios>);

impl Terminal {
    fn remember() -> Self {
        let stdin = std::io::stdin();
        Self(if stdin.is_terminal() { tcgetattr(stdin).ok() } else { None })
    }

    /// Undoes what a worker has set that could not do so itself.
    fn restore(&self) {
        let Some(settings) = &self.0 else { return };
        let _ = tcsetattr(std::io::stdin(), OptionalActions::Now, settings);
        let mut stdout = std::io::stdout();
        if stdout.is_terminal() {
            let _ = stdout.write_all(LEAVE_VIEW).and_then(|()| stdout.flush());
        }
    }
}
