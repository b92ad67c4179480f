//! `plumbline ground`: who flies, where, and how well it is known, in the terminal.
//!
//! [`fleet`] is what has been heard of every vehicle, in bounded memory; [`listen`] fills it from the
//! network; [`view`] draws it.

pub mod fleet;
pub mod listen;
pub mod view;

use crate::cli::{Usage, stop_on_signal};
use crate::net::Endpoints;
use anyhow::Result;
use clap::Args;
use fleet::Fleet;
use listen::Listener;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The view is drawn this often.
const REDRAW: Duration = Duration::from_millis(100);

/// Arguments of `plumbline ground`.
#[derive(Debug, Args)]
pub struct GroundArgs {
    /// Zenoh endpoint of a vehicle or router, such as tcp/192.168.1.10:7447. May be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Listen for vehicles that connect to us.
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Only this vehicle.
    #[arg(long, default_value = "*")]
    pub vehicle: String,
    /// A line a second for each vehicle instead of the view.
    #[arg(long)]
    pub plain: bool,
    /// One JSON object for each state received.
    #[arg(long, conflicts_with = "plain")]
    pub json: bool,
    /// End after this time, seconds.
    #[arg(long)]
    pub duration: Option<f64>,
}

/// Runs the command.
///
/// # Errors
/// When the network cannot be reached or the terminal not be used.
pub fn run(args: &GroundArgs) -> Result<()> {
    if args.connect.is_empty() && args.listen.is_empty() {
        let message = "nowhere to look: name a vehicle with --connect tcp/HOST:7447, or wait with --listen";
        return Err(Usage(message.into()).into());
    }
    let endpoints = Endpoints {
        vehicle: args.vehicle.clone(),
        listen: args.listen.clone(),
        connect: args.connect.clone(),
        scouting: false,
    };
    let fleet = Arc::new(Mutex::new(Fleet::default()));
    let listener = Listener::start(&endpoints, Arc::clone(&fleet), args.json)?;
    let stop = stop_on_signal()?;
    let end = args.duration.map(|s| Instant::now() + Duration::from_secs_f64(s.clamp(0.0, 1e6)));
    let is_over = || stop.load(Ordering::Relaxed) || end.is_some_and(|end| Instant::now() >= end);
    let outcome = if args.json {
        wait(&is_over);
        Ok(())
    } else if args.plain || !std::io::stdout().is_terminal() {
        print_lines(&fleet, &is_over)
    } else {
        view::show(&fleet, &is_over, &stop)
    };
    listener.stop();
    outcome
}

fn wait(is_over: &impl Fn() -> bool) {
    while !is_over() {
        std::thread::sleep(REDRAW);
    }
}

fn print_lines(fleet: &Mutex<Fleet>, is_over: &impl Fn() -> bool) -> Result<()> {
    let mut next = Instant::now() + Duration::from_secs(1);
    while !is_over() {
        std::thread::sleep(REDRAW);
        if Instant::now() < next {
            continue;
        }
        next += Duration::from_secs(1);
        let lines = fleet.lock().unwrap_or_else(PoisonError::into_inner).lines(Instant::now());
        let mut out = std::io::stdout().lock();
        if lines.is_empty() {
            writeln!(out, "no vehicle heard yet")?;
        }
        for line in lines {
            writeln!(out, "{line}")?;
        }
        out.flush()?;
    }
    Ok(())
}

/// Ends the view when a key says so.
fn quit(stop: &AtomicBool) {
    stop.store(true, Ordering::Relaxed);
}
