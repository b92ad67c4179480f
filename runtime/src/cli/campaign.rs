//! `plumbline campaign`: the built-in set of simulated flights, tabulated.

use super::choice::FlightChoice;
use super::{Usage, check_outputs, load_config, one_line, say};
use crate::campaign::table::{SILENCE_HEAD, TABLE_HEAD, TRUST_HEAD, means, silence_row, trust_row};
use crate::campaign::{Entry, Fault, Setup};
use crate::flight::with_overrides;
use crate::report::Report;
use anyhow::{Context, Result, ensure};
use clap::Args;
use plumbline_config::Config;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Arguments of `plumbline campaign`.
#[derive(Debug, Args)]
pub struct CampaignArgs {
    /// Which flights.
    #[command(flatten)]
    pub choice: FlightChoice,
    /// Start, seconds into the trajectory; else where the vehicle is in full flight.
    #[arg(long)]
    pub start: Option<f64>,
    /// Fly each fault once on top, along the first trajectory in the first scene of the choice, and tell whether the
    /// covariance could be trusted while it lasted and after it.
    #[arg(long)]
    pub faults: bool,
    /// Of the faults only those whose names begin so, and no sound flight, such as blind,imu-gap.
    #[arg(long, value_delimiter = ',', requires = "faults", value_name = "NAME")]
    pub fault: Vec<String>,
    /// The left camera alone.
    #[arg(long)]
    pub mono: bool,
    /// Configuration file or preset of the simulated rig and of the estimator.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Change a key of the estimator's configuration, such as estimator.points.sigma_px=0.3; may be
    /// repeated. What is simulated stays the same.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Keep rendered frames in this folder (about 220 MB for 15 s of stereo) and take them from there.
    #[arg(long)]
    pub cache: Option<PathBuf>,
    /// Flights at a time.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    pub jobs: u8,
    /// 1 renders between frames, 2 ahead on another thread.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub threads: u8,
    /// Write all reports (JSON).
    #[arg(long, value_name = "OUT.json")]
    pub json: Option<PathBuf>,
}

#[derive(Serialize)]
struct Row<'a> {
    path: &'a str,
    scene: &'a str,
    fault: String,
    seed: u64,
    report: &'a Report,
}

/// Runs the command.
///
/// # Errors
/// When a flight cannot be simulated.
pub fn run(args: &CampaignArgs) -> Result<()> {
    check_outputs(&args.json)?;
    let config = load_config(args.config.as_deref())?.map_or_else(|| Config::preset("sim"), Ok)?;
    with_overrides(&config, &args.overrides)?;
    let entries = entries(args)?;
    let setup = Setup {
        config: Some(config),
        overrides: args.overrides.clone(),
        mono: args.mono,
        cache: args.cache.clone(),
        threads: usize::from(args.threads),
    };
    say(TABLE_HEAD);
    let flown = fly_all(&entries, &setup, usize::from(args.jobs));
    let reports = || entries.iter().zip(&flown).filter_map(|(e, r)| Some((e, r.as_ref()?)));
    say(format_args!("\n{}", means(reports())));
    let faulty: Vec<_> = reports().filter_map(|(entry, report)| trust_row(entry, report)).collect();
    if !faulty.is_empty() {
        say(format_args!("\n{TRUST_HEAD}\n{}", faulty.join("\n")));
    }
    let silent: Vec<_> = reports().filter_map(|(entry, report)| silence_row(entry, report)).collect();
    if !silent.is_empty() {
        say(format_args!("\n{SILENCE_HEAD}\n{}", silent.join("\n")));
    }
    if let Some(file) = &args.json {
        let rows: Vec<Row<'_>> = reports().map(json_row).collect();
        std::fs::write(file, serde_json::to_string_pretty(&rows)?).context(file.display().to_string())?;
    }
    let failed = flown.iter().filter(|report| report.is_none()).count();
    ensure!(failed == 0, "{failed} of {} flights could not be flown", entries.len());
    Ok(())
}

fn json_row<'a>((entry, report): (&'a Entry, &'a Report)) -> Row<'a> {
    let fault = format!("{:?}", entry.fault);
    Row { path: &entry.path, scene: entry.scene, fault, seed: entry.scenario.seed, report }
}

/// Flies the entries, `jobs` at a time, and prints each as it lands; the reports are in the order of the
/// entries.
fn fly_all(entries: &[Entry], setup: &Setup, jobs: usize) -> Vec<Option<Report>> {
    let next = AtomicUsize::new(0);
    let worker = || {
        let mut flown = Vec::new();
        let take = || {
            let index = next.fetch_add(1, Ordering::Relaxed);
            entries.get(index).map(|entry| (index, entry))
        };
        for (index, entry) in std::iter::from_fn(take) {
            match entry.fly_as(setup) {
                Ok(report) => {
                    say(entry.row(&report));
                    flown.push((index, report));
                }
                Err(error) => {
                    eprintln!("plumbline: {} in {}: {}", entry.path, entry.scene, one_line(&error.into()));
                }
            }
        }
        flown
    };
    let mut reports = vec![None; entries.len()];
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs.min(entries.len())).map(|_| scope.spawn(worker)).collect();
        for flown in workers {
            let flown = flown.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            flown.into_iter().for_each(|(index, report)| reports[index] = Some(report));
        }
    });
    reports
}

fn entries(args: &CampaignArgs) -> Result<Vec<Entry>, Usage> {
    let mut entries = args.choice.entries(args.start)?;
    if args.faults {
        // With one camera there is no right one to lose, and without the left there is none.
        let possible = |fault: &Fault| !(args.mono && fault.needs_two_cameras());
        let chosen = |fault: &Fault| {
            let name = format!("{fault:?}").to_lowercase();
            args.fault.is_empty()
                || args.fault.iter().any(|wanted| name.starts_with(&wanted.to_lowercase().replace('-', "")))
        };
        let faults = Fault::ALL.into_iter().filter(possible).filter(chosen);
        let sound = entries[0].clone();
        if !args.fault.is_empty() {
            entries.clear();
        }
        entries.extend(faults.map(|fault| sound.with_fault(fault)));
    }
    match entries.is_empty() {
        true => {
            Err(Usage(format!("--fault: none is called {}; leave it out to see all", args.fault.join(", "))))
        }
        false => Ok(entries),
    }
}
