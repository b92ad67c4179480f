//! The command line: arguments in, exit status out.
//!
//! 0 success, 1 the run failed, 2 wrong usage or configuration, 3 a fault of the program in flight ([`exit_status`]); a failure is one line on stderr that
//! names the file, the key or the device, and what to do.

pub mod access;
mod calibrate;
mod checks;
mod command_line;
mod config;
mod demo;
pub mod devices;
mod doctor;
pub mod evaluate;
mod exit_status;
pub mod fly;
mod fly_status;
mod ground;
mod help;
mod keys;
mod link;
mod link_process;
pub mod log;
mod log_lines;
mod logs;
mod man;
mod map;
#[cfg(test)]
mod message_options_tests;
mod paths;
mod progress;
mod remote;
pub mod replay;
mod reset;
mod restart;
mod router;
pub mod run_args;
mod say;
pub mod scenario;
mod setup;
mod signals;
pub mod simulate;
mod simulated;
mod supervisor;
pub mod topics;
pub mod verify;

pub use checks::{
    Usage, check_maps, check_mounting, check_new, check_outputs, load_config, parse_range, write_config,
};
pub use say::{one_line, say, say_within};
pub use signals::stop_on_signal;

use clap::FromArgMatches as _;
use command_line::{Cli, Command};
use plumbline_link::net::threads;
use say::{last_words, within};
use std::io::Write as _;
use std::os::unix::process::CommandExt as _;
use std::process::ExitCode;
use std::time::Duration;

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    let mut known = help::command();
    let cli = Cli::from_arg_matches(&known.get_matches_mut())
        .unwrap_or_else(|error| error.format(&mut known).exit());
    let supervised = cli.command.supervised().filter(|_| !supervisor::is_worker());
    if cli.command.has_network() && supervised.is_none() {
        lay_out_threads();
    }
    logs::start(cli.verbose, matches!(cli.command, Command::Fly(_)));
    let ended = match supervised {
        Some(name) => supervisor::run(name),
        None => run(cli.command).map(|()| ExitCode::SUCCESS),
    };
    log_lines::flush();
    match ended {
        Ok(status) => status,
        Err(error) => {
            // A terminal that is gone takes no words, and that is no reason to panic; nor is one that stands still.
            let words = format!("plumbline: {}\n", last_words(&error));
            within(PATIENCE, move || drop(std::io::stderr().write_all(words.as_bytes())));
            ExitCode::from(exit_status::exit_status(&error))
        }
    }
}

fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Demo(args) => demo::run(&args),
        Command::Fly(args) => fly::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Verify(args) => verify::run(&args),
        Command::Log(args) => log::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        Command::Map(args) => map::run(&args),
        Command::Ground(args) => ground::run(&args),
        Command::Router(args) => router::run(&args),
        Command::Link(args) => link::run(&args),
        Command::Reset(args) => reset::run(&args),
        Command::Keys(args) => keys::run(&args),
        Command::Devices(args) => devices::run(&args),
        Command::Setup(args) => setup::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Config(args) => config::run(&args),
        Command::Help(args) => help::run(&args),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut help::full(), "plumbline", &mut script);
            say(String::from_utf8_lossy(&script).trim_end());
            Ok(())
        }
        Command::Man(args) => man::run(help::full(), &args),
    }
}

/// Begins the program anew with the layout of Zenoh's threads in its environment, from which alone Zenoh takes it; where that
/// cannot be done, it goes on with another layout.
fn lay_out_threads() {
    if std::env::var_os(threads::VARIABLE).is_none()
        && let Ok(program) = std::env::current_exe()
    {
        let mut again = std::process::Command::new(program);
        let _ = again.args(std::env::args_os().skip(1)).env(threads::VARIABLE, threads::LAYOUT).exec();
    }
}

/// Longest time that the last output of a command waits for the terminal.
const PATIENCE: Duration = Duration::from_secs(1);

#[cfg(test)]
mod tests {
    #[test]
    fn the_command_line_is_consistent() {
        crate::help::command().debug_assert();
    }
}
