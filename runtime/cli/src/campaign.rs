//! `plumbline campaign`: the built-in set of simulated flights, tabulated.

mod faults;

use super::choice::{FlightChoice, TrialArgs};
use super::paired::{self, Against};
use super::{Usage, check_outputs, load_config, one_line, say_unless_closed};
use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};
use faults::{each_named, faults, not_flown};
use plumbline_config::Config;
use plumbline_flight::flight::with_overrides;
use plumbline_lab::campaign::honest::{HONESTY_HEAD, honesty_row, honesty_summary};
use plumbline_lab::campaign::table::{
    HEALTH_HEAD, RATIO_HEAD, SILENCE_HEAD, TABLE_HEAD, TRUST_HEAD, consistency, health_rows, means,
    ratio_rows, silence_row, trust_row,
};
use plumbline_lab::campaign::{CampaignFault, Entry, Setup, drawn};
use plumbline_lab::report::Report;
use plumbline_lab::report::paired::{PairedComparison, Variant};
use plumbline_lab::sweep::run::fly_each;
use serde::Serialize;
use std::fmt::Display;
use std::path::PathBuf;

/// Arguments of `plumbline campaign`.
#[derive(Debug, Args)]
pub struct CampaignArgs {
    /// Choice of the flights.
    #[command(flatten)]
    pub choice: FlightChoice,
    /// Start times, seconds into the trajectory; every flight is flown from each. Default: a time in full flight.
    #[arg(long, value_delimiter = ',', value_name = "S,S")]
    pub start: Vec<f64>,
    /// Inertial samples: simulated, or recorded along the paths. Recorded samples exist for V1_01, V1_02, V2_01,
    /// V2_02, MH_01, MH_03 and MH_04, and need the preset euroc.
    #[arg(long, value_enum, default_value_t = ImuChoice::Simulated)]
    pub imu: ImuChoice,
    /// Also fly each fault once, along the first trajectory in the first scene of the choice, and report whether the
    /// errors were consistent with the covariance.
    #[arg(long)]
    pub faults: bool,
    /// Fly only faults with these name prefixes, such as blind,imu-gap, and no flight without a fault. Also takes
    /// faults with a dose and a time, such as accel-pulse:x:30@6+0.1 (`plumbline help faults` lists them), and errors of inertial
    /// sensors and conditions, such as force:0.05:1 or blur:10:6 (see --imu-error and --condition); these are flown
    /// in addition to the flights without a fault.
    #[arg(long, value_delimiter = ',', requires = "faults", value_name = "NAME|KIND:DOSE@FROM")]
    pub fault: Vec<String>,
    /// Fly each fault along every flight of the choice, not only along the first.
    #[arg(long, requires = "faults")]
    pub everywhere: bool,
    /// Fly so many flights with drawn failures instead: kind, axis, size, moment and noise, among jitter of stamps, missing
    /// frames, crowds and textures, and tabulate how often each health bit named the right sensor. A thousand flights of 12 s
    /// take half an hour.
    #[arg(long, value_name = "COUNT", conflicts_with_all = ["faults", "imu_error", "condition"])]
    pub drawn: Option<usize>,
    /// Seed of the draws of --drawn.
    #[arg(long, requires = "drawn", default_value_t = 1)]
    pub draw_seed: u64,
    /// Also fly every flight with this error of the inertial sensor, such as force:0.07:2, and compare. `all` is
    /// every error in its usual doses (`plumbline help imu-errors`). May be repeated.
    #[arg(long, value_name = "NAME[:DOSE...]", value_delimiter = ',')]
    pub imu_error: Vec<String>,
    /// Also fly every flight in this condition of light, camera, scene or motion, such as blur:10:6, and compare.
    /// `all` is every condition in its usual doses (`plumbline help conditions`). May be repeated.
    #[arg(long, value_name = "NAME[:DOSE...]", value_delimiter = ',')]
    pub condition: Vec<String>,
    /// Give the estimator a calibration that the seed draws around the true one, with K times the standard deviations
    /// in [rig] of the configuration (before --set).
    #[allow(rustdoc::broken_intra_doc_links)]
    #[arg(long, value_name = "K", default_value_t = 0.0)]
    pub calibration_error: f64,
    /// Tilt of the whole scene of every flight from the vertical, degrees, in a direction drawn by the seed.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    pub lean_deg: f64,
    /// Flight, and what is kept of it.
    #[command(flatten)]
    pub trial: TrialArgs,
    /// Parallel flights.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    pub jobs: u8,
    /// Number of threads of a flight: 1 renders between frames, 2 renders ahead on another thread.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub threads: u8,
    /// Compare with a variant, flight by flight: means, mean paired differences and their bootstrap intervals of 95
    /// %. A variant is a change of the configuration (key=value,key=value, after --set); every flight is also flown
    /// with it. A variant can also be a --json file of the same flights from another build, shown as "before". May be
    /// repeated.
    #[arg(long, value_name = "KEY=VALUE,...|FILE.json")]
    pub against: Vec<String>,
    /// With --against: write the comparison (JSON).
    #[arg(long, value_name = "OUT.json", requires = "against")]
    pub paired_json: Option<PathBuf>,
}

