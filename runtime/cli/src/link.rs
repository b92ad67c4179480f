//! `plumbline link`: the network process, which publishes a flight that it reads from a local socket.

use super::exit_status::FAULT;
use super::signals::ignore_signals;
use super::{log_lines, stop_on_signal};
use anyhow::{Context as _, Result};
use clap::Args;
use plumbline_link::process::{Ended, LinkOptions, serve};
use rustix::process::{Signal, set_parent_process_death_signal};
use std::os::fd::AsFd as _;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// A flight that is not there is looked for this often.
const RETRY: Duration = Duration::from_millis(500);
/// When the host runs out of memory it ends this process before the flight (`oom_score_adj`).
const OUT_OF_MEMORY_SCORE: &str = "500";

/// Arguments of `plumbline link`.
// Help texts name tables of the configuration in brackets.
#[allow(rustdoc::broken_intra_doc_links)]
#[derive(Debug, Args)]
#[command(after_help = "\
The command reads the flight's configuration from the socket, including network, permissions and ROS 2. While there is no \
flight, it waits for one.

Example:
  plumbline fly --config drone.toml --set local.path=/run/plumbline/local
  plumbline link --socket /run/plumbline/local --listen tcp/0.0.0.0:7447")]
pub struct LinkArgs {
    /// Local socket of the flight: local.path of its configuration.
    #[arg(long, value_name = "PATH", required_unless_present = "started")]
    pub socket: Option<PathBuf>,
    /// Listen on this endpoint in addition to network.listen, such as tcp/0.0.0.0:7447; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Connect to this router or ground station in addition to network.connect; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Started by a flight, which is at the other end of standard input.
    #[arg(long, hide = true, conflicts_with = "socket")]
    pub started: bool,
    /// Open a session also without an endpoint.
    #[arg(long, hide = true)]
    pub publish: bool,
    /// Retry a session that cannot be opened yet.
    #[arg(long, hide = true)]
    pub patient: bool,
}

/// Runs the command.
///
/// # Errors
/// When the flight cannot be understood, or the network not be used.
pub fn run(args: &LinkArgs) -> Result<()> {
    log_lines::end_on_panic(FAULT);
    let options = LinkOptions {
        listen: args.listen.clone(),
        connect: args.connect.clone(),
        publish: args.publish,
        is_patient: args.patient || !args.started,
    };
    match &args.socket {
        Some(path) => run_by_hand(path, &options),
        None => run_started(&options),
    }
}

/// Serves the flight that has started this process, and does not outlive it.
fn run_started(options: &LinkOptions) -> Result<()> {
    set_parent_process_death_signal(Some(Signal::KILL)).context("PR_SET_PDEATHSIG")?;
    // More than nothing: a host may refuse it.
    let _ = std::fs::write("/proc/self/oom_score_adj", OUT_OF_MEMORY_SCORE);
    // The flight ends first, and says so over the socket.
    ignore_signals()?;
    let stream = UnixStream::from(std::io::stdin().as_fd().try_clone_to_owned()?);
    // Why it cannot start is reported to the flight, whose words they are.
    let _ = serve(stream, options, &AtomicBool::new(false));
    Ok(())
}

/// Serves one flight after the other until a signal ends it.
fn run_by_hand(path: &Path, options: &LinkOptions) -> Result<()> {
    let stop = stop_on_signal()?;
    let mut is_told = false;
    while !stop.load(Ordering::Relaxed) {
        match UnixStream::connect(path) {
            Ok(stream) => {
                is_told = false;
                serve_one(stream, path, options, &stop)?;
            }
            Err(error) if !is_told => {
                is_told = true;
                tracing::warn!("{}: no flight yet ({error}); retrying until there is one", path.display());
            }
            Err(_) => {}
        }
        pause(&stop);
    }
    Ok(())
}

fn serve_one(stream: UnixStream, path: &Path, options: &LinkOptions, stop: &Arc<AtomicBool>) -> Result<()> {
    let path = path.display();
    match serve(stream, options, stop) {
        Ok(Ended::FlightOver) => tracing::info!("{path}: the flight is over; waiting for the next"),
        Ok(Ended::FlightGone) => tracing::warn!("{path}: the flight disconnected; waiting for the next"),
        Ok(Ended::Stopped) => {}
        Err(error) if error.is_usage() => return Err(error).with_context(|| path.to_string()),
        Err(error) => tracing::warn!("{path}: {error}; retrying"),
    }
    Ok(())
}

fn pause(stop: &AtomicBool) {
    const STEPS: u32 = 10;
    (0..STEPS).filter(|_| !stop.load(Ordering::Relaxed)).for_each(|_| std::thread::sleep(RETRY / STEPS));
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser as _;

    #[derive(clap::Parser)]
    struct Command {
        #[command(flatten)]
        args: LinkArgs,
    }

    #[test]
    fn a_socket_or_a_flight_is_needed_and_not_both() {
        let parsed = |line: &str| Command::try_parse_from(line.split(' ')).map(|command| command.args);
        assert!(parsed("link").is_err());
        assert!(parsed("link --started --socket /s").is_err());
        assert_eq!(parsed("link --socket /s").unwrap().socket, Some("/s".into()));
    }
}