impl CampaignArgs {
    /// True if there are files to write, even if the standard output is closed.
    fn writes_files(&self) -> bool {
        self.trial.json.is_some() || self.paired_json.is_some()
    }
}

/// Where inertial samples come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ImuChoice {
    /// Computed from the path.
    Simulated,
    /// Recorded along the path.
    Recorded,
}

#[derive(Serialize)]
struct Row<'a> {
    path: &'a str,
    scene: &'a str,
    fault: String,
    seed: u64,
    start_s: f64,
    duration_s: f64,
    report: &'a Report,
}

/// Runs the command.
///
/// # Errors
/// When a flight cannot be simulated.
pub fn run(args: &CampaignArgs) -> Result<()> {
    check_outputs(args.trial.json.iter().chain(&args.paired_json))?;
    let preset = if args.imu == ImuChoice::Recorded { "euroc" } else { "sim" };
    let config = load_config(args.trial.config.as_deref())?.map_or_else(|| Config::preset(preset), Ok)?;
    with_overrides(&config, &args.trial.overrides)?;
    let against = args.against.iter().map(|text| Against::parse(text, &config, &args.trial.overrides));
    let against = against.collect::<Result<Vec<_>>>()?;
    let entries = entries(args)?;
    let setup = Setup {
        config: Some(config),
        overrides: args.trial.overrides.clone(),
        mono: args.trial.mono,
        cache: args.trial.cache.clone(),
        threads: usize::from(args.threads),
    };
    // A closed pipe must not lose the files.
    let say = |line: &dyn Display| say_unless_closed(args.writes_files(), line);
    say(&TABLE_HEAD);
    let flown = fly_all(&entries, &setup, args);
    let reports = || entries.iter().zip(&flown).filter_map(|(e, r)| Some((e, r.as_ref()?)));
    say(&format_args!("\n{}", means(reports())));
    say(&format_args!("\n{}", consistency(reports().map(|(_, report)| report))));
    let faulty: Vec<_> = reports().filter_map(|(entry, report)| trust_row(entry, report)).collect();
    if !faulty.is_empty() {
        say(&format_args!("\n{TRUST_HEAD}\n{}", faulty.join("\n")));
    }
    let silent: Vec<_> = reports().filter_map(|(entry, report)| silence_row(entry, report)).collect();
    for (head, rows) in [(RATIO_HEAD, ratio_rows(reports())), (SILENCE_HEAD, silent)] {
        if !rows.is_empty() {
            say(&format_args!("\n{head}\n{}", rows.join("\n")));
        }
    }
    let honest: Vec<_> = reports().filter_map(|(entry, report)| honesty_row(entry, report)).collect();
    if let Some(summary) = honesty_summary(reports()) {
        say(&format_args!("\n{HONESTY_HEAD}\n{}\n\n{summary}", honest.join("\n")));
    }
    if args.drawn.is_some() {
        let flights: Vec<_> =
            reports().filter_map(|(e, report)| Some((e, report.honesty.as_ref()?))).collect();
        say(&format_args!("\n{}", drawn::tables(&flights)));
    }
    if let Some(line) = not_flown(args)? {
        say(&line);
    }
    let health = health_rows(reports());
    if !health.is_empty() {
        say(&format_args!("\n{HEALTH_HEAD}\n{}", health.join("\n")));
    }
    if let Some(file) = &args.trial.json {
        let rows: Vec<Row<'_>> = reports().map(json_row).collect();
        std::fs::write(file, serde_json::to_string_pretty(&rows)?).context(file.display().to_string())?;
    }
    if !against.is_empty() {
        compare(&entries, &flown, &setup, args, &against)?;
    }
    let failed = flown.iter().filter(|report| report.is_none()).count();
    ensure!(failed == 0, "{failed} of {} flights could not be flown", entries.len());
    Ok(())
}

fn json_row<'a>((entry, report): (&'a Entry, &'a Report)) -> Row<'a> {
    let fault = entry.failure();
    let scenario = &entry.scenario;
    let (start_s, duration_s) = (scenario.start_s, scenario.duration_s);
    Row { path: &entry.path, scene: entry.scene, fault, seed: scenario.seed, start_s, duration_s, report }
}

/// The reports of a variant, for pairing.
fn variant(name: String, entries: &[Entry], flown: &[Option<Report>]) -> Result<Variant> {
    let rows = entries.iter().zip(flown).filter_map(|(e, r)| Some(json_row((e, r.as_ref()?))));
    let rows: Vec<serde_json::Value> = rows.map(serde_json::to_value).collect::<Result<_, _>>()?;
    Ok(Variant::of_rows(name, &rows))
}

/// Flies or reads what is to be compared, and compares.
fn compare(
    entries: &[Entry],
    flown: &[Option<Report>],
    setup: &Setup,
    args: &CampaignArgs,
    against: &[Against],
) -> Result<()> {
    let here = variant(paired::name(&args.trial.overrides), entries, flown)?;
    let mut comparisons = Vec::new();
    for other in against {
        comparisons.push(match other {
            Against::File(before) => PairedComparison::of(before, &here),
            Against::Changes(changes) => {
                let name = paired::name(changes);
                say_unless_closed(args.writes_files(), format_args!("\n{name}\n\n{TABLE_HEAD}"));
                let overrides = args.trial.overrides.iter().chain(changes).cloned().collect();
                let setup = Setup { overrides, ..setup.clone() };
                let flown = fly_all(entries, &setup, args);
                PairedComparison::of(&here, &variant(name, entries, &flown)?)
            }
        });
    }
    paired::write(&comparisons, args.paired_json.as_deref())?;
    paired::say_each(&comparisons)
}

/// Flies the entries, as many at a time as asked for, and prints each as it lands; the reports are in the order of the
/// entries.
fn fly_all(entries: &[Entry], setup: &Setup, args: &CampaignArgs) -> Vec<Option<Report>> {
    let goes_on = args.writes_files();
    fly_each(entries, usize::from(args.jobs), |entry| match entry.fly_as(setup) {
        Ok(report) => {
            say_unless_closed(goes_on, entry.row(&report));
            Some(report)
        }
        Err(error) => {
            eprintln!("plumbline: {} in {}: {}", entry.path, entry.scene, one_line(&error.into()));
            None
        }
    })
}

fn entries(args: &CampaignArgs) -> Result<Vec<Entry>, Usage> {
    let mut entries = match args.imu {
        ImuChoice::Simulated => args.choice.entries(&args.start)?,
        ImuChoice::Recorded => args.choice.recorded_entries(&args.start)?,
    };
    if args.calibration_error > 0.0 {
        entries =
            entries.into_iter().map(|entry| entry.with_calibration_error(args.calibration_error)).collect();
    }
    for entry in &mut entries {
        entry.scenario.lean_deg = args.lean_deg;
    }
    if let Some(count) = args.drawn {
        return drawn::drawn(&entries, count, args.draw_seed).map_err(Usage);
    }
    let sound = entries.clone();
    if args.faults {
        let (faults, _) = faults(args)?;
        if !args.fault.is_empty() && !faults.iter().any(|fault| fault.is_compared()) {
            entries.clear();
        }
        let flights = if args.everywhere { &sound[..] } else { &sound[..1] };
        entries.extend(
            faults.into_iter().flat_map(|fault| flights.iter().map(move |entry| entry.with_fault(fault))),
        );
    }
    let errors = each_named(&args.imu_error)?.into_iter().map(CampaignFault::Inertial);
    let conditions = each_named(&args.condition)?.into_iter().map(CampaignFault::Condition);
    for fault in errors.chain(conditions) {
        entries.extend(sound.iter().map(|entry| entry.with_fault(fault)));
    }
    Ok(entries)
}
